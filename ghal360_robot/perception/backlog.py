"""What waits to be decoded: a short queue in which the newest wins, without ever breaking a picture chain.

H.264 pictures lean on the ones before them, so single access units cannot be skipped. When the decoder
falls behind, everything up to the newest IDR goes, or, where no IDR is waiting, everything until the next.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

SLICE, IDR_SLICE, SPS, PPS = 1, 5, 7, 8
"""NAL unit types of ITU-T H.264, table 7-1."""
START_CODE = b"\x00\x00\x01"
HEADERS_LOOKED_AT = 16
"""AUD, SPS, PPS and SEIs stand before the first slice; a unit with more in front is not a camera's."""
IDR_PATIENCE_UNITS = 90
"""3 s at 29.97 Hz: a camera that sends other sync pictures than IDRs would else never be decoded again."""


@dataclass(frozen=True, slots=True)
class AccessUnit:
    """One picture as received (Annex B), its running number and the instant of its last byte."""

    data: bytes
    number: int
    stamp_ns: int
    tainted: bool
    idr: bool
    parameters: bool
    """Carries an SPS or PPS, which later pictures need even if this unit is late."""
    empty: bool = False
    """Holds no NAL unit at all."""


def nal_types(data: bytes) -> tuple[int, ...]:
    """Types of the NAL units up to the first slice, in order; empty if there is no start code."""
    types: list[int] = []
    at = data.find(START_CODE)
    while at >= 0 and at + 3 < len(data) and len(types) < HEADERS_LOOKED_AT:
        kind = data[at + 3] & 0x1F
        types.append(kind)
        if SLICE <= kind <= IDR_SLICE:
            break
        at = data.find(START_CODE, at + 3)
    return tuple(types)


def access_unit(data: bytes, number: int, stamp_ns: int, *, tainted: bool) -> AccessUnit:
    """An access unit with what its NAL headers say about it."""
    types = nal_types(data)
    return AccessUnit(
        data=data,
        number=number,
        stamp_ns=stamp_ns,
        tainted=tainted,
        idr=IDR_SLICE in types,
        parameters=SPS in types or PPS in types,
        empty=not types,
    )


class Backlog:
    """At most `capacity` units; not thread-safe by itself."""

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError("the backlog needs room for at least one access unit")
        self._capacity = capacity
        self._units: deque[AccessUnit] = deque()
        self._units_until_patience_ends = 0
        self.dropped = 0

    def __len__(self) -> int:
        return len(self._units)

    def push(self, unit: AccessUnit) -> None:
        """Take a unit in; what no longer can or need be decoded in time is dropped and counted."""
        if self._units_until_patience_ends and not (unit.idr or unit.parameters):
            self._units_until_patience_ends -= 1
            self.dropped += 1
            return
        if unit.idr:
            self._units_until_patience_ends = 0
        self._units.append(unit)
        if len(self._units) > self._capacity:
            self._drop_to_newest_idr()

    def pop(self) -> AccessUnit | None:
        """The oldest unit that waits, or None."""
        return self._units.popleft() if self._units else None

    def _drop_to_newest_idr(self) -> None:
        newest = next((at for at in range(len(self._units) - 1, 0, -1) if self._units[at].idr), None)
        if newest is None:
            self.dropped += len(self._units)
            self._units.clear()
            self._units_until_patience_ends = IDR_PATIENCE_UNITS
            return
        for _ in range(newest):
            self._units.popleft()
        self.dropped += newest
