from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ghal360_robot.assembly import make_brain
from ghal360_robot.config import RobotConfig
from ghal360_robot.intent.controller import DriveSettings
from ghal360_robot.intent.steering import SteeringSettings, choose_heading

from .room import BEAMS, Room, door

SETTINGS = SteeringSettings()
RADIUS, TIGHTEST, SHORTEST = 0.40, min(SETTINGS.margins_m), min(SETTINGS.look_ahead_m)
NOTHING = np.empty((0, 2))


def closest_on_the_way(heading: float, points: NDArray[np.float64], reach: float) -> float:
    """Metres between the path of the centre and the nearest point that the robot moves towards."""
    direction = np.array([math.cos(heading), math.sin(heading)])
    along = points @ direction
    ahead = points[along > 1e-9]
    if not len(ahead):
        return math.inf
    nearest = np.clip(along[along > 1e-9], 0, reach)[:, None] * direction
    return float(np.hypot(*(ahead - nearest).T).min())


def random_scan(seed: int) -> NDArray[np.float64]:
    """Rays of a cluttered place (811, 2): a random share of them far away."""
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(rng.uniform(0.1, 2.0), rng.uniform(2.0, 12.0), 811)
    ranges[rng.random(811) < rng.random() ** 0.1] = 20.0
    return np.column_stack([ranges * np.cos(BEAMS), ranges * np.sin(BEAMS)])


scans = st.integers(0, 2**32 - 1).map(random_scan)


@pytest.mark.parametrize("pad", [SETTINGS.pad, 0.0], ids=["padded", "tangent"])
@given(points=scans, desired=st.floats(-math.pi, math.pi), previous=st.one_of(st.none(), st.floats(-4, 4)))
def test_no_chosen_heading_ever_leads_into_a_point(
    pad: float, points: NDArray[np.float64], desired: float, previous: float | None
) -> None:
    heading = choose_heading(replace(SETTINGS, pad=pad), desired, points, previous)
    if heading is not None:
        assert closest_on_the_way(heading, points, SHORTEST) >= RADIUS + TIGHTEST
        off = (heading - desired + math.pi) % math.tau - math.pi
        assert abs(off) <= SETTINGS.sweep + 1e-9


@given(scans, st.floats(-math.pi, math.pi))
def test_none_is_the_answer_only_where_every_heading_is_blocked(points: NDArray[np.float64], desired: float) -> None:
    if choose_heading(SETTINGS, desired, points) is None:
        for off in np.radians(np.arange(-60, 61)):
            assert closest_on_the_way(desired + off, points, SHORTEST) < RADIUS + TIGHTEST + 1e-3


def test_open_space_is_driven_as_wished() -> None:
    far = np.column_stack([4 * np.cos(BEAMS), 4 * np.sin(BEAMS)])
    for points in (NOTHING, far, np.full((811, 2), np.nan), np.array([[np.inf, 0.0], [np.nan, 1.0]])):
        for desired in (-3.0, -0.4, 0.0, 2.0):
            assert choose_heading(SETTINGS, desired, points) == pytest.approx(desired)


def test_a_post_is_passed_on_the_nearer_side() -> None:
    assert (choose_heading(SETTINGS, 0.0, np.array([[1.0, 0.1]])) or 0.0) < -0.3
    assert (choose_heading(SETTINGS, 0.0, np.array([[1.0, -0.1]])) or 0.0) > 0.3


def test_what_the_robot_moves_away_from_does_not_hold_it() -> None:
    behind = np.array([[-0.45, 0.0], [-0.3, 0.3], [-0.3, -0.3]])
    assert choose_heading(SETTINGS, 0.0, behind) == pytest.approx(0.0)


def test_a_wall_in_front_blocks_every_heading() -> None:
    wall = np.column_stack([np.full(401, 0.5), np.linspace(-4, 4, 401)])
    assert choose_heading(SETTINGS, 0.0, wall) is None


def test_a_gap_is_taken_in_its_middle_when_it_is_narrow() -> None:
    posts = np.array([[0.9, 0.58], [0.9, -0.58]])
    for wish_deg in (-10, -3, 0, 3, 10):
        heading = choose_heading(SETTINGS, math.radians(wish_deg), posts)
        assert heading == pytest.approx(0.0, abs=math.radians(1))


def test_the_previous_side_is_kept_while_both_are_nearly_as_good() -> None:
    left = choose_heading(SETTINGS, 0.0, np.array([[1.0, -0.01]]))
    assert left is not None
    assert left > 0
    kept = choose_heading(SETTINGS, 0.0, np.array([[1.0, 0.03]]), previous=left)
    assert kept is not None
    assert kept > 0
    given_up = choose_heading(SETTINGS, 0.0, np.array([[1.0, 0.3]]), previous=left)
    assert given_up is not None
    assert given_up < 0


def test_a_full_scan_is_judged_in_under_a_millisecond() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([np.cos(BEAMS), np.sin(BEAMS)]) * rng.uniform(0.3, 3, (811, 1))
    fastest = math.inf
    for _ in range(50):
        start = time.perf_counter()
        choose_heading(SETTINGS, 0.2, points, 0.1)
        fastest = min(fastest, time.perf_counter() - start)
    assert fastest < 1e-3


@pytest.mark.parametrize(
    ("start_y", "gaze_error_deg"), [(-1.2, 0), (-0.6, 12), (-0.6, -12), (0, 6), (0, -12), (0.6, 0), (1.2, -6), (1.2, 6)]
)
def test_the_robot_passes_a_door_of_1_1_m_when_the_operator_looks_roughly_through_it(
    start_y: float, gaze_error_deg: float
) -> None:
    room = Room(door(1.1), y=start_y)
    assert room.look_and_drive(DriveSettings(), (4.5, 0.0), math.radians(gaze_error_deg), 40.0)
    assert room.closest_m > RADIUS


@pytest.mark.parametrize(("start_y", "gaze_error_deg"), [(0.0, 0), (0.3, 4), (0.3, -4)])
def test_the_robot_passes_the_door_of_a_living_room(start_y: float, gaze_error_deg: float) -> None:
    """0.92 m: with 5 cm on either side, noise closes it in every other scan."""
    room = Room(door(0.92), y=start_y)
    steering = make_brain(RobotConfig()).drive.steering
    assert room.look_and_drive(DriveSettings(steering=steering), (4.5, 0.0), math.radians(gaze_error_deg), 25.0)
    assert room.closest_m > RADIUS


def test_the_robot_stops_before_a_door_that_is_too_narrow() -> None:
    room = Room(door(0.7), y=0.2)
    assert not room.look_and_drive(DriveSettings(), (4.5, 0.0), 0.0, 15.0)
    assert room.drive.twist.v == 0.0
    assert room.closest_m > RADIUS


@pytest.mark.parametrize(
    "wrong",
    [
        {"radius_m": 0.0},
        {"look_ahead_m": ()},
        {"look_ahead_m": (1.0, 0.0)},
        {"margins_m": ()},
        {"margins_m": (-0.1,)},
        {"sweep": 2.0},
        {"loyalty": -1.0},
    ],
)
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"margin|Margins|sweep"):
        SteeringSettings(**wrong)  # type: ignore[arg-type]
