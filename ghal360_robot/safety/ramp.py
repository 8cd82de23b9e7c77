"""The acceleration limiter: from the last applied twist towards the wanted one, never faster than allowed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ghal360_robot.messages import Twist

if TYPE_CHECKING:
    from ghal360_robot.safety.limits import SafetyLimits


def ramp(last: Twist, wanted: Twist, dt_s: float, limits: SafetyLimits) -> tuple[Twist, tuple[str, ...]]:
    """The twist reachable after `dt_s`. Speeding up and slowing down have their own limits."""
    v = _towards(last.v, wanted.v, limits.accel * dt_s, limits.decel * dt_s)
    w = _towards(last.w, wanted.w, limits.w_accel * dt_s, limits.w_accel * dt_s)
    limited = abs(v - wanted.v) > 1e-9 or abs(w - wanted.w) > 1e-9
    return Twist(v, w), ("ramp",) if limited else ()


def _towards(last: float, wanted: float, rise: float, fall: float) -> float:
    braking = abs(wanted) < abs(last) or wanted * last < 0
    step = fall if braking else rise
    if wanted * last < 0 and step >= abs(last):
        return 0.0  # through zero takes a tick at zero: two different limits meet there
    return min(max(wanted, last - step), last + step)
