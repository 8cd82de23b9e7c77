"""Wheel positions to pose: exact on arcs, deaf to jumps."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.device.odometry import Odometry

TRACK = 0.481224


@given(st.floats(-2, 2), st.floats(-0.5, 0.5), st.integers(1, 40))
def test_a_circle_ends_where_geometry_says_however_it_is_cut(turn: float, distance: float, pieces: int) -> None:
    odometry = Odometry().advance(3.0, 4.0, 0.0, TRACK)
    for k in range(1, pieces + 1):
        part = k / pieces
        right, left = (distance + turn * TRACK / 2) * part, (distance - turn * TRACK / 2) * part
        odometry = odometry.advance(3.0 + right, 4.0 + left, part, TRACK)
    if abs(turn) > 1e-3:
        radius = distance / turn
        x, y = radius * math.sin(turn), radius * (1 - math.cos(turn))
    else:
        x, y = distance, distance * turn / 2
    assert (odometry.x, odometry.y, odometry.yaw) == pytest.approx((x, y, turn), abs=1e-6)
    assert odometry.jumps == 0


def test_the_first_reading_is_the_origin() -> None:
    odometry = Odometry().advance(12.0, 13.0, 100.0, TRACK)
    assert (odometry.x, odometry.y, odometry.yaw) == (0, 0, 0)


@pytest.mark.parametrize(("right", "left", "time_s"), [(0.0, 0.0, 10.02), (12.0, 13.0, 0.5), (50.0, 13.0, 10.02)])
def test_reset_integrators_and_a_restart_are_not_motion(right: float, left: float, time_s: float) -> None:
    odometry = Odometry().advance(12.0, 13.0, 10.0, TRACK).advance(12.1, 13.1, 10.1, TRACK)
    after = odometry.advance(right, left, time_s, TRACK)
    assert (after.x, after.y, after.yaw, after.jumps) == (odometry.x, odometry.y, odometry.yaw, 1)
    on = after.advance(right + 0.1, left + 0.1, time_s + 0.1, TRACK)
    assert on.x == pytest.approx(odometry.x + 0.1)
