"""A picture on its way to the page: one binary message of a 24 byte header and the picture itself.

An H.264 picture is one access unit in Annex B, parameter sets in front of every key picture: what the camera sent,
what the recording keeps and what WebCodecs takes. A still is a whole JPEG.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntFlag

VERSION = 1

HEADER = struct.Struct("<BBHIQHHI")
"""version, flags, stream, sequence, capture instant in us, width, height, zero."""


class Flags(IntFlag):
    """What there is to know about a picture before decoding it."""

    NONE = 0
    KEY = 1
    GAP = 2
    """Pictures before this one were not sent to this connection."""
    TAINTED = 4
    """Damaged, or built upon something damaged."""
    JPEG = 8
    BEHIND = 16
    """Of a group that had begun before this connection: to be decoded, not to be taken for a decoder that is late."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture. `stamp_ns` is its arrival at the robot; `sequence` counts without end."""

    data: bytes
    stamp_ns: int
    sequence: int
    width: int
    height: int
    key: bool
    tainted: bool = False
    jpeg: bool = False

    def message(self, flags: Flags = Flags.NONE) -> bytes:
        """Header and picture for the wire; `flags` is what there is to say of this connection."""
        flags |= Flags.KEY * self.key | Flags.TAINTED * self.tainted | Flags.JPEG * self.jpeg
        header = HEADER.pack(
            VERSION, flags, 0, self.sequence & 0xFFFFFFFF, self.stamp_ns // 1000, self.width, self.height, 0
        )
        return header + self.data
