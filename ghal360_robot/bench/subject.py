"""The measured process: a whole robot with a scripted operator, who does what the test stand's pipe says.

Started by `subject_process.SubjectProcess`. Reads one JSON object with ports and folder, then one order a
line; writes one JSON object a line. Ends when its standard input does, so that nobody is left behind.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import signal
import sys
import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ghal360_robot.bench.stand import CAMERA_HZ
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.errors import GhalError
from ghal360_robot.messages import STILL, HeadPose, OperatorInput, Twist
from ghal360_robot.robot import Robot

if TYPE_CHECKING:
    from ghal360_robot.messages import Applied

PERIOD_S = 0.05
"""Twenty messages a second, as the page sends them."""
SPEED_MPS = 0.45
"""A tenth below the base's limit, so that what is measured is no clamp."""
BLOCK_S = 2.0
WATCH_S = 0.01
"""How late a changed reason is told; nothing is measured by it."""

logger = logging.getLogger(__name__)


class Order(StrEnum):
    """What the scripted operator, or the process, is told to do; each is answered by the instant it was done."""

    FALL_SILENT = "fall-silent"
    """Answered by the instant of the last message."""
    PRESS_ESTOP = "press-estop"
    BLOCK_LOOP = "block-loop"
    """Hold the event loop up for two seconds, as a call that should have been in a thread does."""


def say(**values: Any) -> None:
    """One line to the test stand, from any thread: short enough to be written whole."""
    os.write(sys.stdout.fileno(), json.dumps(values).encode() + b"\n")


class ScriptedOperator:
    """Arms with a fresh press as soon as the robot is ready, then holds the stick forward."""

    rate_hz = 1.0 / PERIOD_S

    def __init__(self) -> None:
        self._robot: Robot | None = None
        self._silent = False
        self._sent_ns = 0
        self._arm_presses = 0
        self._estop_presses = 0

    async def run(self, robot: Robot) -> None:
        self._robot = robot
        while True:
            if not self._silent:
                if robot.journal.arms == 0 and not robot.not_ready():
                    self._arm_presses += 1
                self._send()
            await asyncio.sleep(PERIOD_S)

    def obey(self, order: Order) -> None:
        """Carry out an order and say when that was."""
        if order is Order.FALL_SILENT:
            self._silent = True
            say(struck=self._sent_ns)
        elif order is Order.PRESS_ESTOP:
            self._estop_presses += 1
            self._send()
            say(struck=self._sent_ns)
        else:
            say(struck=time.monotonic_ns())
            time.sleep(BLOCK_S)

    def _send(self) -> None:
        if self._robot is None:
            return
        self._sent_ns = time.monotonic_ns()
        self._robot.board.put_operator(
            OperatorInput(
                self._sent_ns,
                HeadPose(),
                deadman=True,
                stick=Twist(SPEED_MPS, 0.0),
                arm_presses=self._arm_presses,
                estop_presses=self._estop_presses,
            )
        )


class _Telling(logging.Handler):
    """Warnings of the robot, told to the test stand: a blocked loop is reported by another thread."""

    def emit(self, record: logging.LogRecord) -> None:
        say(said=record.getMessage()[:300], t=time.monotonic_ns())


async def _tell_reasons(robot: Robot) -> None:
    """Say why the robot stands still whenever that changes."""
    before: Applied | None = None
    while True:
        newest = robot.loop.newest
        if newest is not None:
            applied = newest[2]
            changed = before is None or (applied.arm, applied.reasons) != (before.arm, before.reasons)
            if applied.twist == STILL and changed:
                say(said=", ".join(applied.reasons)[:300], t=newest[0].stamp_ns)
            before = applied
        await asyncio.sleep(WATCH_S)


async def _listen(lines: asyncio.StreamReader, operator: ScriptedOperator, stop: asyncio.Event) -> None:
    while line := await lines.readline():
        operator.obey(Order(line.decode().strip()))
    stop.set()


async def _be_robot() -> None:
    lines = asyncio.StreamReader()
    running = asyncio.get_running_loop()
    await running.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    stand = json.loads(await lines.readline())
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        running.add_signal_handler(number, stop.set)
    operator = ScriptedOperator()
    robot = Robot(_config(stand), operator, Path(stand["record_to"]))
    listening = asyncio.create_task(_listen(lines, operator, stop))
    robot_running = asyncio.create_task(robot.run(stop))
    started = asyncio.create_task(robot.started.wait())
    await asyncio.wait({robot_running, started}, return_when=asyncio.FIRST_COMPLETED)
    telling = asyncio.create_task(_tell_reasons(robot)) if started.done() else started
    try:
        await robot_running
    finally:
        for task in (listening, telling, started):
            task.cancel()


def _config(stand: dict[str, Any]) -> RobotConfig:
    return with_overrides(
        RobotConfig(),
        {
            "theta": {"transport": "usbip", "host": "127.0.0.1", "port": stand["theta"], "rate_hz": CAMERA_HZ},
            "tim571": {"host": "127.0.0.1", "port": stand["tim571"]},
            "rmp110": {"interface": "socketcand", "channel": "can0", "host": "127.0.0.1", "port": stand["rmp110"]},
        },
    )


def main() -> None:
    logging.basicConfig(level=logging.WARNING, handlers=[_Telling(logging.WARNING)])
    try:
        asyncio.run(_be_robot())
    except GhalError as error:
        say(said=str(error)[:300], t=time.monotonic_ns())
        sys.exit(error.exit_status)


if __name__ == "__main__":
    main()
