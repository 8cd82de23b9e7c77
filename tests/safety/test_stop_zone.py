from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.messages import Twist
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.stop_zone import HORIZON_M, clearance, limit

RADIUS = 0.5


def test_a_point_straight_ahead_leaves_its_distance_less_the_radius() -> None:
    seen = clearance(np.array([[1.6, 0.0]]), Twist(0.5, 0.0), RADIUS)
    assert seen.free_m == pytest.approx(1.1, abs=0.051)
    assert seen.bearing == pytest.approx(0.0)


def test_a_point_beside_the_corridor_does_not_limit() -> None:
    assert clearance(np.array([[1.0, 0.6]]), Twist(0.5, 0.0), RADIUS).free_m == HORIZON_M


def test_an_arc_sweeps_where_it_leads_and_not_straight_ahead() -> None:
    left_turn = Twist(0.4, 0.8)
    assert clearance(np.array([[1.6, 0.0]]), left_turn, RADIUS).free_m == HORIZON_M
    assert clearance(np.array([[0.3, 1.2]]), left_turn, RADIUS).free_m < 1.2


def test_backing_looks_behind() -> None:
    assert clearance(np.array([[-1.0, 0.0]]), Twist(-0.1, 0.0), RADIUS).free_m < 0.6
    assert clearance(np.array([[1.0, 0.0]]), Twist(-0.1, 0.0), RADIUS).free_m == HORIZON_M


def test_turning_on_the_spot_is_always_free() -> None:
    twist, reasons, _ = limit(np.array([[0.3, 0.0]]), 811, Twist(0.0, 0.7), SafetyLimits())
    assert twist == Twist(0.0, 0.7)
    assert reasons == ()


@given(st.floats(0.0, 2.0), st.floats(0.05, 0.5))
def test_the_allowed_speed_can_always_be_braked_inside_the_free_distance(distance: float, speed: float) -> None:
    limits = SafetyLimits()
    radius = limits.footprint_radius_m + limits.margin_m
    wall = np.column_stack((np.full(60, radius + distance), np.linspace(-1, 1, 60)))
    twist, _, _ = limit(wall, 811, Twist(speed, 0.0), limits)
    stopping = twist.v * limits.reaction_s + twist.v**2 / (2 * limits.decel)
    assert stopping <= distance + 1e-6


@given(st.floats(-math.pi, math.pi), st.floats(0.0, 3.0), st.floats(-0.5, 0.5), st.floats(-1.0, 1.0))
def test_the_zone_never_speeds_up_and_never_turns_around(bearing: float, r: float, v: float, w: float) -> None:
    cloud = np.tile([[r * math.cos(bearing), r * math.sin(bearing)]], (100, 1))
    twist, _, _ = limit(cloud, 811, Twist(v, w), SafetyLimits())
    assert abs(twist.v) <= abs(v)
    assert twist.v * v >= 0
    assert twist.w == w
