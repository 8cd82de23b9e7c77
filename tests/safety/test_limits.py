from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.messages import STILL, Twist
from ghal360_robot.safety.footprint import Disc
from ghal360_robot.safety.limits import SafetyLimits, clamp

LIMITS = SafetyLimits()


@pytest.mark.parametrize(
    ("wanted", "allowed"),
    [
        (Twist(0.5, 0.0), Twist(0.5, 0.0)),
        (Twist(0.0, -0.8), Twist(0.0, -0.8)),
        (Twist(1.0, 0.4), Twist(0.5, 0.2)),
        (Twist(0.2, 1.6), Twist(0.1, 0.8)),
        (Twist(-0.3, 0.2), Twist(-0.15, 0.1)),
        (Twist(-0.15, 0.0), Twist(-0.15, 0.0)),
        (Twist(5e-324, -5e-324), Twist(5e-324, -5e-324)),
    ],
)
def test_a_twist_beyond_the_envelope_is_scaled_along_its_arc(wanted: Twist, allowed: Twist) -> None:
    twist, reasons = clamp(wanted, LIMITS)
    assert (twist.v, twist.w) == pytest.approx((allowed.v, allowed.w))
    assert reasons == (() if twist == wanted else ("speed limit",))


def test_the_faster_wheel_limits_as_well() -> None:
    limits = SafetyLimits(wheel_max=0.5, track_m=0.5)
    twist, reasons = clamp(Twist(0.4, -0.8), limits)
    assert abs(twist.v) + abs(twist.w) * 0.25 == pytest.approx(0.5)
    assert twist.v / twist.w == pytest.approx(-0.5)
    assert reasons == ("speed limit",)
    assert clamp(Twist(0.4, 0.4), limits) == (Twist(0.4, 0.4), ())


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_a_standstill(bad: float) -> None:
    assert clamp(Twist(bad, 0.1), LIMITS) == (STILL, ("command is not a number",))
    assert clamp(Twist(0.1, bad), LIMITS) == (STILL, ("command is not a number",))


def test_a_number_too_big_to_be_scaled_is_a_standstill() -> None:
    assert clamp(Twist(1e308, 1e308), SafetyLimits(v_max=0.1, w_max=0.1)) == (STILL, ("command is absurd",))
    assert clamp(Twist(1e300, 0.0), LIMITS)[0] == Twist(pytest.approx(0.5), 0.0)


def test_where_reversing_is_off_the_robot_only_turns() -> None:
    limits = SafetyLimits(reverse_max=0.0)
    assert clamp(Twist(-0.1, 0.2), limits) == (Twist(0.0, 0.2), ("reversing is off",))
    assert clamp(Twist(-0.1, 1.6), limits) == (Twist(0.0, 0.8), ("reversing is off", "speed limit"))
    assert clamp(Twist(0.1, 0.2), limits) == (Twist(0.1, 0.2), ())


@given(st.floats(), st.floats(), st.floats(0.05, 1.5), st.floats(0.0, 0.5), st.floats(0.1, 2.0), st.floats(0.05, 3.0))
def test_whatever_is_wanted_is_inside_afterwards_and_never_points_elsewhere(
    v: float, w: float, v_max: float, reverse_max: float, w_max: float, wheel_max: float
) -> None:
    limits = SafetyLimits(v_max=v_max, reverse_max=reverse_max, w_max=w_max, wheel_max=wheel_max)
    twist, reasons = clamp(Twist(v, w), limits)
    slack = 1.0 + 1e-12
    assert -reverse_max * slack <= twist.v <= v_max * slack
    assert abs(twist.w) <= w_max * slack
    assert abs(twist.v) + abs(twist.w) * limits.track_m / 2 <= wheel_max * slack
    assert twist.v * v >= 0 or twist.v == 0
    assert twist.w * w >= 0 or twist.w == 0
    assert bool(reasons) == (twist != Twist(v, w))


def test_things_matter_as_far_as_full_speed_needs_to_stop_before_them() -> None:
    assert LIMITS.outline_m == pytest.approx(0.4)
    assert LIMITS.reach_m == pytest.approx(0.4 + 0.125 + 0.25 + 0.14 + 0.15)
    assert LIMITS.people_reach_m == pytest.approx(LIMITS.reach_m + 1.2 * 1.25 + 0.25)
    wide = SafetyLimits(footprint=(Disc(0.3, 0.4, 0.1), Disc(0.0, 0.0, 0.3)), slow_margin_m=0.5)
    assert wide.outline_m == pytest.approx(0.6)
    assert wide.reach_m == pytest.approx(0.6 + 0.375 + 0.5 + 0.15)
