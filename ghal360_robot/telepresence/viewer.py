"""One stream of pictures to one page, and how it is going."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import TYPE_CHECKING

from ghal360_robot.telepresence.video_queue import VideoQueue

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ghal360_robot.telepresence.delays import Delays
    from ghal360_robot.telepresence.frames import Frame

RATE_NS = 2_000_000_000


class Viewer:
    """Fed by the stream with `offer`, emptied by the connection with `take`."""

    def __init__(self, delays: Delays, clock: Callable[[], int]) -> None:
        self._delays = delays
        self._clock = clock
        self._queue = VideoQueue()
        self._ready = asyncio.Event()
        self._sent: deque[tuple[int, int]] = deque(maxlen=512)

    @property
    def dropped(self) -> int:
        return self._queue.dropped

    def begin(self, group: Sequence[Frame]) -> None:
        """What the stream showed since its newest key picture: a page that opens need not wait for the next."""
        self._queue.begin(group, self._clock())
        self._ready.set()

    def offer(self, frame: Frame) -> None:
        """One more picture of the stream."""
        if self._queue.offer(frame, self._clock()):
            self._ready.set()

    def shown(self, sequence: int) -> None:
        """The page says that this picture is on the screen: there is room for more on the way."""
        self._queue.shown(sequence, self._clock())
        self._ready.set()

    async def take(self) -> bytes:
        """The next message for the wire; waits for it."""
        while True:
            await self._ready.wait()
            now_ns = self._clock()
            taken = self._queue.take(now_ns)
            if taken is None:
                self._ready.clear()
                continue
            frame, flags = taken
            self._delays.picture(frame.sequence, frame.stamp_ns)
            message = frame.message(flags)
            self._sent.append((now_ns, len(message)))
            return message

    def bit_rate(self, now_ns: int) -> float:
        """Bits per second over the last two seconds."""
        return sum(size for at_ns, size in self._sent if now_ns - at_ns < RATE_NS) * 8e9 / RATE_NS
