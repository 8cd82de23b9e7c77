"""The acceleration limiter: from what the base does towards what is wanted, never faster than allowed.

It starts from the command before, but from the MEASURED speed wherever that command says nothing about the base:
after a hold or a loss, when another source takes over, and when the base does not follow (its own watchdog has
stopped it, or a wheel is blocked), so that nothing winds up meanwhile.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ghal360_robot.messages import Twist

if TYPE_CHECKING:
    from ghal360_robot.safety.limits import SafetyLimits

LAG_S = 0.25
"""A base that follows is this much of a ramp behind its command at most: 0.04 s of latency, bus, feedback, friction."""


def start(last: Twist, measured: Twist, limits: SafetyLimits, *, anew: bool) -> Twist:
    """Where the ramp begins. `anew`: the command before says nothing about the base."""
    v, w = _inside(measured.v, -limits.reverse_max, limits.v_max), _inside(measured.w, -limits.w_max, limits.w_max)
    if anew:
        return Twist(v, w)
    lead_v, lead_w = limits.accel * LAG_S, limits.w_accel * LAG_S
    return Twist(_leading(last.v, v, lead_v), _leading(last.w, w, lead_w))


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


def _leading(last: float, measured: float, lead: float) -> float:
    """The command before, but not further beyond the measured speed than a base that follows would lag."""
    if last > max(measured, 0.0) + lead:
        return max(measured, 0.0) + lead
    if last < min(measured, 0.0) - lead:
        return min(measured, 0.0) - lead
    return last


def _inside(value: float, low: float, high: float) -> float:
    """Clamped; a measurement that is no number counts as standing."""
    return min(max(value, low), high) if value == value else 0.0  # noqa: PLR0124 - NaN is not itself
