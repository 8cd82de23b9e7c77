"""The pictures that wait for one connection: few, young, and never one whose predecessors were dropped. Pure."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ghal360_robot.telepresence.frames import Frame

MAX_FRAMES = 8
"""A quarter of a second at 30 Hz: what waits longer is no live picture."""

MAX_BYTES = 4 << 20
"""Two 4K key pictures."""

MAX_AGE_NS = 350_000_000
"""Of the oldest picture that waits."""

MAX_UNSEEN_NS = 600_000_000
"""Nothing more is sent while a picture sent so long ago is not shown: it waits in somebody's buffers on the way."""

RETRY_NS = 2_000_000_000
"""A page that shows nothing (its tab is hidden) is sent one key picture in so long, to hear whether it does again."""


class VideoQueue:
    """Takes every picture of a stream, gives those that this connection should be sent.

    Whatever is dropped is dropped up to the next key picture: a decoder that misses one picture shows nonsense
    until then. Instants come from the caller.
    """

    def __init__(self) -> None:
        self._waiting: deque[Frame] = deque()
        self._bytes = 0
        self._joining = True
        """Nothing but a key picture may come next."""
        self._gap = False
        self._unseen: deque[tuple[int, int]] = deque(maxlen=1024)
        """Sequence and instant of sending of what was sent and is not known to be shown."""
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def offer(self, frame: Frame, now_ns: int) -> bool:
        """Take one more picture; False where it, and all that waited, had to be dropped."""
        if frame.key:
            self._drop_waiting()  # a key picture makes everything before it superfluous
            self._joining = self._congested(now_ns)
        elif not self._joining and self._too_much(frame, now_ns):
            self._drop_waiting()
            self._joining = True
        if self._joining:
            self.dropped += 1
            self._gap = True
            return False
        self._waiting.append(frame)
        self._bytes += len(frame.data)
        return True

    def take(self, now_ns: int) -> tuple[Frame, bool] | None:
        """The next picture to send and whether some before it were dropped; None where nothing waits."""
        if self._waiting and not self._waiting[0].key and now_ns - self._waiting[0].stamp_ns > MAX_AGE_NS:
            self._drop_waiting()
            self._joining = True
        if not self._waiting:
            return None
        frame = self._waiting.popleft()
        self._bytes -= len(frame.data)
        gap, self._gap = self._gap, False
        self._unseen.append((frame.sequence, now_ns))
        return frame, gap

    def shown(self, sequence: int) -> None:
        """The page says that this picture is on the screen, and with it everything before."""
        while self._unseen and self._unseen[0][0] <= sequence:
            self._unseen.popleft()

    def _too_much(self, frame: Frame, now_ns: int) -> bool:
        if len(self._waiting) >= MAX_FRAMES or self._bytes + len(frame.data) > MAX_BYTES:
            return True
        oldest_ns = self._waiting[0].stamp_ns if self._waiting else now_ns
        return now_ns - oldest_ns > MAX_AGE_NS or self._congested(now_ns)

    def _congested(self, now_ns: int) -> bool:
        if self._unseen and now_ns - self._unseen[-1][1] > RETRY_NS:
            self._unseen.clear()
        return bool(self._unseen) and now_ns - self._unseen[0][1] > MAX_UNSEEN_NS

    def _drop_waiting(self) -> None:
        if self._waiting:
            self.dropped += len(self._waiting)
            self._gap = True
            self._waiting.clear()
            self._bytes = 0
