"""Frames out of a byte stream that may be cut anywhere and damaged anywhere.

Two promises: the events do not depend on how the stream was cut, and no good frame is lost behind a bad one.
The buffer never holds more than one longest frame. Damage is an event with a size and a reason; nothing raises.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from drivers.tim571.codec.dialect import ETX, STX, Dialect, checksum

MAX_PAYLOAD = 0xFFFF
"""Longest payload taken for real; the longest telegram of a TiM571 (CoLa-A with RSSI) has about 6 kB."""

Reason = Literal["noise", "truncated", "checksum", "malformed", "oversized"]

_TYPES = rb"s(?:R[NIA]|W[NIA]|M[NIA]|A[NI]|E[NIA]|S[NI]|FA)"
_TYPE = re.compile(_TYPES)
# Magic, a length within MAX_PAYLOAD and a telegram type: what a frame's first eleven bytes must look like.
# Four 02 alone also occur inside telegrams (two neighbouring distances of 514 mm).
_HEADER = re.compile(rb"\x02\x02\x02\x02\x00\x00(?s:..)(?=" + _TYPES + rb")")
_HEADER_LENGTH = 8
_HEADER_SEEN = 11
_OVERHEAD_B = 9
_OVERHEAD_A = 2
_PADDING = b"\x00\r\n "  # some hosts end a frame with NUL or a line end: harmless between frames


@dataclass(frozen=True, slots=True)
class Frame:
    """One complete frame exactly as received; `stamp_ns` is the arrival of its first byte."""

    stamp_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Damage:
    """A stretch of the stream, `size` bytes long, that was no good frame; `reason` is what was wrong first."""

    reason: Reason
    size: int


class Deframer:
    """Cuts one direction of one connection into frames. Feed it what arrives, as it arrives."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self._buffer = b""
        self._base = 0  # stream offset of the buffer's first byte
        self._chunks: deque[tuple[int, int]] = deque()  # (stream offset of a chunk's end, its arrival)
        self._reason: Reason | None = None
        self._bad = 0
        self._spoilt: tuple[int, bytes] | None = None  # CoLa-B: where a frame with a bad checksum ends, its header
        self._claimed = 0  # stream offset up to which bytes were delivered: they are no damage
        self._open = False  # CoLa-A: the buffer begins with the STX of a frame not ended yet

    @property
    def buffered(self) -> int:
        """Bytes held back because their frame isn't complete yet."""
        return len(self._buffer)

    def feed(self, data: bytes, stamp_ns: int = 0) -> list[Frame | Damage]:
        """Take the next bytes of the stream, arrived at `stamp_ns`; return what they completed."""
        if not data:
            return []
        self._buffer += data
        self._chunks.append((self._base + len(self._buffer), stamp_ns))
        return list(self._cut_a() if self.dialect is Dialect.A else self._cut_b())

    def close(self) -> list[Frame | Damage]:
        """The stream has ended: return the damage not reported yet, a frame cut short included."""
        if self._buffer.startswith(STX):
            self._blame("truncated")
        events: list[Frame | Damage] = list(self._discard(0, len(self._buffer)))
        self._consume(len(self._buffer))
        self._open = False
        events.extend(self._settle())
        return events

    def _cut_a(self) -> Iterator[Frame | Damage]:
        """STX opens a frame, also when another one is open; ETX ends it (fact sheet section 8.3)."""
        buffer, size = self._buffer, len(self._buffer)
        longest = MAX_PAYLOAD + _OVERHEAD_A
        position = 0
        stx, etx = _find(buffer, STX, int(self._open)), _find(buffer, ETX, 0)
        while (mark := min(stx, etx)) < size:
            end = mark if mark == stx else mark + 1
            text = buffer[position:end]
            if self._open and mark == etx and end - position <= longest and _TYPE.match(text, 1):
                yield Frame(self._arrival(position), text)
            else:
                if self._open:
                    ended: Reason = "truncated" if mark == stx else "malformed"
                    self._blame("oversized" if end - position > longest else ended)
                yield from self._discard(position, end)
            position = end
            self._open = mark == stx
            if self._open:
                yield from self._settle()
            stx = _find(buffer, STX, mark + 1) if stx == mark else stx
            etx = _find(buffer, ETX, mark + 1) if etx == mark else etx
        if not self._open or size - position > longest:
            if self._open:
                self._blame("oversized")
            yield from self._discard(position, size)
            position = size
            self._open = False
        self._consume(position)

    def _cut_b(self) -> Iterator[Frame | Damage]:
        """A frame is a header, its length of payload and the right checksum, with no other header inside."""
        buffer, size = self._buffer, len(self._buffer)
        position = 0
        while True:
            header = _HEADER.search(buffer, position)
            if header is None:
                kept = max(position, size - _HEADER_SEEN + 1)
                yield from self._discard(position, kept)
                position = kept
                break
            start = header.start()
            yield from self._discard(position, start)
            yield from self._settle()
            position = start
            end = start + _OVERHEAD_B + int.from_bytes(buffer[start + 6 : start + 8])
            if inner := _HEADER.search(buffer, start + 1, min(end, size)):
                self._blame("truncated")
                yield from self._discard(start, inner.start())
                position = inner.start()
            elif end > size:
                break
            elif checksum(buffer[start + _HEADER_LENGTH : end - 1]) != buffer[end - 1]:
                self._blame("checksum")
                if self._spoilt is None:
                    self._spoilt = self._base + end, buffer[start : start + _HEADER_LENGTH]
                yield from self._discard(start, start + 1)
                position = start + 1
            else:
                yield Frame(self._arrival(start), buffer[start:end])
                self._claimed = self._base + end
                # One wrong frame in 256 has the right checksum, and may end inside a good one's header.
                position = max(start + 1, end - _HEADER_SEEN + 1)
        self._consume(position)

    def _arrival(self, index: int) -> int:
        """Arrival of the buffer's byte at `index`; asked for in stream order only."""
        while self._chunks[0][0] <= self._base + index:
            self._chunks.popleft()
        return self._chunks[0][1]

    def _consume(self, count: int) -> None:
        self._buffer = self._buffer[count:]
        self._base += count
        while self._chunks and self._chunks[0][0] <= self._base:
            self._chunks.popleft()

    def _blame(self, reason: Reason) -> None:
        """Say why the bytes discarded from here on are bad, unless an earlier cause still covers them."""
        if self._reason is None:
            self._reason = reason

    def _discard(self, start: int, end: int) -> Iterator[Damage]:
        """Count bytes as damage; report at once what is longer than any frame, so that noise is noticed."""
        start = max(start, min(end, self._claimed - self._base))
        if self._spoilt is not None and self._spoilt[0] - self._base < end:
            limit, header = self._spoilt[0] - self._base, self._spoilt[1]
            self._spoilt = None
            if start <= limit and _resembles(self._buffer[limit : limit + _HEADER_LENGTH], header):
                # Behind the spoilt frame comes another whose header is spoilt: two telegrams, two events.
                yield from self._discard(start, limit)
                yield from self._settle()
                start = limit
        if self._reason is None:
            self._bad += len(self._buffer[start:end].translate(None, _PADDING))
        else:
            self._bad += end - start
        while self._bad > MAX_PAYLOAD:
            yield Damage(self._reason or "noise", MAX_PAYLOAD)
            self._bad -= MAX_PAYLOAD

    def _settle(self) -> Iterator[Damage]:
        """Report the damage collected so far: a new frame begins."""
        self._spoilt = None
        if self._bad:
            yield Damage(self._reason or "noise", self._bad)
        self._reason, self._bad = None, 0


def _resembles(header: bytes, other: bytes) -> bool:
    """Whether all bytes but one are the same."""
    return sum(one == two for one, two in zip(header, other, strict=False)) >= _HEADER_LENGTH - 1


def _find(buffer: bytes, mark: bytes, start: int) -> int:
    """Index of the mark at or behind `start`, or the buffer's length."""
    index = buffer.find(mark, start)
    return len(buffer) if index < 0 else index
