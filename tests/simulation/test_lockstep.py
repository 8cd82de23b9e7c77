from __future__ import annotations

import pytest

from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.simulation.lockstep import Outcome, search
from ghal360_robot.simulation.world import ROBOT_RADIUS_M, TARGETS, build_world

LIMIT_S = 240.0


def searched(world: str, seed: int, target: str) -> Outcome:
    config = with_overrides(RobotConfig(), {"perception": {"target": target}})
    return search(build_world(world, seed, target), config, seed, LIMIT_S)


def check(outcome: Outcome) -> None:
    assert outcome.found
    assert outcome.collisions == 0
    assert outcome.least_clearance_m > ROBOT_RADIUS_M
    assert outcome.cues.get("confirm", 0) >= 1


@pytest.mark.parametrize(
    ("world", "seed", "target"),
    [("office", 0, "backpack"), ("office", 3, "television"), ("home", 4, "backpack"), ("home", 9, "laptop")],
)
def test_brain_and_safety_find_the_target_without_touching_anything(world: str, seed: int, target: str) -> None:
    check(searched(world, seed, target))


def test_the_same_seed_gives_the_same_search() -> None:
    assert searched("home", 9, "laptop") == searched("home", 9, "laptop")


@pytest.mark.campaign
@pytest.mark.parametrize("world", ["office", "home"])
@pytest.mark.parametrize("seed", range(20))
def test_searches_of_many_seeds(world: str, seed: int) -> None:
    check(searched(world, seed, TARGETS[seed % len(TARGETS)]))
