"""CAN frames of the 0x500 family: standard ids, eight bytes, two big-endian words (fact sheet 3.1, 3.2)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

MOTION_ID = 0x500
CONFIG_ID = 0x501
FEEDBACK_ID = 0x502
"""First feedback frame; frame k of a packet has id 0x502 + k."""
FILTER_ID, FILTER_MASK = 0x500, 0x780
"""Receive filter: 0x500..0x57F, standard ids only."""

_WORDS = struct.Struct(">II")
_FLOAT = struct.Struct(">f")
_UINT = struct.Struct(">I")


@dataclass(frozen=True, slots=True)
class Frame:
    """One standard data frame; `data` has 8 bytes on a healthy bus, 0..8 from a hostile one."""

    can_id: int
    data: bytes


def pack_words(can_id: int, high: int, low: int) -> Frame:
    """A frame of two 32-bit words."""
    return Frame(can_id, _WORDS.pack(high, low))


def unpack_words(data: bytes) -> tuple[int, int]:
    """The two words of eight bytes; struct.error for any other length."""
    high, low = _WORDS.unpack(data)
    return high, low


def float_to_word(value: float) -> int:
    """IEEE-754 binary32 bits; OverflowError where the value does not fit."""
    (word,) = _UINT.unpack(_FLOAT.pack(value))
    return int(word)


def word_to_float(word: int) -> float:
    """The float32 with these bits, NaN and infinities included."""
    (value,) = _FLOAT.unpack(_UINT.pack(word))
    return float(value)


def as_float32(value: float) -> float:
    """`value` rounded to the nearest float32, as the machine stores it."""
    return word_to_float(float_to_word(value))
