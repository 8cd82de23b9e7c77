"""UVC payloads: from isochronous packets to whole units, each with what is known against it.

The rules are those of fact sheet section 3.2, which also says where they come from. Nothing here knows
H.264; a unit is whatever the camera put between two ends of frame.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum, Flag, auto

FID, EOF, PTS, SCR, ERR, EOH = 0x01, 0x02, 0x04, 0x08, 0x40, 0x80

USES_FID, USES_EOF = 0x01, 0x02  # bmFramingInfo of the committed block (fact sheet 2.2)

HABIT_UNITS = 64  # two seconds of pictures tell whether a camera pauses by itself
HABIT = 0.9  # of them with a pause: losses that dense would leave nothing to look at anyway

MAX_UNIT_BYTES = 8 << 20  # 4K key pictures of 2 MB were measured; descriptors and published rates disagree

Payload = bytes | bytearray | memoryview

Packet = tuple[int, Payload]
"""Status of one isochronous packet (0 is good) and the bytes that arrived.

An empty good packet stands for any number of empty microframes in a row.
"""

RAN_DRY = -1000
"""A status of our own: for a while nobody listened to the camera, and whatever it sent then is lost."""


class Flaw(Flag):
    """What is known against a unit."""

    NONE = 0
    NO_END = auto()
    """The next frame began before the end-of-frame bit was seen."""
    LOST_PACKET = auto()
    """A packet that may have belonged to it did not arrive (status other than 0)."""
    BAD_HEADER = auto()
    """A packet that may have belonged to it had no valid payload header."""
    DEVICE_ERROR = auto()
    """The camera itself set the error bit."""
    OVERFLOW = auto()
    """It outgrew the limit and was cut."""
    PAUSE = auto()
    """A microframe in its midst was empty: the packet that belonged there vanished without an error."""

    def __str__(self) -> str:
        return ", ".join(_WORDS[flaw] for flaw in Flaw if flaw in self) or "clean"


_WORDS = {
    Flaw.NO_END: "end of frame missing",
    Flaw.LOST_PACKET: "USB packet lost",
    Flaw.BAD_HEADER: "invalid payload header",
    Flaw.DEVICE_ERROR: "camera reports an error",
    Flaw.OVERFLOW: "larger than any picture",
    Flaw.PAUSE: "a USB packet vanished",
}


class Quality(Enum):
    CLEAN = "clean"
    SUSPECT = "suspect"
    """Complete as far as one can tell, but its end was never announced."""
    DAMAGED = "damaged"


@dataclass(frozen=True, slots=True)
class Unit:
    """One assembled unit; stamps are those of the packet batches that held its first and last byte."""

    data: bytes
    flaws: Flaw
    first_ns: int
    stamp_ns: int
    follows_loss: bool = False
    """The frame bit did not toggle after the previous end: an odd number of frames vanished in between."""

    @property
    def quality(self) -> Quality:
        if self.flaws is Flaw.NONE:
            return Quality.CLEAN
        return Quality.SUSPECT if self.flaws is Flaw.NO_END else Quality.DAMAGED


class Assembler:
    """Fed packets in order, returns units. Holds at most `max_bytes` of one unit.

    At the start everything is discarded until the frame bit toggles or an end of frame passes, since one
    may have joined in the middle of a frame. `opens`, when given, looks at the very first payload and may
    vouch that a frame begins there (a camera just switched on begins with its key picture, and to throw
    that away costs a whole group of pictures).

    `framing` is bmFramingInfo as committed: a camera that says it uses only one of the two marks is judged by
    that one; one that says nothing is expected to use both, as every gadget known does.

    The camera has a whole frame ready before it sends the first packet, so an empty microframe inside a frame
    is where a packet vanished. One that pauses in nearly all its frames does so by habit, and is not judged.
    """

    def __init__(
        self,
        max_bytes: int = MAX_UNIT_BYTES,
        opens: Callable[[Payload], bool] | None = None,
        framing: int = USES_FID | USES_EOF,
    ) -> None:
        self.discarded_packets = 0
        """Good packets thrown away before the first frame boundary."""
        self._max_bytes = max_bytes
        self._opens = opens
        marks = framing & (USES_FID | USES_EOF) or USES_FID | USES_EOF
        self._fid_mask = FID if marks & USES_FID else 0
        self._unfinished = Flaw.NO_END if marks & USES_EOF else Flaw.NONE
        self._paused = False
        self._pauses: deque[bool] = deque(maxlen=HABIT_UNITS)
        self._synced = False
        self._buffer = bytearray()
        self._flaws = Flaw.NONE
        self._gap = Flaw.NONE
        self._fid: int | None = None
        self._ended_fid: int | None = None
        self._first_ns = 0
        self._last_ns = 0
        self._follows_loss = False

    @property
    def pauses_by_habit(self) -> bool:
        """Whether empty microframes inside frames mean nothing with this camera."""
        return len(self._pauses) == HABIT_UNITS and sum(self._pauses) >= HABIT * HABIT_UNITS

    def feed(self, stamp_ns: int, packets: Iterable[Packet]) -> list[Unit]:
        """Take a batch of packets that arrived together at `stamp_ns`; return the units it completed."""
        units: list[Unit] = []
        for status, payload in packets:
            if status:
                self._gap |= Flaw.LOST_PACKET
                continue
            size = len(payload)
            if size == 0:
                self._paused = bool(self._buffer)
                continue
            header = payload[0]
            if size < 2 or header < 2 or header > size:
                self._gap |= Flaw.BAD_HEADER
                continue
            bits = payload[1]
            fid = bits & self._fid_mask
            if not self._synced and not self._join(payload, header, bits):
                continue
            if fid != self._fid:
                if self._buffer:
                    self._flaws |= self._unfinished | self._gap
                    units.append(self._publish())
                self._fid = fid
            if size > header:
                self._append(stamp_ns, payload[header:])
            if bits & ERR:
                # With nothing pending the error is that of the frame to come.
                self._flaws |= Flaw.DEVICE_ERROR
            if bits & EOF and self._buffer:
                self._resume()
                self._flaws |= self._gap
                self._gap = Flaw.NONE
                units.append(self._publish())
                self._ended_fid = fid
        return units

    def _join(self, payload: Payload, header: int, bits: int) -> bool:
        fid = bits & self._fid_mask
        first, self._synced = self._fid is None, True
        if first and self._opens is not None and self._opens(payload[header:]):
            self._gap = Flaw.NONE
            return True
        if not first and fid != self._fid:
            return True
        self._fid = fid
        self._synced = bool(bits & EOF)
        self._ended_fid = fid if self._synced else None
        self.discarded_packets += 1
        return False

    def _append(self, stamp_ns: int, data: Payload) -> None:
        if not self._buffer:
            self._first_ns = stamp_ns
            self._follows_loss = bool(self._fid_mask) and self._fid == self._ended_fid
            self._ended_fid = None
        self._resume()
        # A gap may have held the tail of the frame before and the head of this one: it counts against both.
        self._flaws |= self._gap
        self._gap = Flaw.NONE
        self._last_ns = stamp_ns
        if len(self._buffer) + len(data) > self._max_bytes:
            self._flaws |= Flaw.OVERFLOW
            data = data[: self._max_bytes - len(self._buffer)]
        self._buffer += data

    def _resume(self) -> None:
        """The frame goes on after empty microframes, if there were any."""
        if self._paused:
            self._flaws |= Flaw.PAUSE
            self._paused = False

    def _publish(self) -> Unit:
        self._paused = False
        self._pauses.append(Flaw.PAUSE in self._flaws)
        if self.pauses_by_habit:
            self._flaws &= ~Flaw.PAUSE
        unit = Unit(bytes(self._buffer), self._flaws, self._first_ns, self._last_ns, self._follows_loss)
        self._buffer.clear()
        self._flaws = Flaw.NONE
        self._follows_loss = False
        return unit
