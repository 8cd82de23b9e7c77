"""The whole chain of one tick, from what is asked for to what the base is told. Every stage says why it acted.

State comes first: everything that takes the right to move away (silence, lease, latches, a tick that came late) is
settled before any command is looked at, because nothing after it could bring a zero back to life. Then the command
goes through its stages: source mux, gate, envelope, derating, collision monitor, acceleration limiter. What the limiter
made of it is checked by the monitor again whenever it is not what was checked: exactly what goes out has been held
against the scan, and an obstacle is not approached at a ramp's pace.

A stop (loss, disarm, released dead man) is not ramped here: zero goes to the wire at once and the base
slows down by its own limit, so a stop needs nothing further from this computer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.messages import STILL, Applied, ArmState, BaseMode, Twist
from ghal360_robot.safety import arming as gate
from ghal360_robot.safety import derating, mux
from ghal360_robot.safety.arming import Arming
from ghal360_robot.safety.collision import watch
from ghal360_robot.safety.derating import Derating
from ghal360_robot.safety.lease import denied
from ghal360_robot.safety.limiter import ramp, start
from ghal360_robot.safety.limits import SafetyLimits, clamp
from ghal360_robot.safety.memory import Memory, remember
from ghal360_robot.safety.staleness import Staleness, judge, unanswered
from ghal360_robot.safety.watchdog import gap

if TYPE_CHECKING:
    from ghal360_robot.messages import Inputs
    from ghal360_robot.safety.derating import Reading

MAX_DT_S = 0.1
"""A late tick must not buy a bigger step of the ramp."""


@dataclass(frozen=True, slots=True)
class SafetyState:
    """What the chain remembers between ticks."""

    arming: Arming = Arming()
    last: Twist = STILL
    source: str = ""
    """Whose command `last` was; empty after a hold."""
    stopped: float = 0.0
    """The speed that was asked for where the collision monitor let nothing of it through; 0 otherwise."""
    derating: Derating = Derating()
    memory: Memory = Memory()
    stamp_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Safety:
    """The chain with its numbers; `step` is pure."""

    limits: SafetyLimits = SafetyLimits()

    def step(self, state: SafetyState, inputs: Inputs, wanted: Twist) -> tuple[SafetyState, Applied]:
        """One tick: `wanted` is what the brain wants, all other wishes are among the inputs."""
        limits, now = self.limits, inputs.stamp_ns
        stale = judge(inputs, limits)
        levels, readings = derating.step(state.derating, inputs, limits.deratings)
        arming = gate.step(state.arming, inputs, stale, self._losses(state, inputs, readings))
        memory = remember(state.memory, inputs, limits)
        taken = mux.take(mux.asked(inputs, wanted), inputs.locks, now, limits.sources, limits.locks)
        monitor = watch(limits, memory, inputs, taken.source, state.stopped)
        held = _held(arming, inputs, stale, readings) or taken.held
        if held or isinstance(monitor, str):
            rest = SafetyState(arming, derating=levels, memory=memory, stamp_ns=now)
            return rest, Applied(STILL, arming.state, held or (str(monitor),), source=taken.source)
        command, said = clamp(taken.twist, limits)
        command, slowed = derating.derate(command, readings)
        safe, avoiding, free_m = monitor.check(command)
        begin = start(state.last, monitor.measured, limits, anew=taken.source != state.source)
        twist, ramping = ramp(begin, safe, self._dt_s(state, now), limits)
        if twist != safe:
            twist, again, free_m = monitor.check(twist)
            avoiding = again or avoiding
        stopped = 0.0 if safe.v else command.v
        after = SafetyState(arming, twist, taken.source, stopped, levels, memory, now)
        return after, Applied(twist, arming.state, said + slowed + avoiding + ramping, free_m, taken.source)

    def not_ready(self, state: SafetyState, inputs: Inputs) -> tuple[str, ...]:
        """What would keep a press of the arm button from arming, for the status line and the page."""
        _, readings = derating.step(state.derating, inputs, self.limits.deratings)
        losses = self._losses(state, inputs, readings)
        return gate.why_not_ready(inputs.base, judge(inputs, self.limits), losses)

    def _losses(self, state: SafetyState, inputs: Inputs, readings: tuple[Reading, ...]) -> tuple[str, ...]:
        """What takes the right to move away, besides what is stale."""
        lease = denied(inputs.lease, inputs.operator, inputs.stamp_ns, self.limits.lease_s)
        late = gap(state.stamp_ns, inputs.stamp_ns, self.limits.tick_gap_s)
        return tuple(why for why in (lease, late) if why) + derating.stops(readings, disarms=True)

    @staticmethod
    def _dt_s(state: SafetyState, now_ns: int) -> float:
        return 0.0 if state.stamp_ns is None else min(max((now_ns - state.stamp_ns) / 1e9, 0.0), MAX_DT_S)


def _held(arming: Arming, inputs: Inputs, stale: Staleness, readings: tuple[Reading, ...]) -> tuple[str, ...]:
    if arming.state is not ArmState.ARMED:
        return (arming.reason,)
    if stale.hold:
        return stale.hold
    if inputs.base is None or inputs.base.mode is not BaseMode.DRIVE:
        return ("base is not in drive mode yet",)
    if inputs.operator is None or not inputs.operator.deadman:
        return ("dead man released",)
    late = unanswered(inputs)
    return (late,) if late else derating.stops(readings, disarms=False)
