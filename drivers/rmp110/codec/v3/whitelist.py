"""What may reach a V3 base at all: the last check, on the encoded words."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping

from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import InputBits, ModeRequest
from drivers.rmp110.codec.v3.commands import CONFIG_ID, GENERAL_ID, MOTION_ID, General
from drivers.rmp110.codec.v3.words import CONFIG_WORDS, PARAMETERS

MAX_MPS, MAX_RPS = 8.047, 4.5
"""Firmware maxima (fact sheet section 7); a V3 base takes m/s and rad/s, not shares."""
INPUT_BITS = InputBits(charging=0x2, acceleration=0, filters=0x7F80, limit_mapping=0)
"""Fact sheet section 11: filters of velocity and yaw, no acceleration mapping."""
MOTION_BYTES, GENERAL_BYTES, CONFIG_BYTES = 12, 8, 4 * CONFIG_WORDS

_GENERAL: Mapping[int, Callable[[int], bool]] = {
    General.NONE: lambda word: word == 0,
    General.MODE_REQUEST: lambda word: word in (ModeRequest.STANDBY, ModeRequest.TRACTOR),
    General.FAULT_LOG: lambda word: word == 0,
    General.CONTINUOUS_DATA: lambda word: word in (0, 1),
}


def forbidden(frame: Frame) -> str | None:
    """Why this frame must not be sent; None where it may."""
    rule = _RULES.get(frame.can_id)
    if rule is None:
        return f"id 0x{frame.can_id:X} is not one that may be sent to a base with V3 firmware"
    length, check = rule
    if len(frame.data) != length:
        return f"frame 0x{frame.can_id:X} with {len(frame.data)} bytes instead of {length}"
    return check(frame.data)


def _motion(data: bytes) -> str | None:
    v, sideways, w = struct.unpack(">3f", data)
    if not (math.isfinite(v) and math.isfinite(w) and abs(v) <= MAX_MPS and abs(w) <= MAX_RPS):
        return f"motion ({v} m/s, {w} rad/s) is not within the firmware's limits"
    return None if sideways == 0 else "an RMP 110 cannot go sideways"


def _config(data: bytes) -> str | None:
    for parameter, (word,) in zip(PARAMETERS, struct.iter_unpack(">I", data), strict=False):
        if not parameter.accepts(word):
            return f"parameter {parameter.name} = 0x{word:08X} is outside its documented range"
        if parameter.name == "input_bitmap" and word & INPUT_BITS.unwanted:
            return "an input bitmap that filters commands or allows driving while the charger is plugged in"
    return None


def _general(data: bytes) -> str | None:
    command, word = struct.unpack(">2I", data)
    check = _GENERAL.get(command)
    if check is None:
        return f"general purpose command {command} is not for routine use"
    return None if check(word) else f"general purpose command {command} with 0x{word:08X} is not allowed"


_RULES: Mapping[int, tuple[int, Callable[[bytes], str | None]]] = {
    MOTION_ID: (MOTION_BYTES, _motion),
    CONFIG_ID: (CONFIG_BYTES, _config),
    GENERAL_ID: (GENERAL_BYTES, _general),
}
"""Length and check by id; network settings (0x1802) are not here."""
