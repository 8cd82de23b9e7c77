from __future__ import annotations

import math

import pytest

from ghal360_robot.messages import Pose2
from ghal360_robot.simulation.ground_map import FREE, OCCUPIED, RESOLUTION_M, in_odometry, occupancy
from ghal360_robot.simulation.world import build_world


def test_cells_are_free_where_the_world_is_with_the_top_row_at_the_largest_y() -> None:
    world = build_world("home", 1)
    cells = occupancy(world)
    assert set(cells.ravel().tolist()) == {FREE, OCCUPIED}
    column, row = int(world.start.x / RESOLUTION_M), int(world.start.y / RESOLUTION_M)
    assert cells[cells.shape[0] - 1 - row, column] == FREE
    for item in (item for item in world.objects if item.solid):
        column, row = int(item.x / RESOLUTION_M), int(item.y / RESOLUTION_M)
        assert cells[cells.shape[0] - 1 - row, column] == OCCUPIED


def test_the_start_is_the_origin_of_the_odometry() -> None:
    start = Pose2(3.0, 4.0, 0.7)
    assert in_odometry(start, start) == Pose2()
    ahead = Pose2(3.0 + math.cos(0.7), 4.0 + math.sin(0.7), 0.7 + math.pi / 2)
    seen = in_odometry(start, ahead)
    assert (seen.x, seen.y, seen.yaw) == pytest.approx((1.0, 0.0, math.pi / 2))
