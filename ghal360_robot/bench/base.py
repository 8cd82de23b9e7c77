"""A simulated base on a bus of its own that notes everything which decides about a stop."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Self

from drivers.rmp110.codec.frames import MOTION_ID, Frame, unpack_words, word_to_float
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.socketcand_server import SocketcandServer
from ghal360_robot.bench.trace import Trace

if TYPE_CHECKING:
    from types import TracebackType

STEP_S = 0.01
"""The base's own control tick: its speed changes no faster."""
BOOT_S = 0.3
"""A real one takes nine seconds; nothing measured here depends on it."""


class TracedBase:
    """An RMP-110 behind a socketcand server on loopback; `trace` holds what it heard and how fast it was."""

    def __init__(self) -> None:
        self.trace = Trace()
        self._model = RmpModel(time.monotonic_ns(), boot_s=BOOT_S)
        self._server = SocketcandServer("can0")
        self._answers = True
        self._ticking: asyncio.Task[None] | None = None

    @property
    def port(self) -> int:
        return self._server.port

    def lose_feedback(self) -> None:
        """From now on the base hears and obeys, but what it says is lost."""
        self._answers = False

    def lose_bus(self) -> None:
        """From now on nothing passes in either direction, and whoever is on the bus learns of it."""
        self._server.plug(plugged=False)

    async def __aenter__(self) -> Self:
        await self._server.open(self._hear)
        self._ticking = asyncio.create_task(self._tick(), name="traced base")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._ticking is not None:
            self._ticking.cancel()
            await asyncio.wait({self._ticking})
        await self._server.close()

    def _hear(self, stamp_ns: int, frame: Frame) -> None:
        if frame.can_id == MOTION_ID and len(frame.data) == 8:
            self.trace.motion.append((stamp_ns, any(word_to_float(word) for word in unpack_words(frame.data))))
        reply = self._model.receive(stamp_ns, frame)
        if self._answers:
            self._server.send(reply)

    async def _tick(self) -> None:
        while True:
            now_ns = time.monotonic_ns()
            self._model.step(now_ns)
            self.trace.speeds.append((now_ns, self._model.twist[0]))
            await asyncio.sleep(STEP_S)
