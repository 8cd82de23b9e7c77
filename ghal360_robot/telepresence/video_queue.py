"""The pictures that wait for one connection: few, young, and never one whose predecessors were dropped. Pure.

A link's own buffers hold seconds of video before a sender notices anything. So no more bytes are let onto the way than
the link was seen to deliver in a fraction of a second, as the page's word of what it shows tells (delivery rate as in
TCP BBR, RFC draft-cheng-iccrg-delivery-rate-estimation).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.telepresence.frames import Flags

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ghal360_robot.telepresence.frames import Frame

MAX_FRAMES = 8
"""A quarter of a second at 30 Hz: what waits longer is no live picture."""

MAX_BYTES = 4 << 20
"""Two 4K key pictures."""

MAX_AGE_NS = 250_000_000
"""Of the oldest picture that waits."""

CATCH_UP_NS = 500_000_000
"""A connection that begins in the middle of a group has so long to be sent it; on average the next one is as near."""

ON_THE_WAY_S = 0.45
"""So much of what the link delivers may be on its way at once: the delay that its buffers can add."""

FIRST_WINDOW_BYTES = 510_000
"""On the way before anything is known of the link; three 2K pictures, half a second at 1 MB/s."""

RATE_MEMORY_NS = 5_000_000_000
"""The best rate of so long counts: a Wi-Fi that got worse is noticed after that, by its delay at once."""

MAX_UNSEEN_NS = 600_000_000
"""Nothing more is sent while a picture sent so long ago is not shown."""

RETRY_NS = 2_000_000_000
"""A page that shows nothing (its tab is hidden) is sent one key picture in so long, to hear whether it does again."""


@dataclass(frozen=True, slots=True)
class Sent:
    """One picture on its way, and how much had been delivered, and when last, as it was sent."""

    sequence: int
    size: int
    sent_ns: int
    delivered: int
    delivered_ns: int


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
        self._behind_until_ns = 0
        """Until then what waits may be old and much: a group that had begun before the connection."""
        self._sent: deque[Sent] = deque()
        """What is not known to be shown."""
        self._on_the_way = 0
        self._delivered = 0
        self._delivered_ns = 0
        self._rates: deque[tuple[int, float]] = deque(maxlen=256)
        """When, and bytes a second."""
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._waiting)

    def begin(self, group: Sequence[Frame], now_ns: int) -> None:
        """Send first what a decoder needs to go on: the newest key picture and all since, or nothing."""
        self._waiting.extend(group)
        self._bytes = sum(len(frame.data) for frame in group)
        self._joining = not group
        self._behind_until_ns = now_ns + CATCH_UP_NS if group else 0

    def offer(self, frame: Frame, now_ns: int) -> bool:
        """Take one more picture; False where it, and all that waited, had to be dropped."""
        if frame.key:
            self._drop_waiting()  # a key picture makes everything before it superfluous
            self._behind_until_ns = 0
            self._joining = self._congested(now_ns)
        elif not self._joining and not self._behind(now_ns) and self._too_much(frame, now_ns):
            self._drop_waiting()
            self._joining = True
        if self._joining:
            self.dropped += 1
            self._gap = True
            return False
        self._waiting.append(frame)
        self._bytes += len(frame.data)
        return True

    def take(self, now_ns: int) -> tuple[Frame, Flags] | None:
        """The next picture to send, and GAP where some before it were dropped; None where none may be sent now."""
        behind = self._behind(now_ns)
        if self._waiting and not behind and self._too_old(self._waiting[0], now_ns):
            self._drop_waiting()
            self._joining = True
        if not self._waiting or not self._room(len(self._waiting[0].data), now_ns):
            return None
        frame = self._waiting.popleft()
        size = len(frame.data)
        self._bytes -= size
        flags = (Flags.GAP if self._gap else Flags.NONE) | (Flags.BEHIND if behind else Flags.NONE)
        self._gap = False
        if not self._waiting:
            self._behind_until_ns = 0
        if not self._sent:
            self._delivered_ns = now_ns  # a link that was idle delivered nothing: its rate counts from here
        self._sent.append(Sent(frame.sequence, size, now_ns, self._delivered, self._delivered_ns))
        self._on_the_way += size
        return frame, flags

    def shown(self, sequence: int, now_ns: int) -> None:
        """The page says that this picture is on the screen, and with it everything before."""
        newest = None
        while self._sent and self._sent[0].sequence <= sequence:
            newest = self._sent.popleft()
            self._on_the_way -= newest.size
            self._delivered += newest.size
        if newest is None:
            return
        self._delivered_ns = now_ns
        took_ns = max(now_ns - newest.delivered_ns, 1_000_000)
        self._rates.append((now_ns, (self._delivered - newest.delivered) * 1e9 / took_ns))

    def _behind(self, now_ns: int) -> bool:
        return now_ns < self._behind_until_ns

    @staticmethod
    def _too_old(frame: Frame, now_ns: int) -> bool:
        return not frame.key and now_ns - frame.stamp_ns > MAX_AGE_NS

    def _room(self, size: int, now_ns: int) -> bool:
        while self._rates and now_ns - self._rates[0][0] > RATE_MEMORY_NS:
            self._rates.popleft()
        best = max((rate for _, rate in self._rates), default=0.0)
        window = max(best * ON_THE_WAY_S, FIRST_WINDOW_BYTES)
        return self._on_the_way == 0 or self._on_the_way + size <= window

    def _too_much(self, frame: Frame, now_ns: int) -> bool:
        if len(self._waiting) >= MAX_FRAMES or self._bytes + len(frame.data) > MAX_BYTES:
            return True
        oldest_ns = self._waiting[0].stamp_ns if self._waiting else now_ns
        return now_ns - oldest_ns > MAX_AGE_NS or self._congested(now_ns)

    def _congested(self, now_ns: int) -> bool:
        if self._sent and now_ns - self._sent[-1].sent_ns > RETRY_NS:
            self._sent.clear()
            self._on_the_way = 0
        return bool(self._sent) and now_ns - self._sent[0].sent_ns > MAX_UNSEEN_NS

    def _drop_waiting(self) -> None:
        if self._waiting:
            self.dropped += len(self._waiting)
            self._gap = True
            self._waiting.clear()
            self._bytes = 0
