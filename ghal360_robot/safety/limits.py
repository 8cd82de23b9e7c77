"""The envelope of motion: what may be asked of the base at all."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ghal360_robot.messages import STILL, Twist
from ghal360_robot.safety.lease import LEASE_S
from ghal360_robot.safety.mux import SOURCES, LockRule, Source


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Numbers of the whole chain, SI. Defaults are the RMP-110's stored limits and the zones sized by them."""

    v_max: float = 0.5
    w_max: float = 0.8
    accel: float = 0.5
    decel: float = 0.5
    w_accel: float = 1.5
    reverse_max: float = 0.15
    footprint_radius_m: float = 0.40
    margin_m: float = 0.04
    standoff_m: float = 0.10
    reaction_s: float = 0.25
    lease_s: float = LEASE_S
    sources: tuple[Source, ...] = SOURCES
    locks: tuple[LockRule, ...] = ()
    hold_s: tuple[tuple[str, float], ...] = (("operator", 0.2), ("tim571", 0.25), ("rmp110", 0.3), ("theta", 0.7))
    """Age of an input from which the base stands still."""
    lost_s: tuple[tuple[str, float], ...] = (("operator", 1.0), ("tim571", 1.0), ("rmp110", 1.0), ("theta", 2.0))
    """Age of an input from which the robot is disarmed."""


def clamp(wanted: Twist, limits: SafetyLimits) -> tuple[Twist, tuple[str, ...]]:
    """The nearest twist of the same curvature inside the envelope; anything not finite becomes a standstill."""
    if not (math.isfinite(wanted.v) and math.isfinite(wanted.w)):
        return STILL, ("command is not a number",)
    forward = limits.v_max if wanted.v >= 0 else limits.reverse_max
    excess = max(abs(wanted.v) / forward if forward else math.inf * abs(wanted.v), abs(wanted.w) / limits.w_max, 1.0)
    if not math.isfinite(excess):
        return Twist(0.0, math.copysign(min(abs(wanted.w), limits.w_max), wanted.w)), ("reversing is off",)
    if excess == 1.0:
        return wanted, ()
    return Twist(wanted.v / excess, wanted.w / excess), ("speed limit",)
