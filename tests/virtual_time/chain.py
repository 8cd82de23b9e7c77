"""The robot's own way from an operator's message to a CAN frame: board, brain, safety chain, loop, base output.

Everything is the robot's code but the transport and the clock.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Any

from drivers.rmp110.device.rmp110 import Rmp110
from drivers.rmp110.device.watchdog import Watchdog
from ghal360_robot.assembly import make_brain, make_safety
from ghal360_robot.board import Board, make_board
from ghal360_robot.brain import BrainState
from ghal360_robot.config import RobotConfig
from ghal360_robot.hardware.base import BaseOutput, driver_config
from ghal360_robot.loop import ControlLoop
from ghal360_robot.safety.chain import SafetyState
from ghal360_robot.systemd import Notifier
from tests.virtual_time.clock import Clock
from tests.virtual_time.wire import VirtualBus

OPERATOR_HZ = 20.0


class Unheard:
    """Stands for the logbook: takes everything, keeps nothing."""

    def __getattr__(self, name: str) -> Any:
        return lambda *_args, **_named: None


class TickedWatchdog(Watchdog):
    """The driver's watchdog without its thread: it looks whenever the event loop is busy."""

    def __init__(self, zero: Callable[[], bool], read: Callable[[], int], clock: Clock) -> None:
        super().__init__(zero, read)
        self._threads = clock.threads

    def start(self) -> None:
        self._threads.append(self.check)

    def stop(self) -> None:
        if self.check in self._threads:
            self._threads.remove(self.check)


class Chain:
    """One robot process from start to its end, orderly or not."""

    def __init__(self, bus: VirtualBus, config: RobotConfig) -> None:
        self._bus = bus
        self._config = config
        self._stack = AsyncExitStack()
        self._tasks: list[asyncio.Task[Any]] = []
        self._stop = asyncio.Event()
        self.board: Board = make_board(config, OPERATOR_HZ)
        self.loop: ControlLoop
        self.base: BaseOutput

    async def start(self) -> None:
        clock = self._bus.clock
        unheard: Any = Unheard()
        device = Rmp110(
            self._bus.transport,
            driver_config(self._config.rmp110, self._config.safety),
            unheard.can_frame,
            clock=clock.read,
            watchdog=lambda zero, read: TickedWatchdog(zero, read, clock),
        )
        self.base = BaseOutput(self._config.rmp110, self._config.safety, self.board, unheard, device)
        await self.base.enter(self._stack)
        self.loop = ControlLoop(
            board=self.board,
            brain=make_brain(self._config),
            safety=make_safety(self._config),
            actuator=self.base,
            log=Unheard(),
            notifier=Notifier(None, 0),
            rate_hz=self._config.control.rate_hz,
            brain_state=BrainState(),
            safety_state=SafetyState(),
        )
        self._tasks = [
            asyncio.create_task(self.base.run(), name="rmp110 states"),
            asyncio.create_task(self.loop.run(self._stop), name="control loop"),
        ]

    @property
    def streaming(self) -> bool:
        return self.base.stats().link == "streaming"

    def failures(self) -> list[str]:
        """Tasks that ended by themselves: each is a crash of the robot."""
        return [f"{task.get_name()} ended: {task.exception()!r}" for task in self._tasks if task.done()]

    async def stop(self) -> None:
        """As the service does it: the loop first, then the base to zero and standby."""
        self._stop.set()
        await asyncio.wait({self._tasks[1]})
        await self._stack.aclose()
        await asyncio.wait(self._tasks, timeout=1.0)
        self._tasks = []

    async def kill(self) -> None:
        """The process is gone at once; nothing more reaches the wire."""
        self._bus.disconnect()
        for task in self._tasks:
            task.cancel()
        await asyncio.wait(self._tasks)
        self._tasks = []
        with contextlib.suppress(Exception):
            await self._stack.aclose()
