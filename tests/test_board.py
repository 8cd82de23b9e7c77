from __future__ import annotations

import math
import time
from dataclasses import replace

import pytest

from ghal360_robot.board import make_board
from ghal360_robot.config import RobotConfig
from ghal360_robot.messages import Command, HeadPose, Lease, Lock, OperatorInput, Stops, Twist
from tests.safety.conftest import scan

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
        replace(GOOD, latency_s=math.nan),
        replace(GOOD, latency_s=-1.0),
        replace(GOOD, latency_s=None),  # type: ignore[arg-type]
        replace(GOOD, holder="x" * 65),
        replace(GOOD, holder=7),  # type: ignore[arg-type]
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


def test_a_message_overtaken_by_a_newer_one_is_refused() -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_operator(replace(GOOD, stamp_ns=9))
    board.put_operator(replace(GOOD, stamp_ns=8, arm_presses=0))
    assert board.operator is not None
    assert board.operator.stamp_ns == 9
    assert board.refused == 1


def test_only_the_holder_of_the_lease_gets_onto_the_board_and_everybody_can_stop() -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_lease(Lease("a", 1))
    driver, other = replace(GOOD, holder="a"), replace(GOOD, holder="b")
    board.put_operator(driver)
    board.put_operator(other)
    assert board.operator is driver
    assert board.stops == Stops()
    board.put_operator(replace(other, disarm_presses=1))
    board.put_operator(replace(other, disarm_presses=1, estop_presses=1))
    board.put_operator(replace(other, disarm_presses=1, estop_presses=1))
    assert board.operator is driver
    assert board.stops == Stops(disarm=1, estop=1)
    board.put_lease(Lease("b", 2))
    board.put_operator(other)
    assert board.operator is other


def test_a_stop_counts_in_a_message_that_makes_no_sense_otherwise() -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_operator(GOOD)
    broken = replace(GOOD, head=HeadPose(yaw=math.nan))
    board.put_operator(broken)
    assert board.stops == Stops()
    board.put_operator(replace(broken, estop_presses=1))
    assert board.stops == Stops(estop=1)
    assert board.operator is GOOD


def test_names_on_the_board_are_bounded() -> None:
    board = make_board(RobotConfig(), 20.0)
    for n in range(100):
        board.put_command(Command(f"source {n}", n, Twist()))
        board.put_lock(Lock(f"lock {n}", n, engaged=True))
        board.put_operator(replace(GOOD, holder=f"holder {n}", estop_presses=1))
    inputs = board.snapshot(5, 0, armed=False)
    assert len(inputs.commands) == len(inputs.locks) == 16
    assert inputs.stops.estop == 100
    assert len(board._bystanders) == 16


def test_a_snapshot_has_the_newest_of_everything_and_the_scan_as_the_base_sees_it() -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_command(Command("test", 1, Twist(0.1, 0.0)))
    board.put_command(Command("test", 2, Twist(0.2, 0.0)))
    board.put_lock(Lock("pause", 3, engaged=False))
    board.put_scan(scan(2.0), 4)
    board.stop()
    inputs = board.snapshot(5, 0, armed=True)
    assert inputs.commands == (Command("test", 2, Twist(0.2, 0.0)),)
    assert inputs.locks == (Lock("pause", 3, engaged=False),)
    assert inputs.stops == Stops(disarm=1)
    assert inputs.surroundings is not None
    assert inputs.surroundings.points[405] == pytest.approx((2.2, 0.0))
    board.withdraw("test")
    board.withdraw("test")
    assert board.snapshot(6, 1, armed=True).commands == ()


@pytest.mark.parametrize("shift_ns", [-1, 10_000_000_000])
def test_a_stop_counts_in_a_message_that_is_refused_as_overtaken_or_from_the_future(shift_ns: int) -> None:
    board = make_board(RobotConfig(), 20.0)
    now_ns = time.monotonic_ns()
    board.put_operator(replace(GOOD, stamp_ns=now_ns))
    board.put_operator(replace(GOOD, stamp_ns=now_ns + shift_ns, estop_presses=1, disarm_presses=1))
    assert board.refused == 1
    assert board.stops == Stops(disarm=1, estop=1)
    assert board.operator is not None
    assert board.operator.stamp_ns == now_ns


def test_a_stop_counts_where_another_message_replaces_it_before_the_tick() -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_operator(replace(GOOD, stamp_ns=6, disarm_presses=1))
    board.snapshot(6, 0, armed=False)
    board.put_operator(replace(GOOD, stamp_ns=7, disarm_presses=1, estop_presses=1))
    board.put_operator(replace(GOOD, stamp_ns=8, disarm_presses=1, estop_presses=1))
    board.put_operator(replace(GOOD, stamp_ns=9))
    assert board.stops == Stops(estop=1)
    board.snapshot(7, 1, armed=False)
    board.put_operator(replace(GOOD, stamp_ns=10, disarm_presses=1))
    board.put_operator(replace(GOOD, stamp_ns=11, disarm_presses=2))
    assert board.stops == Stops(estop=1)
    board.put_operator(replace(GOOD, stamp_ns=12))
    assert board.stops == Stops(disarm=1, estop=1)


@pytest.mark.parametrize("other", [{"found_presses": 1.0}, {"arm_presses": -1}, {"holder": 7}, {"deadman": "no"}])
def test_an_emergency_stop_counts_whatever_else_is_wrong_with_its_message(other: dict[str, object]) -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_operator(GOOD)
    board.put_operator(replace(GOOD, stamp_ns=9, estop_presses=1, **other))  # type: ignore[arg-type]
    assert board.stops.estop == 1
    assert board.operator is GOOD


@pytest.mark.parametrize("count", [-1, 1.5, None, "1", 10**30])
def test_a_stop_count_that_is_no_count_is_a_stop(count: object) -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_operator(replace(GOOD, estop_presses=count))  # type: ignore[arg-type]
    assert board.stops.estop >= 1


@pytest.mark.parametrize(
    "message",
    [
        replace(GOOD, stamp_ns=math.nan),
        replace(GOOD, deadman="false"),
        replace(GOOD, head=None),
        replace(GOOD, stick=(0.1, 0.0)),
    ],
)
def test_what_is_of_the_wrong_kind_is_refused_and_breaks_nothing(message: OperatorInput) -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_operator(message)
    assert board.operator is None
    assert board.refused == 1


def test_commands_and_locks_without_a_proper_stamp_are_refused_and_a_lock_that_cannot_be_kept_stops() -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_command(Command("test", math.nan, Twist(0.1, 0.0)))  # type: ignore[arg-type]
    board.put_command(Command("test", 5, Twist(None, 0.0)))  # type: ignore[arg-type]
    assert board.commands == {}
    for number in range(20):
        board.put_lock(Lock(f"lock {number}", 5, engaged=True))
    assert board.stops.disarm > 0


def test_of_two_messages_with_one_stamp_the_first_counts() -> None:
    board = make_board(RobotConfig(), 20.0)
    board.put_operator(GOOD)
    board.put_operator(replace(GOOD, deadman=False, estop_presses=1))
    assert board.operator is GOOD
    assert board.stops.estop == 1
