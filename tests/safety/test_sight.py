from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.mounting import LidarMount
from ghal360_robot.frames import place_of
from ghal360_robot.messages import LidarScan, Pose2
from ghal360_robot.safety.sight import ASTRAY, ASTRAY_SOON, PASSED_M, beam_step, least_around, look, seen_free
from ghal360_robot.surroundings import look_around
from tests.safety.conftest import YAW, around, scan

STEP = math.radians(270) / 810


ORIGIN = Pose2()


def free(
    ranges: np.ndarray | float, *at: tuple[float, float], turning: float = 0.0, pose: Pose2 = ORIGIN
) -> list[bool]:
    past = look(around(scan(ranges)), pose, turning)
    return seen_free([past], np.array(at, float).reshape(-1, 2)).any(axis=0).tolist()


def test_places_turn_with_the_pose() -> None:
    assert place_of(Pose2(1.0, 2.0, math.pi / 2), (0.2, 0.1)) == pytest.approx((0.9, 2.2))
    assert place_of(Pose2(1.0, 2.0, 0.0), (0.2, 0.1)) == pytest.approx((1.2, 2.1))


def test_the_step_between_beams_is_signed_and_survives_the_seam() -> None:
    assert beam_step(around(scan())) == pytest.approx(STEP)
    assert beam_step(look_around(scan(), LidarMount(upside_down=True))) == pytest.approx(-STEP)
    assert beam_step(look_around(scan(), LidarMount(yaw=2.5))) == pytest.approx(STEP)
    two = LidarScan(0, np.ones(2, np.float32), YAW[404:406], 0, 0, 0)
    assert beam_step(look_around(two, LidarMount())) == pytest.approx(STEP, rel=1e-3)
    one = LidarScan(0, np.ones(1, np.float32), YAW[:1], 0, 0, 0)
    assert beam_step(look_around(one, LidarMount())) == 0.0


@given(st.lists(st.floats(0, 25, width=32), max_size=60), st.integers(0, 12))
def test_the_least_around_is_the_least_of_a_window_and_nothing_at_the_ends(values: list[float], width: int) -> None:
    ranges = np.array(values, np.float32)
    expected = [
        min(values[i - width : i + width + 1]) if width <= i < len(values) - width else 0.0 for i in range(len(values))
    ]
    assert least_around(ranges, width).tolist() == expected


def test_what_a_beam_passed_is_free_and_what_lies_at_its_end_or_behind_is_not() -> None:
    assert free(3.0, (2.0, 0.0), (0.2, 2.0), (3.2 - PASSED_M - 0.01, 0.0)) == [True, True, True]
    assert free(3.0, (3.2 - PASSED_M + 0.01, 0.0), (3.2, 0.0), (4.0, 0.0)) == [False, False, False]


def test_what_is_out_of_the_lidars_sight_was_never_seen_free() -> None:
    beyond = math.radians(135) - ASTRAY + 0.01
    within = math.radians(135) - ASTRAY - 0.01
    for side in (1, -1):
        assert free(3.0, (0.2 + math.cos(beyond), side * math.sin(beyond))) == [False]
        assert free(3.0, (0.2 + math.cos(within), side * math.sin(within))) == [True]
    assert free(3.0, (-2.0, 0.0)) == [False]
    assert free(3.0) == []


def test_beams_without_an_echo_say_nothing() -> None:
    ranges = np.full(811, 3.0)
    ranges[400] = np.nan
    assert free(ranges, (2.0, 0.0), (2.0, 1.0)) == [False, True]


def test_a_thing_shadows_all_directions_that_might_be_its_own() -> None:
    ranges = np.full(811, 3.0)
    ranges[405] = 1.0  # straight ahead
    narrow, wide = ASTRAY - 0.5 * STEP, ASTRAY + 1.5 * STEP
    assert free(ranges, (0.2 + 2 * math.cos(narrow), 2 * math.sin(narrow))) == [False]
    assert free(ranges, (0.2 + 2 * math.cos(wide), 2 * math.sin(wide))) == [True]
    assert free(ranges, (0.2 + 2 * math.cos(wide), -2 * math.sin(wide)), turning=-0.8) == [False]
    inside = 9.8 * STEP  # (0.035 + 0.8 * 0.025) rad are 9.5 beams: ten are taken
    assert free(ranges, (0.2 + 2 * math.cos(inside), 2 * math.sin(inside)), turning=0.8) == [False]
    wider = wide + 0.8 * 0.025
    assert free(ranges, (0.2 + 2 * math.cos(wider), 2 * math.sin(wider)), turning=0.8) == [True]


def test_soon_after_a_thing_shadows_fewer_directions() -> None:
    ranges = np.full(811, 3.0)
    ranges[405] = 1.0
    for turning in (0.0, 0.8, -0.8):
        past = look(around(scan(ranges)), Pose2(), turning)
        beams = math.ceil((ASTRAY_SOON + abs(turning) * 0.025) / STEP)
        for aside, passed in ((beams, False), (beams + 1, True)):
            at = np.array([[0.2 + 2 * math.cos(aside * STEP), 2 * math.sin(aside * STEP)]])
            assert seen_free([past.soon()], at).tolist() == [[passed]]
            assert seen_free([past], at).tolist() == [[False]]


def test_points_measured_while_turning_have_to_be_free_on_both_sides() -> None:
    ranges = np.full(811, 3.0)
    ranges[405] = 1.0
    past = look(around(scan(ranges)), Pose2(), 0.0)
    limit = 10.8 * STEP  # seven beams of the scan that is asked, four of the one that asks
    assert not seen_free([past], np.array([[0.2 + 2 * math.cos(limit), 2 * math.sin(limit)]]), turning=0.8).any()
    angle = ASTRAY + 1.5 * STEP
    for side in (1, -1):
        at = np.array([[0.2 + 2 * math.cos(angle), side * 2 * math.sin(angle)]])
        assert seen_free([past], at).tolist() == [[True]]
        assert seen_free([past], at, turning=0.8).tolist() == [[False]]
        assert seen_free([past], at, turning=-0.8).tolist() == [[False]]


def test_scans_of_any_length_are_asked_at_once() -> None:
    whole = look(around(scan(3.0)), Pose2(), 0.0)
    right = LidarScan(0, np.full(405, 3.0, np.float32), YAW[:405], 0, 0, 0)
    single = LidarScan(0, np.ones(1, np.float32), YAW[:1], 0, 0, 0)
    half, none = (look(look_around(seen, LidarMount()), Pose2(), 0.0) for seen in (right, single))
    back = look(around(scan(3.0)), Pose2(2.0, 0.0, math.pi), 0.0)
    at = np.array([[2.0, -1.0], [2.0, 1.0], [-1.0, 0.0]])
    assert seen_free([whole, half, none, back], at).tolist() == [
        [True, True, False],
        [True, False, False],
        [True, True, True],
    ]
    turning = seen_free([whole, half, back], at, turning=0.5)
    assert turning.tolist() == [seen_free([past], at, turning=0.5)[0].tolist() for past in (whole, half, back)]
    assert turning.any(axis=1).all()
    empty = look(look_around(LidarScan(0, YAW[:0], YAW[:0], 0, 0, 0), LidarMount()), Pose2(), 0.0)
    assert seen_free([empty], at).shape == (0, 3)
    assert seen_free([], at).shape == (0, 3)
    assert seen_free([none], at).shape == (0, 3)
    assert seen_free([whole], at[:0]).shape == (0, 0)


def test_looks_are_kept_in_the_odometry_frame() -> None:
    pose = Pose2(5.0, -3.0, 2.0)
    ahead, beside = place_of(pose, (2.0, 0.0)), place_of(pose, (3.1, 2.0))
    assert free(3.0, ahead, beside, pose=pose) == [True, False]
    assert free(3.0, (2.0, 0.0), pose=pose) == [False]


@given(st.floats(-0.05, 0.05), st.floats(0, 1.0), st.floats(0.3, 2.4))
def test_upright_and_upside_down_see_the_same(offset: float, yaw: float, distance: float) -> None:
    ranges = np.full(811, 2.5)
    ranges[300:330] = 1.0
    upright = look(around(scan(ranges)), Pose2(), 0.0)
    turned = look(look_around(replace(scan(ranges[::-1].copy())), LidarMount(upside_down=True)), Pose2(), 0.0)
    at = np.array([[0.2 + distance * math.cos(yaw), distance * math.sin(yaw) + offset]])
    if abs(distance - 2.42) > 0.01 and abs(distance - 0.92) > 0.01:
        left = math.remainder(math.atan2(at[0, 1], at[0, 0] - 0.2), STEP)
        if abs(abs(left) - STEP / 2) > 1e-4:
            assert seen_free([upright], at).tolist() == seen_free([turned], at).tolist()
