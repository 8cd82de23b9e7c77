from __future__ import annotations

import math

import pytest

from ghal360_robot.messages import BaseMode, BaseState, Pose2, Twist
from ghal360_robot.trail import LENGTH, Trail


def state(stamp_ns: int, x: float = 0.0, yaw: float = 0.0) -> BaseState:
    return BaseState(stamp_ns, BaseMode.DRIVE, Pose2(x, 0.0, yaw), Twist(), 90.0)


def test_between_two_states_the_pose_is_interpolated_the_short_way_round() -> None:
    trail = Trail().extended(state(0, 1.0, math.radians(170))).extended(state(100, 2.0, math.radians(-170)))
    middle = trail.at(50)
    assert middle.x == pytest.approx(1.5)
    assert abs(middle.yaw) == pytest.approx(math.pi)


def test_outside_the_trail_its_nearest_end_counts() -> None:
    trail = Trail().extended(state(10, 1.0)).extended(state(20, 2.0))
    assert trail.at(0).x == 1.0
    assert trail.at(99).x == 2.0
    assert Trail().at(5) == Pose2()


def test_old_and_repeated_states_change_nothing_and_memory_is_bounded() -> None:
    trail = Trail()
    for n in range(3 * LENGTH):
        trail = trail.extended(state(n * 10, float(n)))
    assert trail.extended(state(5)) is trail
    assert trail.extended(None) is trail
    assert len(trail.stamps) == len(trail.poses) == LENGTH
    assert trail.at(10 * (3 * LENGTH - 1)).x == 3 * LENGTH - 1


def test_motion_continues_an_odometry_and_a_leap_begins_another() -> None:
    second = 1_000_000_000
    trail = Trail().extended(state(0, 1.0, 0.5))
    assert not trail.began_anew(state(second // 50, 1.01, 0.52))
    assert not trail.began_anew(state(second, 2.5, -1.5))
    assert trail.began_anew(state(second // 50))
    assert trail.began_anew(state(second // 50, 1.0, 1.2))
    assert not Trail().began_anew(state(0, 5.0))
    assert not trail.began_anew(None)
