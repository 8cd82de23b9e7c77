from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.messages import Pose2, Twist
from ghal360_robot.simulation.plant import Body, advance, move


@dataclass
class Wall:
    """A world with one wall across the x axis."""

    x: float

    def clearance(self, x: float, y: float) -> float:
        return max(0.0, self.x - x)


@given(st.floats(-0.5, 0.5), st.floats(-1, 1), st.floats(0.01, 2))
def test_one_long_step_equals_many_short_ones(v: float, w: float, span: float) -> None:
    pose = Pose2(1.0, 2.0, 0.5)
    for _ in range(100):
        pose = advance(pose, Twist(v, w), span / 100)
    once = advance(Pose2(1.0, 2.0, 0.5), Twist(v, w), span)
    assert math.hypot(pose.x - once.x, pose.y - once.y) < 1e-9
    assert abs(math.remainder(pose.yaw - once.yaw, math.tau)) < 1e-9


def test_a_left_turn_is_counter_clockwise() -> None:
    pose = advance(Pose2(), Twist(1.0, math.pi / 2), 1.0)
    assert pose.yaw == pytest.approx(math.pi / 2)
    assert pose.y > 0


def test_a_wall_stops_the_body_and_counts_one_collision_until_it_backs_off() -> None:
    body = Body(Pose2(0.0, 0.0, 0.0))
    world = Wall(1.0)
    for _ in range(300):
        body = move(world, body, Twist(0.5, 0.0), 0.01, 0.4)  # type: ignore[arg-type]
    assert body.collisions == 1
    assert body.pose.x == pytest.approx(0.6, abs=0.006)
    for _ in range(50):
        body = move(world, body, Twist(-0.2, 0.0), 0.01, 0.4)  # type: ignore[arg-type]
    assert not body.touching
    for _ in range(100):
        body = move(world, body, Twist(0.5, 0.0), 0.01, 0.4)  # type: ignore[arg-type]
    assert body.collisions == 2
    assert body.distance_m == pytest.approx(0.6 + 0.1 + 0.1, abs=0.02)


def test_a_body_against_a_wall_can_still_turn() -> None:
    body = Body(Pose2(0.65, 0.0, 0.0))
    turned = move(Wall(1.0), body, Twist(0.0, 1.0), 0.1, 0.4)  # type: ignore[arg-type]
    assert turned.pose.yaw == pytest.approx(0.1)
