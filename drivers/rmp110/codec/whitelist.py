"""What may reach the wire at all: the last check, on the encoded bytes.

Whatever goes wrong above, no frame leaves that could switch the base off, change its network settings,
reset its parameters or command a speed that is no number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame, as_float32, unpack_words, word_to_float
from drivers.rmp110.codec.parameters import BY_NUMBER, RMP110_TRACK_MINIMUM_M, ModeRequest, Number


def _in_range(number: int) -> Callable[[int], bool]:
    return BY_NUMBER[number].accepts


def _track(word: int) -> bool:
    # The 110's own track width is below the minimum that dialect B2 documents.
    return as_float32(RMP110_TRACK_MINIMUM_M) <= word_to_float(word) <= 1.0


def _nonzero(word: int) -> bool:
    # With all bitmaps zero the base never answers again; the first one must keep some bits.
    return word != 0


_ALLOWED: Mapping[int, Callable[[int], bool]] = {
    Number.NONE: lambda word: word == 0,
    **{number: _in_range(number) for number in range(Number.MAX_VELOCITY, Number.TRACK_WIDTH)},
    Number.TRACK_WIDTH: _track,
    Number.GEAR_RATIO: _in_range(Number.GEAR_RATIO),
    # Bit 3 allows driving while the charger is plugged in: never set from here (fact sheet 6.4).
    Number.INPUT_BITMAP: lambda word: word & 0x8 == 0 and word <= 0x1FFF,
    Number.FEEDBACK_1: _nonzero,
    Number.FEEDBACK_2: lambda _: True,
    Number.FEEDBACK_3: lambda _: True,
    Number.FEEDBACK_4: lambda word: word == 0,
    Number.FORCE_CONFIG_FEEDBACK: lambda word: word in (0, 1),
    Number.AUDIO: lambda word: word <= 16,
    Number.MODE_REQUEST: lambda word: word in (ModeRequest.STANDBY, ModeRequest.TRACTOR),
    Number.FAULT_LOG: lambda word: word in (0, 1),
    Number.RESET_INTEGRATORS: lambda word: word <= 0x1F,
}


def forbidden(frame: Frame) -> str | None:
    """Why this frame must not be sent; None where it may."""
    if len(frame.data) != 8:
        return f"frame 0x{frame.can_id:X} with {len(frame.data)} bytes: the base takes frames of 8 only"
    high, low = unpack_words(frame.data)
    if frame.can_id == MOTION_ID:
        values = word_to_float(high), word_to_float(low)
        if all(math.isfinite(value) and abs(value) <= 1.0 for value in values):
            return None
        return f"motion {values} is not within -1 and 1"
    if frame.can_id != CONFIG_ID:
        return f"id 0x{frame.can_id:X} is not one of the base's command ids"
    check = _ALLOWED.get(high)
    if check is None:
        return f"configuration command {high} is not for routine use"
    if not check(low):
        return f"configuration command {high} with parameter 0x{low:08X} is not allowed"
    return None
