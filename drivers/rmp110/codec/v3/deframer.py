"""Packets from a serial stream of bytes: fixed lengths, and a checksum to find the beat again.

There is no start byte. In step, a packet begins where the last one ended; out of step every offset is tried
until one carries a status packet that makes sense and fits its checksum.
"""

from __future__ import annotations

import struct

from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import OperationalState
from drivers.rmp110.codec.v3.packets import (
    FAULT_LOG_BYTES,
    MACHINE_MASK,
    MACHINES,
    STATUS_BYTES,
    parse_packet,
)
from drivers.rmp110.codec.v3.words import MACHINE_ID_AT, STATE_AT

_STATE = 4 * STATE_AT
_MACHINE = 4 * MACHINE_ID_AT


class Deframer:
    """Feed bytes, get frames. `damaged` counts runs of bytes that belong to no packet, `skipped` the bytes.

    Never holds more than one packet and what was fed last.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._in_step = True
        self._log_due = False
        self.damaged = 0
        self.skipped = 0

    def expect_fault_log(self) -> None:
        """A fault log is asked for now, after the stream was stopped: the next bytes begin a packet."""
        self._buffer.clear()
        self._in_step = self._log_due = True

    def feed(self, data: bytes) -> list[Frame]:
        """Every packet that these bytes complete."""
        self._buffer += data
        frames: list[Frame] = []
        start = 0
        while (step := self._look(start, frames)) > 0:
            start += step
        del self._buffer[:start]
        return frames

    def _look(self, start: int, frames: list[Frame]) -> int:
        """How many bytes from `start` are done with: a packet's, one that belongs to none, or zero: wait."""
        available = len(self._buffer) - start
        if available < STATUS_BYTES:
            return 0
        if (self._in_step or self._plausible(start)) and self._take(start, STATUS_BYTES, frames):
            return STATUS_BYTES
        if self._in_step and self._log_due:
            if available < FAULT_LOG_BYTES:
                return 0
            self._log_due = False
            if self._take(start, FAULT_LOG_BYTES, frames):
                return FAULT_LOG_BYTES
        self.damaged += self._in_step
        self.skipped += 1
        self._in_step = False
        return 1

    def _take(self, start: int, length: int, frames: list[Frame]) -> bool:
        frame = parse_packet(bytes(self._buffer[start : start + length]))
        if frame is None:
            return False
        frames.append(frame)
        self._in_step = True
        return True

    def _plausible(self, start: int) -> bool:
        """Cheap, so that garbage does not cost a checksum of 532 bytes for every byte; also rules out zeros."""
        return any(
            struct.unpack_from(f"{order}I", self._buffer, start + _STATE)[0] <= OperationalState.POWERDOWN
            and struct.unpack_from(f"{order}I", self._buffer, start + _MACHINE)[0] & MACHINE_MASK in MACHINES
            for order in "<>"
        )
