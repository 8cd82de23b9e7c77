"""The two dialects of SICK's command language and how each frames a payload (fact sheet section 2)."""

from __future__ import annotations

import struct
from enum import Enum

import numpy as np

STX = b"\x02"
ETX = b"\x03"
MAGIC = b"\x02\x02\x02\x02"


class Dialect(Enum):
    """CoLa-A is text, CoLa-B is binary; a connection speaks one of them at a time."""

    A = "a"
    B = "b"

    @property
    def other(self) -> Dialect:
        """The dialect that this one is not."""
        return Dialect.B if self is Dialect.A else Dialect.A

    def __str__(self) -> str:
        return f"CoLa-{self.name}"


def checksum(payload: bytes) -> int:
    """XOR of all payload bytes, eight at a time."""
    whole = len(payload) & ~7
    folded = np.bitwise_xor.reduce(np.frombuffer(payload, np.uint64, whole // 8)) if whole else 0
    word = int(folded) ^ int.from_bytes(payload[whole:], "little")
    word ^= word >> 32
    word ^= word >> 16
    word ^= word >> 8
    return word & 0xFF


def frame(dialect: Dialect, payload: bytes) -> bytes:
    """The payload as it travels: `02 .. 03`, or magic, length, payload and checksum."""
    if dialect is Dialect.A:
        return STX + payload + ETX
    return MAGIC + struct.pack(">I", len(payload)) + payload + bytes([checksum(payload)])
