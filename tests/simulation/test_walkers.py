from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from ghal360_robot.simulation.walkers import BODY_M, HARD_BRAKE, LEG_RADIUS_M, PACE_MPS, Crowd, Moving
from ghal360_robot.simulation.walking_ground import PERSON_WAY_M, PLACES, ROBOT_WAY_M, Ground
from ghal360_robot.simulation.world import ROBOT_RADIUS_M, build_world

DT_S = 0.02
FAR = Moving(-100.0, -100.0, 0.0, 0.0, ROBOT_RADIUS_M)


@cache
def ground(name: str = "home") -> Ground:
    return Ground(build_world(name, 3))


def robot_at_start(name: str = "home") -> Moving:
    start = ground(name).world.start
    return Moving(start.x, start.y, 0.0, 0.0, ROBOT_RADIUS_M)


def walked(crowd: Crowd, robot: Moving, seconds: float) -> tuple[NDArray[np.float64], ...]:
    """Positions and velocities (t, n, 2), legs (t, 2n, 3) of every step."""
    at, velocity, legs = [], [], []
    for _ in range(round(seconds / DT_S)):
        crowd.step(DT_S, robot)
        at.append(crowd.at.copy())
        velocity.append(crowd.velocity.copy())
        legs.append(crowd.legs())
    return np.array(at), np.array(velocity), np.array(legs)


@pytest.mark.parametrize(("name", "seed"), [("home", 0), ("home", 1), ("office", 2)])
def test_bodies_stay_out_of_walls_furniture_and_each_other(name: str, seed: int) -> None:
    crowd = Crowd(ground(name), seed, 4, robot_at_start(name), courteous=False)
    at, _, _ = walked(crowd, robot_at_start(name), 20.0)
    for i, radius in enumerate(crowd.radius):
        assert ground(name).world.clearances(at[::5, i, 0], at[::5, i, 1]).min() > radius
        for j in range(i):
            apart = np.hypot(*(at[:, i] - at[:, j]).T) - radius - crowd.radius[j]
            assert apart.min() > -0.02


def test_people_walk_at_their_pace_and_change_it_smoothly() -> None:
    crowd = Crowd(ground(), 5, 4, FAR, courteous=True)
    at, velocity, _ = walked(crowd, FAR, 30.0)
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    assert (speed.max(axis=0) <= crowd.pace + 1e-9).all()
    assert ((crowd.pace >= PACE_MPS[0]) & (crowd.pace <= PACE_MPS[1])).all()
    assert ((crowd.radius >= BODY_M[0]) & (crowd.radius <= BODY_M[1])).all()
    assert np.hypot(*np.diff(at, axis=0).transpose(2, 0, 1)).sum(axis=0).mean() > 5.0, "they get about"
    change = np.hypot(*np.diff(velocity, axis=0).transpose(2, 0, 1)) / DT_S
    assert np.quantile(change, 0.99) <= HARD_BRAKE + 1e-9


def test_the_same_seed_walks_the_same_way_and_another_one_does_not() -> None:
    walks = [walked(Crowd(ground(), seed, 3, FAR, courteous=True), FAR, 5.0)[0] for seed in (7, 7, 8)]
    assert np.array_equal(walks[0], walks[1])
    assert not np.array_equal(walks[0], walks[2])


def test_one_foot_rests_while_the_other_swings() -> None:
    crowd = Crowd(ground(), 5, 4, FAR, courteous=True)
    _, velocity, legs = walked(crowd, FAR, 30.0)
    pace = np.hypot(velocity[..., 0], velocity[..., 1])
    steady = (pace[1:] > 0.6) & (np.abs(np.diff(pace, axis=0)) < 1e-6)
    assert steady.sum() > 100
    speed = np.hypot(*np.diff(legs[..., :2], axis=0).transpose(2, 0, 1)) / DT_S
    left, right = speed[:, 0::2][steady], speed[:, 1::2][steady]
    share = pace[1:][steady]
    # At the height of the lidar a standing leg still leans on: 28 % of the pace; a swinging one takes it twice.
    assert np.quantile(np.minimum(left, right) / share, 0.5) < 0.35
    assert np.quantile(np.maximum(left, right) / share, 0.5) > 1.5


def test_legs_stay_under_their_body() -> None:
    crowd = Crowd(ground(), 6, 4, FAR, courteous=True)
    at, _, legs = walked(crowd, FAR, 20.0)
    assert (legs[..., 2] == LEG_RADIUS_M).all()
    reach = np.hypot(*(legs[..., :2] - at.repeat(2, axis=1)).transpose(2, 0, 1))
    assert reach.min() > 0.05
    assert reach.max() < 0.28


def test_courteous_people_go_around_a_standing_robot() -> None:
    robot = robot_at_start()
    nearest = math.inf
    for seed in range(4):
        crowd = Crowd(ground(), seed, 3, robot, courteous=True)
        for _ in range(1000):
            crowd.step(DT_S, robot)
            nearest = min(nearest, float(crowd.gaps(robot).min()))
    assert nearest > 0.0


def test_people_who_ignore_the_robot_run_into_it_and_then_step_back() -> None:
    robot = robot_at_start()
    bumped = 0
    for seed in range(8):
        crowd = Crowd(ground(), seed, 3, robot, courteous=False)
        deepest = math.inf
        for _ in range(1000):
            crowd.step(DT_S, robot)
            deepest = min(deepest, float(crowd.gaps(robot).min()))
        bumped += deepest < 0.0
        assert deepest > -0.05, "nobody walks through a robot"
        assert float(crowd.gaps(robot).min()) > 0.0, "and nobody stays there"
    assert bumped >= 2


def test_every_place_can_be_reached_by_people_and_robot() -> None:
    places = [(float(x), float(y)) for x, y in ground("office").places]
    assert len(places) == PLACES
    for way_m in (PERSON_WAY_M, ROBOT_WAY_M):
        for there in places:
            aim, length = ground("office").aim(way_m, places[0], there)
            assert math.isfinite(length)
            assert length >= math.dist(places[0], there) - 0.3
            assert ground("office").world.clearance(*aim) > way_m - 0.1


def test_room_is_a_lower_bound_of_the_clearance() -> None:
    rng = np.random.default_rng(0)
    plan = ground().world.plan
    x, y = rng.uniform(0.1, plan.width - 0.1, 500), rng.uniform(0.1, plan.depth - 0.1, 500)
    room, truth = ground().room(x, y), ground().world.clearances(x, y)
    assert (room <= truth + 1e-9).all()
    assert (room >= truth - 0.08).all()
    assert [ground().room_at(px, py) for px, py in zip(x, y, strict=True)] == pytest.approx(room.tolist())
    assert ground().room_at(-1.0, 2.0) == 0.0
