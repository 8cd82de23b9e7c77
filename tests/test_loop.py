from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import dataclass, field
from typing import Any

import pytest

from ghal360_robot.assembly import make_brain, make_safety
from ghal360_robot.board import make_board
from ghal360_robot.brain import BrainState
from ghal360_robot.config import RobotConfig
from ghal360_robot.loop import ControlLoop
from ghal360_robot.messages import (
    STILL,
    Applied,
    ArmState,
    BaseMode,
    BaseState,
    HeadPose,
    OperatorInput,
    Pose2,
    Twist,
)
from ghal360_robot.safety.chain import SafetyState
from ghal360_robot.systemd import Notifier
from tests.safety.conftest import scan


@dataclass
class Witness:
    """Stands for base and logbook, and remembers the order of what it was told."""

    told: list[tuple[str, Any]] = field(default_factory=list)
    block_s: float = 0.0

    def apply(self, applied: Applied) -> None:
        self.told.append(("base", applied))

    def tick(self, inputs: object, decision: object, applied: object, *, lateness_ms: float, work_ms: float) -> None:
        self.told.append(("log", lateness_ms))
        time.sleep(self.block_s)


def loop_of(witness: Witness, notifier: Notifier | None = None) -> ControlLoop:
    config = RobotConfig()
    return ControlLoop(
        board=make_board(config, 20.0),
        brain=make_brain(config),
        safety=make_safety(config),
        actuator=witness,
        log=witness,
        notifier=notifier or Notifier(None, 0),
        rate_hz=50.0,
        brain_state=BrainState(),
        safety_state=SafetyState(),
    )


def feed(loop: ControlLoop, presses: int) -> None:
    """Everything fresh and healthy, the dead man held, a stick forward."""
    now = time.monotonic_ns()
    board = loop.board
    board.put_base(BaseState(now, BaseMode.DRIVE, Pose2(), Twist(), 90.0))
    board.put_scan(scan(stamp_ns=now), now)
    board.put_picture(now)
    board.put_operator(OperatorInput(now, HeadPose(), deadman=True, stick=Twist(0.3, 0.0), arm_presses=presses))


async def run_for(loop: ControlLoop, ticks: int) -> None:
    stop = asyncio.Event()
    loop.on_tick = lambda *_: stop.set() if loop.ticks >= ticks else None
    await loop.run(stop)


def test_the_base_is_told_before_the_logbook() -> None:
    witness = Witness()
    loop_of(witness).tick(0.0)
    assert [who for who, _ in witness.told] == ["base", "log"]


def test_without_inputs_the_base_is_told_to_stand_still() -> None:
    witness = Witness()
    loop_of(witness).tick(0.0)
    applied = witness.told[0][1]
    assert applied.twist == STILL
    assert applied.arm is ArmState.DISARMED


def test_arming_and_losing_is_said_once_each_with_its_reason(caplog: pytest.LogCaptureFixture) -> None:
    witness = Witness()
    loop = loop_of(witness)
    with caplog.at_level(logging.INFO):
        feed(loop, 0)
        loop.tick(0.0)
        for _ in range(5):
            feed(loop, 1)
            loop.tick(0.0)
        armed = witness.told[-2][1]
        loop.board.valid["tim571"] = False
        loop.tick(0.0)
        loop.tick(0.0)
    assert armed.arm is ArmState.ARMED
    assert armed.twist.v > 0
    said = [record.getMessage() for record in caplog.records]
    assert said.count("armed by the operator") == 1
    assert said.count("stopped: lidar not valid") == 1
    assert witness.told[-2][1].twist == STILL


async def test_ticks_that_cannot_be_run_are_counted_and_said(caplog: pytest.LogCaptureFixture) -> None:
    witness = Witness(block_s=0.07)
    loop = loop_of(witness)
    await run_for(loop, 3)
    assert loop.lateness.skipped >= 6
    said = [record.args for record in caplog.records if "ticks skipped" in record.getMessage()]
    assert sum(int(args[0]) for args in said if isinstance(args, tuple)) == loop.lateness.skipped


async def test_the_schedule_is_absolute() -> None:
    witness = Witness()
    loop = loop_of(witness)
    began = time.monotonic()
    await run_for(loop, 50)
    elapsed = time.monotonic() - began
    assert elapsed == pytest.approx((loop.ticks + loop.lateness.skipped) / 50.0, abs=0.1)
