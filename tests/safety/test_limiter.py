from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.messages import STILL, Twist
from ghal360_robot.safety.limiter import LAG_S, ramp, start
from ghal360_robot.safety.limits import SafetyLimits

LIMITS = SafetyLimits(accel=0.4, decel=1.0, w_accel=2.0)


@pytest.mark.parametrize(
    ("last", "wanted", "reached"),
    [
        (Twist(0.0, 0.0), Twist(0.5, 0.0), Twist(0.04, 0.0)),
        (Twist(0.3, 0.0), Twist(0.31, 0.0), Twist(0.31, 0.0)),
        (Twist(0.5, 0.0), Twist(0.0, 0.0), Twist(0.4, 0.0)),
        (Twist(0.05, 0.0), Twist(0.0, 0.0), Twist(0.0, 0.0)),
        (Twist(0.05, 0.0), Twist(-0.5, 0.0), Twist(0.0, 0.0)),
        (Twist(0.3, 0.0), Twist(-0.5, 0.0), Twist(0.2, 0.0)),
        (Twist(-0.1, 0.0), Twist(-0.15, 0.0), Twist(-0.14, 0.0)),
        (Twist(-0.1, 0.0), Twist(0.5, 0.0), Twist(0.0, 0.0)),
        (Twist(0.0, 0.0), Twist(0.0, -0.8), Twist(0.0, -0.2)),
        (Twist(0.0, -0.8), Twist(0.0, 0.0), Twist(0.0, -0.6)),
        (Twist(0.2, 0.2), Twist(0.2, 0.2), Twist(0.2, 0.2)),
    ],
)
def test_speeding_up_and_slowing_down_each_keep_their_limit(last: Twist, wanted: Twist, reached: Twist) -> None:
    twist, reasons = ramp(last, wanted, 0.1, LIMITS)
    assert (twist.v, twist.w) == pytest.approx((reached.v, reached.w))
    assert reasons == (() if reached == wanted else ("ramp",))


def test_without_time_nothing_changes() -> None:
    assert ramp(Twist(0.1, 0.2), Twist(0.5, 0.8), 0.0, LIMITS) == (Twist(0.1, 0.2), ("ramp",))


def test_anew_the_ramp_begins_at_the_measured_speed_inside_the_envelope() -> None:
    assert start(Twist(0.5, 0.8), Twist(0.2, -0.1), LIMITS, anew=True) == Twist(0.2, -0.1)
    assert start(STILL, Twist(9.0, -9.0), LIMITS, anew=True) == Twist(0.5, -0.8)
    assert start(STILL, Twist(-9.0, 9.0), LIMITS, anew=True) == Twist(-0.15, 0.8)
    assert start(Twist(0.4, 0.4), Twist(math.nan, math.nan), LIMITS, anew=True) == STILL


def test_otherwise_it_begins_at_the_command_before() -> None:
    assert start(Twist(0.3, 0.1), Twist(0.28, 0.0), LIMITS, anew=False) == Twist(0.3, 0.1)
    assert start(Twist(0.1, 0.0), Twist(0.5, 0.0), LIMITS, anew=False) == Twist(0.1, 0.0)
    assert start(Twist(-0.1, -0.1), Twist(-0.1, -0.1), LIMITS, anew=False) == Twist(-0.1, -0.1)


def test_a_base_that_does_not_follow_winds_nothing_up() -> None:
    lead_v, lead_w = LIMITS.accel * LAG_S, LIMITS.w_accel * LAG_S
    assert start(Twist(0.5, 0.8), STILL, LIMITS, anew=False) == Twist(lead_v, lead_w)
    assert start(Twist(-0.15, -0.8), STILL, LIMITS, anew=False) == Twist(-lead_v, -lead_w)
    assert start(Twist(0.5, 0.8), Twist(0.2, 0.1), LIMITS, anew=False) == Twist(0.2 + lead_v, 0.1 + lead_w)
    # Rolling the other way is no reason to brake harder than standing.
    assert start(Twist(0.5, 0.8), Twist(-0.1, -0.2), LIMITS, anew=False) == Twist(lead_v, lead_w)
    assert start(Twist(-0.15, -0.8), Twist(0.1, 0.2), LIMITS, anew=False) == Twist(-lead_v, -lead_w)


speeds = st.builds(Twist, st.floats(-0.15, 0.5), st.floats(-0.8, 0.8))


@given(speeds, speeds, st.floats(0.0, 0.1))
def test_no_step_is_bigger_than_its_limit_and_none_overshoots(last: Twist, wanted: Twist, dt_s: float) -> None:
    twist, _ = ramp(last, wanted, dt_s, LIMITS)
    rising = LIMITS.accel if abs(twist.v) > abs(last.v) else LIMITS.decel
    assert abs(twist.v - last.v) <= rising * dt_s + 1e-12
    assert abs(twist.w - last.w) <= LIMITS.w_accel * dt_s + 1e-12
    for now, before, goal in ((twist.v, last.v, wanted.v), (twist.w, last.w, wanted.w)):
        assert min(before, goal) - 1e-12 <= now <= max(before, goal) + 1e-12


@given(speeds, st.builds(Twist, st.floats(), st.floats()), st.booleans())
def test_whatever_is_measured_the_start_is_inside_the_envelope(last: Twist, measured: Twist, anew: bool) -> None:
    twist = start(last, measured, LIMITS, anew=anew)
    assert -LIMITS.reverse_max <= twist.v <= LIMITS.v_max
    assert abs(twist.w) <= LIMITS.w_max
