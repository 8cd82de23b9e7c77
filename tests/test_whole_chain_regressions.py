"""What the whole-chain machine found, as plain sequences."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import pytest

from drivers.rmp110.codec.parameters import OperationalState
from ghal360_robot.messages import HeadPose, OperatorInput, Twist
from tests.virtual_time.clock import Clock, run
from tests.virtual_time.stage import Stage

Play = Callable[[Stage], Awaitable[None]]
FORWARD = Twist(0.4, 0.0)


def judged(play: Play) -> list[str]:
    """What the judge says about a robot that drives and to which this then happens."""

    async def main() -> list[str]:
        stage = Stage(clock)
        await stage.open()
        await stage.armed_and_driving(FORWARD, 1.0)
        assert stage.checker.moving, "it has to drive first"
        assert stage.problems() == []
        await play(stage)
        problems = stage.problems()
        await stage.close()
        return problems + stage.problems()

    clock = Clock()
    return run(main(), clock)


def test_a_drive_without_trouble_has_nothing_to_complain_about() -> None:
    async def play(stage: Stage) -> None:
        await stage.run(2.0)

    assert judged(play) == []


async def by_gaze(stage: Stage) -> None:
    stage.hands.stick = None
    moving = stage.checker.moving
    await stage.run(3.0)
    assert stage.checker.moving > moving + 50, "it has to drive where the operator looks"


def message(stage: Stage, shift_s: float, *, deadman: bool = True, estop: int = 0) -> OperatorInput:
    stamp_ns = stage.clock.now_ns + round(shift_s * 1e9)
    return OperatorInput(stamp_ns, HeadPose(), deadman, None, stage.hands.arm, 0, estop)


def test_an_emergency_stop_counts_even_in_a_message_that_was_overtaken() -> None:
    async def play(stage: Stage) -> None:
        stage.message(message(stage, -0.1, estop=1))
        stage.witness.revoke("emergency stop", presses=2)
        await stage.run(0.02)
        stage.checker.violations.clear()  # the loop had to see it first
        await stage.run(0.5)

    assert judged(play) == []


def test_an_emergency_stop_counts_even_where_another_message_follows_before_the_tick() -> None:
    async def play(stage: Stage) -> None:
        stage.message(message(stage, 0.0, estop=1))
        stage.message(message(stage, 0.0))
        await stage.run(0.02)
        stage.checker.violations.clear()
        await stage.run(0.5)

    assert judged(play) == []


def test_a_message_from_the_future_is_no_sign_of_life_for_longer_than_any_other() -> None:
    async def play(stage: Stage) -> None:
        await by_gaze(stage)
        stage.hands.sending = False
        stage.message(message(stage, 10.0))
        await stage.run(2.0)

    assert judged(play) == []


def test_a_base_that_leaves_tractor_soon_after_arming_is_not_driven_again_without_a_new_press() -> None:
    async def play(stage: Stage) -> None:
        moving = stage.checker.moving
        stage.bus.step()
        stage.bus.model.state = OperationalState.STANDBY
        await stage.run(1.0)
        assert stage.checker.moving <= moving + 3

    judged(play)


def test_two_senders_of_one_name_do_not_arm_the_robot_by_taking_turns() -> None:
    async def play(stage: Stage) -> None:
        assert stage.chain
        stage.hands.sending = False
        stage.chain.board.put_operator(OperatorInput(stage.clock.now_ns, HeadPose(), True, FORWARD, 0, 0, 0))
        stage.witness.revoke("somebody else was at the controls")
        await stage.run(0.02)
        stage.checker.violations.clear()  # the loop had to see it first
        stage.hands.sending = True
        await stage.run(1.0)

    assert judged(play) == []


def test_after_a_blocked_loop_the_robot_starts_from_standstill_again() -> None:
    async def play(stage: Stage) -> None:
        stage.clock.busy(0.25)
        await stage.run(0.5)

    assert judged(play) == []


@pytest.mark.parametrize("seconds", [0.25, 0.6, 2.0])
def test_a_blocked_loop_leaves_no_command_standing_for_longer_than_the_deadline(seconds: float) -> None:
    async def play(stage: Stage) -> None:
        stage.clock.busy(seconds)
        stage.checker.look(stage.clock.seconds())

    assert judged(play) == []
