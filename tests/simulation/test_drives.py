from __future__ import annotations

from functools import cache

import pytest

from ghal360_robot.assembly import make_safety
from ghal360_robot.config import RobotConfig
from ghal360_robot.messages import Applied, ArmState, Inputs, Twist
from ghal360_robot.safety.chain import Safety, SafetyState
from ghal360_robot.safety.limits import clamp
from ghal360_robot.simulation import drives
from ghal360_robot.simulation.drive_judge import Fault
from ghal360_robot.simulation.drives import Outcome, drive_of, run
from ghal360_robot.simulation.random_driver import STYLES

SECONDS = 12.0
NUMBERS = (1, 7, 23, 39, 40, 59, 69, 89)
"""Each of these ran into somebody, the first into a wall, when the chain looked neither behind nor at who moves."""


@cache
def outcome_of(number: int) -> Outcome:
    return run(drive_of(number, SECONDS), RobotConfig())


TURNED_TOWARDS = 139
"""Somebody at the side whom an arc would have brought in front of the robot."""


@pytest.mark.parametrize("number", [*NUMBERS, TURNED_TOWARDS])
def test_a_random_drive_hurts_nobody_and_never_gets_stuck(number: int) -> None:
    outcome = outcome_of(number)
    assert outcome.count(Fault.OWN_MOTION) == 0, outcome
    assert outcome.stuck == (), outcome


def test_random_drives_go_somewhere() -> None:
    outcomes = [outcome_of(number) for number in NUMBERS]
    assert sum(outcome.distance_m for outcome in outcomes) > 0.5 * len(NUMBERS)
    assert sum(outcome.moved_s for outcome in outcomes) > 0.4 * sum(outcome.asked_s for outcome in outcomes)
    assert all(outcome.asked_s > 0.6 * SECONDS for outcome in outcomes)
    assert 0.0 < max(outcome.odometry_off_m for outcome in outcomes) < 0.2


def test_a_number_is_a_drive() -> None:
    assert run(drive_of(1003, 4.0), RobotConfig()) == run(drive_of(1003, 4.0), RobotConfig())
    drawn = [drive_of(number) for number in range(400)]
    assert {drive.world for drive in drawn} == {"office", "home"}
    assert {drive.style for drive in drawn} == set(STYLES)
    assert {drive.people for drive in drawn} == {1, 2, 3, 4}
    assert 100 < sum(drive.courteous for drive in drawn) < 300


class NoMonitor(Safety):
    """A chain that knows its limits but looks at nothing."""

    def step(self, state: SafetyState, inputs: Inputs, wanted: Twist) -> tuple[SafetyState, Applied]:
        state, applied = super().step(state, inputs, wanted)
        if applied.arm is not ArmState.ARMED:
            return state, applied
        asked = inputs.operator.stick if inputs.operator is not None and inputs.operator.stick is not None else wanted
        return state, Applied(clamp(asked, self.limits)[0], applied.arm, ())


def test_without_a_collision_monitor_the_same_drives_end_in_collisions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drives, "make_safety", lambda config: NoMonitor(make_safety(config).limits))
    outcomes = [run(drive_of(number, 10.0), RobotConfig()) for number in NUMBERS[:3]]
    assert sum(outcome.count(Fault.OWN_MOTION) for outcome in outcomes) >= 2
