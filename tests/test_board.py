from __future__ import annotations

import math
from dataclasses import replace

import pytest

from ghal360_robot.board import make_board
from ghal360_robot.config import RobotConfig
from ghal360_robot.messages import HeadPose, OperatorInput, Twist

GOOD = OperatorInput(5, HeadPose(), deadman=True, stick=Twist(0.1, 0.0), arm_presses=1)


@pytest.mark.parametrize(
    "message",
    [
        replace(GOOD, head=HeadPose(yaw=math.nan)),
        replace(GOOD, head=HeadPose(yaw=math.inf)),
        replace(GOOD, head=HeadPose(pitch=None)),  # type: ignore[arg-type]
        replace(GOOD, head=HeadPose(fov="90")),  # type: ignore[arg-type]
        replace(GOOD, head=HeadPose(yaw=1e300)),
        replace(GOOD, stick=Twist(math.nan, 0.0)),
        replace(GOOD, arm_presses=-1),
        replace(GOOD, estop_presses=1.5),  # type: ignore[arg-type]
        replace(GOOD, found_presses=10**30),
    ],
)
def test_a_message_that_makes_no_sense_is_counted_and_not_taken(message: OperatorInput) -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_operator(GOOD)
    board.put_operator(message)
    assert board.operator is GOOD
    assert board.refused == 1


def test_each_input_ages_by_the_settings_of_its_own() -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_operator(GOOD)
    fresh = board.snapshot(5 + 150_000_000, 0, armed=False).freshness
    stale = board.snapshot(5 + 250_000_000, 0, armed=False).freshness
    assert fresh["operator"].alive
    assert not stale["operator"].alive
    assert fresh["tim571"].age_s == math.inf
