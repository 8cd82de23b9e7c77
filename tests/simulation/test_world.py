"""The simulated world: what every seed must give to the robot that searches in it."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from ghal360_robot.simulation.floor_grid import CELL_M, flood, walking_distance
from ghal360_robot.simulation.world import (
    CAMERA_HEIGHT_M,
    ROBOT_RADIUS_M,
    TARGETS,
    Role,
    World,
    build_world,
)

built = functools.cache(build_world)
CASES = [(name, seed, target) for name in ("office", "home") for target in TARGETS for seed in (0, 1)]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: "-".join(map(str, case)))
def world(request: pytest.FixtureRequest) -> World:
    return built(*request.param)


def grid(world: World, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Clearance on a grid made here, apart from the one the placement uses, and its points."""
    xs = np.arange(cell / 2, world.plan.width, cell)
    ys = np.arange(cell / 2, world.plan.depth, cell)
    points = np.array([[(x, y) for x in xs] for y in ys])
    clearance = world._solids.clearance(points.reshape(-1, 2)).reshape(points.shape[:2])
    return clearance, points


def test_the_robot_gets_from_the_start_to_all_free_space_and_close_to_the_target(world: World) -> None:
    cell = 0.1
    clearance, points = grid(world, cell)
    free = clearance > ROBOT_RADIUS_M
    start = int(world.start.y / cell), int(world.start.x / cell)
    reached = flood(free, start)
    assert (reached == free).all()
    target = world.target_object()
    near = points[reached & (np.hypot(points[..., 0] - target.x, points[..., 1] - target.y) <= 3.0)]
    seeing = [(x, y) for x, y in near if world.visible(x, y, CAMERA_HEIGHT_M, target)]
    assert len(seeing) >= 10
    assert all(any(room.contains(x, y) for x, y in points[reached]) for room in world.rooms)


def test_the_target_is_a_walk_of_four_to_nine_metres_away(world: World) -> None:
    cell = 0.08
    clearance, points = grid(world, cell)
    free = clearance > ROBOT_RADIUS_M
    target = world.target_object()
    away = np.hypot(points[..., 0] - target.x, points[..., 1] - target.y)
    arrived = free & (away <= 2.0)
    arrived[arrived] = [world.visible(x, y, CAMERA_HEIGHT_M, target) for x, y in points[arrived]]
    length = cell / CELL_M * walking_distance(free, arrived)
    assert 4.0 <= length[int(world.start.y / cell), int(world.start.x / cell)] <= 9.0


def test_the_start_is_free(world: World) -> None:
    assert world.clearance(world.start.x, world.start.y) >= 0.55


def test_exactly_one_thing_is_the_target_and_no_other_has_its_class(world: World) -> None:
    assert [item.name for item in world.objects if item.role is Role.TARGET] == [world.target]
    assert sum(item.name == world.target for item in world.objects) == 1
    assert all(sum(item.name == name for item in world.objects) == 1 for name in TARGETS)


def test_nothing_sticks_through_a_wall_and_small_things_stand_on_something(world: World) -> None:
    for item in world.objects:
        room = world.room_at(item.x, item.y)
        assert room is not None, item
        if item.round or item.name == "rug":
            continue
        reach_x = abs(math.cos(item.yaw)) * item.size[0] / 2 + abs(math.sin(item.yaw)) * item.size[1] / 2
        assert room.x0 - 0.005 <= item.x - reach_x, item
        assert item.x + reach_x <= room.x1 + 0.005, item
    for item in world.objects:
        if item.name in {"laptop", "bottle", "vase", "mug"}:
            under = [other for other in world.objects if abs(other.top - item.z) < 1e-9 and other.solid]
            assert any(math.hypot(other.x - item.x, other.y - item.y) < 1.4 for other in under), item


def test_the_target_is_rarely_in_sight_of_the_start() -> None:
    worlds = [built(name, seed, target) for name, seed, target in CASES]
    seen = [world.visible(world.start.x, world.start.y, CAMERA_HEIGHT_M, world.target_object()) for world in worlds]
    assert np.mean(seen) < 0.3


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["office", "home"])
@pytest.mark.parametrize("target", TARGETS)
def test_fifty_seeds_give_a_world(name: str, target: str) -> None:
    for seed in range(1000, 1050):
        world = build_world(name, seed, target)
        assert world.clearance(world.start.x, world.start.y) >= 0.55
        assert sum(item.name == target for item in world.objects) == 1


@pytest.mark.parametrize("name", ["office", "home"])
def test_the_same_arguments_give_the_same_world_and_another_seed_another(name: str) -> None:
    assert build_world(name, 7, "bottle") == build_world(name, 7, "bottle")
    assert build_world(name, 7, "bottle").objects != build_world(name, 8, "bottle").objects


@pytest.mark.parametrize(("name", "target"), [("castle", "backpack"), ("home", "unicorn")])
def test_an_unknown_name_is_refused_with_the_choices(name: str, target: str) -> None:
    with pytest.raises(ValueError, match="choose one of"):
        build_world(name, 0, target)


def test_doors_are_wide_enough(world: World) -> None:
    for door in world.plan.doors:
        assert door.width >= 1.1
        assert world.clearance(door.x, door.y) >= 0.55


def test_ranges_agree_with_clearance_along_each_ray(world: World) -> None:
    yaw = np.linspace(-math.pi, math.pi, 181)
    ranges = world.ranges(world.start.x, world.start.y, yaw)
    assert np.isfinite(ranges).all()
    assert ranges.min() >= world.clearance(world.start.x, world.start.y) - 1e-9
    for distance, angle in list(zip(ranges, yaw, strict=True))[::20]:
        x, y = world.start.x + distance * math.cos(angle), world.start.y + distance * math.sin(angle)
        assert world.clearance(x, y) < 1e-6
        for part in (0.3, 0.6, 0.9):
            along = part * distance
            there = world.start.x + along * math.cos(angle), world.start.y + along * math.sin(angle)
            assert world.clearance(*there) > 0.0


def test_ranges_from_inside_a_solid_are_zero_and_from_outside_may_be_infinite(world: World) -> None:
    bed_like = next(item for item in world.objects if item.solid)
    assert (world.ranges(bed_like.x, bed_like.y, np.array([0.0, 1.0])) == 0.0).all()
    assert math.isinf(world.ranges(-5.0, -5.0, np.array([math.pi]))[0])
    assert world.clearance(-5.0, -5.0) == 0.0


def test_a_wall_hides_the_target_and_the_target_does_not_hide_itself(world: World) -> None:
    target = world.target_object()
    room = world.room_at(target.x, target.y)
    others = [other for other in world.rooms if other is not room]
    assert any(not world.visible(*other.centre, CAMERA_HEIGHT_M, target) for other in others)
    assert world.visible(target.x, target.y, target.z + target.size[2] / 2, target)
