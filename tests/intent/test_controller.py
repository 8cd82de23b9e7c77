from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.guidance.egocentric import wedge_of
from ghal360_robot.intent.controller import (
    BLOCKED,
    CUE_SHOWN,
    DRIVING,
    EVADING,
    NO_INTENTION,
    TURNING,
    DriveSettings,
    DriveState,
    drive_towards,
    step_drive,
    wanted_yaw,
)
from ghal360_robot.messages import STILL, Pose2, Twist

from .room import TICK_S, Room

SETTINGS = DriveSettings()
angles = st.floats(-math.pi, math.pi)


def drive(
    intention: int | None = 0,
    gaze: float = 0.0,
    pose: Pose2 | None = None,
    cue_shown: bool = False,
    points: np.ndarray | None = None,
    state: DriveState | None = None,
) -> DriveState:
    return step_drive(
        SETTINGS,
        state or DriveState(),
        intention=intention,
        gaze=gaze,
        pose=pose or Pose2(),
        measured=STILL,
        cue_shown=cue_shown,
        points=points,
    )


@given(angles)
def test_the_gaze_itself_is_followed_inside_the_intended_wedge(gaze: float) -> None:
    assert math.cos(wanted_yaw(wedge_of(-gaze), gaze) - gaze) == pytest.approx(1.0)


def test_a_gaze_elsewhere_leaves_the_course_at_the_centre_of_the_intended_wedge() -> None:
    assert wanted_yaw(2, math.radians(10)) == pytest.approx(math.radians(-90))
    assert wanted_yaw(7, math.radians(-100)) == pytest.approx(math.radians(45))


def test_the_robot_drives_where_the_operator_looks() -> None:
    ahead = drive(0, math.radians(5))
    assert ahead.reasons == (DRIVING,)
    assert ahead.twist.v > 0.4
    assert ahead.twist.w > 0
    assert ahead.course == pytest.approx(math.radians(5))


def test_a_target_to_the_right_is_first_turned_to() -> None:
    side = drive(2, math.radians(-90))
    assert side.reasons == (TURNING,)
    assert side.twist == Twist(0.0, -SETTINGS.w_max)


def test_courses_are_in_the_world_and_turn_with_the_robot() -> None:
    turned = drive(2, math.radians(-90), pose=Pose2(3.0, 1.0, math.radians(-90)))
    assert turned.twist.v == pytest.approx(SETTINGS.v_max)
    assert turned.twist.w == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("held", "reason"),
    [
        (drive(intention=None), NO_INTENTION),
        (drive(gaze=math.nan), NO_INTENTION),
        (drive(pose=Pose2(yaw=math.inf)), NO_INTENTION),
        (drive(cue_shown=True), CUE_SHOWN),
        (drive(intention=None, cue_shown=True), CUE_SHOWN),
        (drive(points=np.column_stack([np.full(401, 0.5), np.linspace(-4, 4, 401)])), BLOCKED),
    ],
    ids=["no intention", "no gaze", "no pose", "cue", "cue and no intention", "wall"],
)
def test_the_robot_holds_and_says_why(held: DriveState, reason: str) -> None:
    assert held.twist == STILL
    assert held.reasons == (reason,)
    assert held.course is None


def test_an_obstacle_is_evaded_and_said_so() -> None:
    evading = drive(points=np.array([[1.0, 0.1]]))
    assert EVADING in evading.reasons
    assert evading.twist.w < 0


def test_the_side_of_an_evasion_is_kept_in_the_world_while_the_robot_turns() -> None:
    first = drive(points=np.array([[1.0, -0.01]]))
    assert first.course is not None
    assert first.course > 0
    turned = 0.2
    post = np.array([[math.cos(-turned + 0.03), math.sin(-turned + 0.03)]])
    second = drive(points=post, pose=Pose2(0.0, 0.0, turned), state=first)
    assert second.course is not None
    assert second.course > 0


@given(angles, st.floats(-1, 1), st.floats(-2, 2))
def test_no_velocity_beyond_the_limits_and_none_backwards(heading: float, v: float, w: float) -> None:
    twist = drive_towards(SETTINGS, heading, Twist(v, w))
    assert 0 <= twist.v <= SETTINGS.v_max
    assert abs(twist.w) <= SETTINGS.w_max
    if abs(heading) >= SETTINGS.drive_within:
        assert twist.v == 0.0


def test_speed_rises_smoothly_as_the_heading_gets_right() -> None:
    speeds = [drive_towards(SETTINGS, math.radians(d), STILL).v for d in range(40, -1, -1)]
    assert speeds == sorted(speeds)
    assert (speeds[0], speeds[-1]) == (0.0, SETTINGS.v_max)
    assert max(np.diff(speeds)) < 0.03


@pytest.mark.parametrize("start_deg", [20, 90, -135, 179])
def test_the_base_settles_on_the_heading_without_swinging(start_deg: float) -> None:
    room = Room(walls=[], yaw=math.radians(start_deg), lag_s=0.4)
    passed = 0.0
    for _ in range(round(8 / TICK_S)):
        room.move(drive_towards(SETTINGS, -room.yaw, Twist(room.v, room.w)))
        passed = max(passed, -math.copysign(1, start_deg) * room.yaw)
    assert abs(room.yaw) < math.radians(1)
    assert passed < math.radians(1)
    assert room.v == pytest.approx(SETTINGS.v_max, abs=0.01)


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ValueError, match="positive"):
        DriveSettings(v_max=0.0)
