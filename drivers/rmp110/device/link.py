"""One connection to one base: sending, receiving, waiting, and the first thing that goes wrong."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Literal

from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame
from drivers.rmp110.codec.v3.packets import POWERING_DOWN
from drivers.rmp110.errors import RmpError, RmpForeignCommands, RmpLinkError, RmpPoweringDown, RmpSendDropped
from drivers.rmp110.transport.base import Guard, Guarded, Transport

log = logging.getLogger(__name__)

Direction = Literal["rx", "tx"]
FrameHook = Callable[[int, Direction, int, bytes], None]
"""Called with stamp_ns, direction, id and data of every frame, both ways, for the recorder; must not raise."""
Clock = Callable[[], int]
"""Nanoseconds of `time.monotonic_ns`, or of whatever time the event loop lives in."""

REPLY_S = 0.1
"""A reply comes within 10 ms; one that is not there after ten times that is lost."""

FOREIGN = (
    "another program or panel commands this base (id 0x{:X} on the bus): stop it, then motion can be enabled again"
)
ENDINGS: Mapping[int, tuple[type[RmpLinkError], str]] = {
    MOTION_ID: (RmpForeignCommands, FOREIGN),
    CONFIG_ID: (RmpForeignCommands, FOREIGN),
    POWERING_DOWN: (RmpPoweringDown, "the base says that it switches off; press its power button to use it again"),
}
"""Received frames after which nothing more is to be said on a link, by id."""


class Link:
    """Frames go to `consumer`; the first failure ends the link and is raised by every wait."""

    def __init__(self, transport: Transport, hook: FrameHook | None, clock: Clock = time.monotonic_ns) -> None:
        self._transport = transport
        self._hook = hook
        self.clock = clock
        self._changed = asyncio.Event()
        self._error: RmpError | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._awaited: deque[int] = deque(maxlen=256)
        self.consumer: Callable[[int, Frame], None] = _ignore
        self.expects_replies = True
        """Whether every accepted frame asks for one packet, so that missing ones can be counted."""
        self.last_sent_ns = 0
        self.lost = 0
        self.dropped = 0

    async def open(self) -> None:
        """Raises RmpInterfaceError."""
        self._loop = asyncio.get_running_loop()
        await self._transport.open(self._receive, lambda reason: self.fail(RmpLinkError(reason)))

    async def close(self) -> None:
        self.consumer = _ignore
        await self._transport.close()

    def allow(self, guard: Guard) -> None:
        """From now on only what this lets pass may leave, where the transport carries several dialects."""
        if isinstance(self._transport, Guarded):
            self._transport.guard = guard

    @property
    def damaged(self) -> int:
        return self._transport.damaged

    def send(self, frame: Frame) -> None:
        """Put a frame on the wire, now or never.

        Raises RmpSendDropped (counted), RmpLinkError (the link has ended).
        """
        if self._error is not None:
            raise self._error
        try:
            self._transport.send(frame)
        except RmpSendDropped:
            self.dropped += 1
            raise
        except RmpLinkError as error:
            self.fail(error)
            raise
        self._sent(self.clock(), frame)

    def try_send(self, frame: Frame) -> bool:
        """Send where possible; a dropped or impossible frame is counted, not raised."""
        try:
            self.send(frame)
        except (RmpSendDropped, RmpLinkError):
            return False
        return True

    def send_aside(self, frame: Frame) -> bool:
        """Send from another thread while the loop may be stuck; the loop takes note when it comes back."""
        try:
            self._transport.send(frame)
        except (RmpSendDropped, RmpLinkError) as error:
            log.warning("%s", error)
            return False
        if self._loop is not None:
            try:
                self._loop.call_soon_threadsafe(self._sent, self.clock(), frame)
            except RuntimeError:
                log.debug("event loop closed, a last frame was sent unrecorded")
        return True

    def farewell(self, frame: Frame) -> None:
        """A last frame on a link that has already ended, if the bus still takes it."""
        try:
            self._transport.send(frame)
        except (RmpSendDropped, RmpLinkError):
            return
        if self._hook:
            self._hook(self.clock(), "tx", frame.can_id, frame.data)

    def answered(self) -> None:
        """A packet arrived whole: the oldest request has its answer.

        More answers than open requests: one that was counted as lost had only been held up.
        """
        if self._awaited:
            self._awaited.popleft()
        elif self.lost:
            self.lost -= 1
        self.wake()

    def count_lost(self, now_ns: int) -> None:
        """Requests that will not be answered any more are lost."""
        while self._awaited and now_ns - self._awaited[0] > REPLY_S * 1e9:
            self._awaited.popleft()
            self.lost += 1

    def forget_requests(self) -> None:
        self._awaited.clear()

    def wake(self) -> None:
        """Let every wait look at its condition again."""
        self._changed.set()

    def fail(self, error: RmpError) -> None:
        """End the link; the first reason counts."""
        if self._error is None:
            self._error = error
        self.wake()

    async def wait(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Until the condition holds (True) or time is up (False). Raises what ended the link."""
        deadline_ns = self.clock() + round(timeout_s * 1e9)
        while True:
            if self._error is not None:
                raise self._error
            if condition():
                return True
            remaining_ns = deadline_ns - self.clock()
            if remaining_ns <= 0:
                return False
            self._changed.clear()
            try:
                async with asyncio.timeout(remaining_ns / 1e9):
                    await self._changed.wait()
            except TimeoutError:
                continue

    async def pause(self, duration_s: float) -> None:
        """Wait, unless the link ends: then raise why."""
        await self.wait(lambda: False, duration_s)

    def _sent(self, stamp_ns: int, frame: Frame) -> None:
        self.last_sent_ns = stamp_ns
        if self.expects_replies:
            self._awaited.append(stamp_ns)
        if self._hook:
            self._hook(stamp_ns, "tx", frame.can_id, frame.data)

    def _receive(self, stamp_ns: int, frame: Frame) -> None:
        if self._hook:
            self._hook(stamp_ns, "rx", frame.can_id, frame.data)
        if frame.can_id in ENDINGS:
            error, sentence = ENDINGS[frame.can_id]
            self.fail(error(sentence.format(frame.can_id)))
            return
        self.consumer(stamp_ns, frame)


def _ignore(_stamp_ns: int, _frame: Frame) -> None:
    return None
