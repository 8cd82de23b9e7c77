"""Feedback packets from CAN frames (fact sheet 3.4, 13.6).

There is no length, sequence number or checksum over a packet: a packet is the frames 0x502, 0x503, ... in
order, close together in time. Anything else in between drops what was gathered.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.rmp110.codec.feedback import MAX_FRAMES
from drivers.rmp110.codec.frames import FEEDBACK_ID, Frame, unpack_words

PACKET_TIMEOUT_NS = 20_000_000
"""The longest packet takes 6.5 ms on the bus; the next request comes 20 ms later at the earliest (50 Hz)."""

FRAME_GAP_NS = 8_000_000
"""Frames of one reply are 0.13 ms apart; what comes later belongs to the next one, 10 ms after at the earliest
(100 Hz). Without this, halves of two torn packets that happen to fit would make one."""


@dataclass(frozen=True, slots=True)
class Packet:
    """The words of one reply; stamps are those of its first and last frame."""

    first_ns: int
    last_ns: int
    words: tuple[int, ...]


class _Run:
    """Frames in order from 0x502 on, or nothing."""

    def __init__(self) -> None:
        self.words: list[int] = []
        self.first_ns = 0
        self.last_ns = 0

    def __len__(self) -> int:
        return len(self.words) // 2

    def take(self, stamp_ns: int, frame: Frame) -> None:
        if not self.words:
            self.first_ns = stamp_ns
        self.last_ns = stamp_ns
        self.words.extend(unpack_words(frame.data))

    def packet(self) -> Packet:
        packet = Packet(self.first_ns, self.last_ns, tuple(self.words))
        self.words = []
        return packet


class Assembler:
    """Packets of a known number of frames.

    `torn` counts packets dropped for a gap, a repetition or lateness, `damaged` frames that cannot belong
    to a packet: wrong length, or an id beyond its end.
    """

    def __init__(self, frame_count: int, timeout_ns: int = PACKET_TIMEOUT_NS) -> None:
        if not 1 <= frame_count <= MAX_FRAMES:
            raise ValueError(f"a feedback packet has 1 to {MAX_FRAMES} frames, not {frame_count}")
        self._count = frame_count
        self._timeout_ns = timeout_ns
        self._run = _Run()
        self.torn = 0
        self.damaged = 0

    def feed(self, stamp_ns: int, frame: Frame) -> Packet | None:
        """One received frame; a packet when this frame completes it. Stamps must not run backwards."""
        index = frame.can_id - FEEDBACK_ID
        if not 0 <= index < self._count or len(frame.data) != 8:
            self.damaged += 1
            self._tear()
            return None
        run = self._run
        taken = len(run)
        if taken:
            age_ns, gap_ns = stamp_ns - run.first_ns, stamp_ns - run.last_ns
            if index != taken or not 0 <= gap_ns < FRAME_GAP_NS or age_ns >= self._timeout_ns:
                self._tear()
                taken = 0
        if index != taken:
            return None
        run.take(stamp_ns, frame)
        return run.packet() if index + 1 == self._count else None

    def _tear(self) -> None:
        if len(self._run):
            self.torn += 1
            self._run.words = []


class ReplyCollector:
    """A reply of unknown length: frames in order from 0x502 until the bus falls quiet.

    The length tells the dialect. A gap or repetition spoils the reply: `finish` then gives None.
    """

    QUIET_NS = PACKET_TIMEOUT_NS
    """No frame of this reply for so long: it is over."""

    def __init__(self) -> None:
        self._run = _Run()
        self._spoiled = False

    def feed(self, stamp_ns: int, frame: Frame) -> None:
        """One received frame."""
        index = frame.can_id - FEEDBACK_ID
        if index != len(self._run) or len(frame.data) != 8 or index >= MAX_FRAMES:
            self._spoiled = True
            return
        self._run.take(stamp_ns, frame)

    @property
    def started(self) -> bool:
        return self._spoiled or len(self._run) > 0

    def quiet(self, now_ns: int) -> bool:
        """Whether frames came and no more follow."""
        return len(self._run) > 0 and now_ns - self._run.last_ns >= self.QUIET_NS

    def finish(self) -> Packet | None:
        """The reply; None where it was spoiled or nothing came."""
        return None if self._spoiled or not len(self._run) else self._run.packet()
