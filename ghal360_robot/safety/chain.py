"""The whole chain of one tick, in order: gate, envelope, ramp, stop zone. Every stage says why it acted.

A stop (loss, disarm, released dead man) is not ramped here: zero goes to the wire at once and the base
slows down by its own limit, so a stop needs nothing further from this computer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibration.mounting import LidarMount, beam_bearings, scan_points
from ghal360_robot.messages import STILL, Applied, ArmState, BaseMode, Twist
from ghal360_robot.safety import arming as gate
from ghal360_robot.safety.arming import Arming
from ghal360_robot.safety.limits import SafetyLimits, clamp
from ghal360_robot.safety.ramp import ramp
from ghal360_robot.safety.staleness import Staleness, judge
from ghal360_robot.safety.stop_zone import blind_ahead, limit

if TYPE_CHECKING:
    from ghal360_robot.messages import Inputs, LidarScan

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
    lidar: LidarMount = LidarMount()

    def step(self, state: SafetyState, inputs: Inputs, wanted: Twist) -> tuple[SafetyState, Applied]:
        now = inputs.stamp_ns
        stale = judge(inputs.freshness, self.limits)
        arming = gate.step(state.arming, now, inputs.operator, inputs.base, stale)
        dt_s = 0.0 if state.stamp_ns is None else min((now - state.stamp_ns) / 1e9, MAX_DT_S)
        held = self._held(arming, inputs, stale)
        if held:
            applied = Applied(STILL, arming.state, held)
            return SafetyState(arming, STILL, now), applied
        command, reasons = clamp(wanted, self.limits)
        eased, ramping = ramp(state.last, command, dt_s, self.limits)
        # Last of all, so that exactly what goes out was checked; an obstacle is not approached at a ramp's pace.
        twist, stopped, free_m = self._before_obstacles(inputs.scan, eased)
        return SafetyState(arming, twist, now), Applied(twist, arming.state, reasons + ramping + stopped, free_m)

    def _before_obstacles(self, scan: LidarScan | None, wanted: Twist) -> tuple[Twist, tuple[str, ...], float | None]:
        if scan is None:
            return limit(None, wanted, self.limits)
        blind = blind_ahead(scan.ranges, beam_bearings(scan.yaw, self.lidar)) if wanted.v > 0 else None
        if blind:
            return Twist(0.0, wanted.w), (blind,), None
        return limit(scan_points(scan.ranges, scan.yaw, self.lidar), wanted, self.limits)

    def not_ready(self, inputs: Inputs) -> tuple[str, ...]:
        """What would keep a press of the arm button from arming, for the status line and the page."""
        return gate.why_not_ready(inputs.base, judge(inputs.freshness, self.limits))

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
