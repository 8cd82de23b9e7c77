from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.mounting import LidarMount, median_of_three, scan_points

YAW = np.radians(np.linspace(-135, 135, 811)).astype(np.float32)


def scan(value: float) -> np.ndarray:
    return np.full(811, value, np.float32)


def test_straight_ahead_is_the_mount_plus_the_range() -> None:
    points = scan_points(scan(2.0), YAW, LidarMount(x=0.2, y=0.1))
    assert points[405] == pytest.approx((2.2, 0.1), abs=1e-6)


def test_a_positive_yaw_is_left_and_upside_down_mirrors_it() -> None:
    upright = scan_points(scan(2.0), YAW, LidarMount(x=0.0))
    mirrored = scan_points(scan(2.0), YAW, LidarMount(x=0.0, upside_down=True))
    assert upright[-1][1] > 0
    assert mirrored == pytest.approx(upright * (1, -1), abs=1e-6)


def test_a_turned_mount_turns_the_points() -> None:
    points = scan_points(scan(1.0), YAW, LidarMount(x=0.0, yaw=math.pi / 2))
    assert points[405] == pytest.approx((0.0, 1.0), abs=1e-6)


def test_beams_without_a_range_are_no_points() -> None:
    ranges = scan(2.0)
    ranges[100:300] = np.nan
    assert len(scan_points(ranges, YAW, LidarMount())) == 611
    assert len(scan_points(scan(np.nan), YAW, LidarMount())) == 0


def test_a_single_wild_beam_vanishes_and_what_two_beams_see_stays() -> None:
    ranges = scan(3.0)
    ranges[200], ranges[400:402] = 0.3, 0.5
    smooth = median_of_three(ranges)
    assert smooth[200] == 3.0
    assert smooth[400] == smooth[401] == 0.5


def test_a_lone_beam_among_silent_ones_is_kept() -> None:
    ranges = scan(np.nan)
    ranges[200] = 0.7
    assert median_of_three(ranges)[200] == np.float32(0.7)


@given(st.lists(st.floats(0.0625, 25.0, width=32), min_size=3, max_size=60))
def test_the_median_is_that_of_three_neighbours(values: list[float]) -> None:
    ranges = np.array(values, np.float32)
    expected = [float(np.median(ranges[i - 1 : i + 2])) for i in range(1, len(ranges) - 1)]
    assert median_of_three(ranges)[1:-1].tolist() == pytest.approx(expected)
