from __future__ import annotations

from dataclasses import replace

import pytest

from ghal360_robot.journal import Journal
from ghal360_robot.messages import (
    STILL,
    Applied,
    ArmState,
    BaseMode,
    BaseState,
    Cue,
    Decision,
    Inputs,
    Pose2,
    Twist,
)
from tests.safety.conftest import inputs

NOTHING = Decision(Cue.NONE, None, (0,) * 8, None, (0.125,) * 8, None, STILL, ())
ARMED = Applied(STILL, ArmState.ARMED, ())
DISARMED = Applied(STILL, ArmState.DISARMED, ("lidar lost",))


def at(n: int, x: float = 0.0, found: int = 0) -> Inputs:
    tick = inputs(n)
    assert tick.operator is not None
    return replace(
        tick,
        base=BaseState(tick.stamp_ns, BaseMode.DRIVE, Pose2(x), Twist(), 90.0),
        operator=replace(tick.operator, found_presses=found),
    )


def test_distance_adds_up_and_a_reset_of_the_odometry_is_no_drive() -> None:
    journal = Journal(0)
    for n, x in enumerate([0.0, 0.01, 0.02, 5.0, 5.01]):
        journal.observe(at(n, x), NOTHING, ARMED)
    assert journal.distance_m == pytest.approx(0.03)


def test_cues_are_counted_when_they_come_up() -> None:
    journal = Journal(0)
    for n, cue in enumerate([Cue.NONE, Cue.LEFT, Cue.LEFT, Cue.NONE, Cue.LEFT, Cue.CONFIRM]):
        journal.observe(at(n), replace(NOTHING, cue=cue), ARMED)
    assert journal.cues == {"left": 2, "confirm": 1}


def test_a_stop_is_noted_with_its_time_and_reason() -> None:
    journal = Journal(0)
    for n, applied in enumerate([DISARMED, ARMED, ARMED, DISARMED, DISARMED, ARMED]):
        journal.observe(at(n), NOTHING, applied)
    assert journal.arms == 2
    assert journal.stops == [{"t_s": 0.06, "reason": "lidar lost"}]


def test_found_is_the_first_press_after_the_start() -> None:
    journal = Journal(0)
    for n, presses in enumerate([4, 4, 5, 6]):
        journal.observe(at(n, found=presses), NOTHING, ARMED)
    assert journal.seconds_to_found == 0.04
