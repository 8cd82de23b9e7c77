"""The whole chain of one tick, in order: gate, envelope, ramp, stop zone. Every stage says why it acted.

A stop (loss, disarm, released dead man) is not ramped here: zero goes to the wire at once and the base
slows down by its own limit, so a stop needs nothing further from this computer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.messages import STILL, Applied, ArmState, BaseMode, Twist
from ghal360_robot.safety import arming as gate
from ghal360_robot.safety import mux
from ghal360_robot.safety.arming import Arming
from ghal360_robot.safety.lease import denied
from ghal360_robot.safety.limits import SafetyLimits, clamp
from ghal360_robot.safety.ramp import ramp
from ghal360_robot.safety.staleness import Staleness, judge
from ghal360_robot.safety.stop_zone import blind_ahead, limit

if TYPE_CHECKING:
    from ghal360_robot.messages import Inputs, Surroundings

MAX_DT_S = 0.1
"""A late tick must not buy a bigger step of the ramp."""


@dataclass(frozen=True, slots=True)
class SafetyState:
    """What the chain remembers between ticks."""

    arming: Arming = Arming()
    last: Twist = STILL
    stamp_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Safety:
    """The chain with its numbers; `step` is pure."""

    limits: SafetyLimits = SafetyLimits()

    def step(self, state: SafetyState, inputs: Inputs, wanted: Twist) -> tuple[SafetyState, Applied]:
        now = inputs.stamp_ns
        stale = judge(inputs.freshness, self.limits)
        arming = gate.step(state.arming, inputs, stale, self._losses(inputs))
        dt_s = 0.0 if state.stamp_ns is None else min((now - state.stamp_ns) / 1e9, MAX_DT_S)
        held = self._held(arming, inputs, stale)
        if held:
            applied = Applied(STILL, arming.state, held)
            return SafetyState(arming, STILL, now), applied
        taken = mux.take(mux.asked(inputs, wanted), inputs.locks, now, self.limits.sources, self.limits.locks)
        if taken.held:
            return SafetyState(arming, STILL, now), Applied(STILL, arming.state, taken.held, source=taken.source)
        command, reasons = clamp(taken.twist, self.limits)
        eased, ramping = ramp(state.last, command, dt_s, self.limits)
        # Last of all, so that exactly what goes out was checked; an obstacle is not approached at a ramp's pace.
        twist, stopped, free_m = self._before_obstacles(inputs.surroundings, eased)
        applied = Applied(twist, arming.state, reasons + ramping + stopped, free_m, taken.source)
        return SafetyState(arming, twist, now), applied

    def _before_obstacles(
        self, around: Surroundings | None, wanted: Twist
    ) -> tuple[Twist, tuple[str, ...], float | None]:
        if around is None:
            return limit(None, wanted, self.limits)
        blind = blind_ahead(around.ranges, around.bearings) if wanted.v > 0 else None
        if blind:
            return Twist(0.0, wanted.w), (blind,), None
        return limit(around.points, wanted, self.limits)

    def not_ready(self, inputs: Inputs) -> tuple[str, ...]:
        """What would keep a press of the arm button from arming, for the status line and the page."""
        return gate.why_not_ready(inputs.base, judge(inputs.freshness, self.limits), self._losses(inputs))

    def _losses(self, inputs: Inputs) -> tuple[str, ...]:
        """What takes the right to move away, besides what is stale."""
        lease = denied(inputs.lease, inputs.operator, inputs.stamp_ns, self.limits.lease_s)
        return (lease,) if lease else ()

    @staticmethod
    def _held(arming: Arming, inputs: Inputs, stale: Staleness) -> tuple[str, ...]:
        if arming.state is not ArmState.ARMED:
            return (arming.reason,)
        if stale.hold:
            return stale.hold
        if inputs.base is None or inputs.base.mode is not BaseMode.DRIVE:
            return ("base is not in drive mode yet",)
        if inputs.operator is None or not inputs.operator.deadman:
            return ("dead man released",)
        return ()
