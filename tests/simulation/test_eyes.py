from __future__ import annotations

import math

import pytest

from ghal360_robot.simulation.eyes import MARKED_M, RECOGNISED_M, Eyes
from ghal360_robot.simulation.vantage import vantage_pose
from ghal360_robot.simulation.world import TARGETS, build_world


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("world_name", ["office", "home"])
@pytest.mark.parametrize("marked", [False, True])
def test_a_target_in_plain_view_is_recognised_pointed_out_or_not(world_name: str, target: str, marked: bool) -> None:
    world = build_world(world_name, 3, target)
    pose, thing = vantage_pose(world), world.target_object()
    bearing = math.remainder(math.atan2(thing.y - pose.y, thing.x - pose.x) - pose.yaw, math.tau)
    assert Eyes(world).look(pose, bearing, 1.5, marked=marked).target_yaw is not None
    assert Eyes(world).look(pose, bearing + math.pi, 1.5, marked=marked).target_yaw is None


def test_being_pointed_out_only_helps_to_see_further() -> None:
    assert MARKED_M > RECOGNISED_M
