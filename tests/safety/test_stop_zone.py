from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.messages import Twist
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.stop_zone import blind_ahead, clearance, horizon_m, limit

RADIUS, HORIZON = 0.5, 2.0
BEAMS = np.radians(np.linspace(-135, 135, 811))


def test_a_point_straight_ahead_leaves_its_distance_less_the_radius() -> None:
    seen = clearance(np.array([[1.6, 0.0]]), Twist(0.5, 0.0), RADIUS, HORIZON)
    assert seen.free_m == pytest.approx(1.1, abs=0.051)
    assert seen.bearing == pytest.approx(0.0)


def test_a_point_beside_the_corridor_does_not_limit() -> None:
    assert clearance(np.array([[1.0, 0.6]]), Twist(0.5, 0.0), RADIUS, HORIZON).free_m == math.inf


def test_an_arc_sweeps_where_it_leads_and_not_straight_ahead() -> None:
    left_turn = Twist(0.4, 0.8)
    assert clearance(np.array([[1.6, 0.0]]), left_turn, RADIUS, HORIZON).free_m == math.inf
    assert clearance(np.array([[0.3, 1.2]]), left_turn, RADIUS, HORIZON).free_m < 1.2


def test_backing_looks_behind() -> None:
    assert clearance(np.array([[-1.0, 0.0]]), Twist(-0.1, 0.0), RADIUS, HORIZON).free_m < 0.6
    assert clearance(np.array([[1.0, 0.0]]), Twist(-0.1, 0.0), RADIUS, HORIZON).free_m == math.inf


def test_turning_on_the_spot_is_always_free() -> None:
    twist, reasons, _ = limit(np.array([[0.3, 0.0]]), Twist(0.0, 0.7), SafetyLimits())
    assert twist == Twist(0.0, 0.7)
    assert reasons == ()


@given(st.floats(0.0, 2.0), st.floats(0.05, 0.5))
def test_the_allowed_speed_can_always_be_braked_inside_the_free_distance(distance: float, speed: float) -> None:
    limits = SafetyLimits()
    radius = limits.footprint_radius_m + limits.margin_m
    wall = np.column_stack((np.full(60, radius + distance), np.linspace(-1, 1, 60)))
    twist, _, _ = limit(wall, Twist(speed, 0.0), limits)
    stopping = twist.v * limits.reaction_s + twist.v**2 / (2 * limits.decel)
    assert stopping <= distance + 1e-6


@given(st.floats(-math.pi, math.pi), st.floats(0.0, 3.0), st.floats(-0.5, 0.5), st.floats(-1.0, 1.0))
def test_the_zone_never_speeds_up_and_never_turns_around(bearing: float, r: float, v: float, w: float) -> None:
    cloud = np.tile([[r * math.cos(bearing), r * math.sin(bearing)]], (100, 1))
    twist, _, _ = limit(cloud, Twist(v, w), SafetyLimits())
    assert abs(twist.v) <= abs(v)
    assert twist.v * v >= 0
    assert twist.w == w


@given(st.floats(0.05, 1.5), st.floats(0.1, 3.0), st.floats(0.05, 2.0))
def test_the_horizon_holds_the_stopping_distance_of_any_limits(v_max: float, decel: float, reaction: float) -> None:
    limits = SafetyLimits(v_max=v_max, decel=decel, reaction_s=reaction)
    assert horizon_m(limits) >= v_max * reaction + v_max**2 / (2 * decel)
    radius = limits.footprint_radius_m + limits.margin_m
    wall = np.column_stack((np.full(400, radius + horizon_m(limits) + 0.01), np.linspace(-1, 1, 400)))
    twist, _, _ = limit(wall, Twist(v_max, 0.0), limits)
    assert twist.v == v_max


def test_a_scan_that_looks_elsewhere_says_nothing_about_the_way_ahead() -> None:
    behind = np.radians([179.0, -179.0])
    assert blind_ahead(np.full(2, 3.0, np.float32), behind) is not None
    half = BEAMS[BEAMS < 0]
    assert blind_ahead(np.full(len(half), 3.0, np.float32), half) is not None
    assert blind_ahead(np.full(811, 3.0, np.float32), BEAMS) is None


def test_echoes_beside_and_behind_do_not_make_up_for_none_ahead() -> None:
    ranges = np.full(811, np.nan, np.float32)
    ranges[:150] = ranges[-150:] = 2.0
    assert "nothing ahead" in str(blind_ahead(ranges, BEAMS))
