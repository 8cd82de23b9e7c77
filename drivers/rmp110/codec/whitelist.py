"""What may reach the wire at all: the last check, on the encoded bytes.

Whatever goes wrong above, no frame leaves that could switch the base off, change its network settings,
reset its parameters or command a speed that is no number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

from drivers.rmp110.codec.dialect import Action, Dialect
from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame, as_float32, unpack_words, word_to_float
from drivers.rmp110.codec.parameters import CAN_INPUT_BITS, RMP110_TRACK_MINIMUM_M, ModeRequest
from drivers.rmp110.codec.vocabulary import VOCABULARIES, Vocabulary

Check = Callable[[int], bool]
"""Whether a configuration command may carry this word."""

ACTIONS: Mapping[Action, Check] = {
    Action.NONE: lambda word: word == 0,
    Action.FORCE_CONFIG_FEEDBACK: lambda word: word in (0, 1),
    Action.MODE_REQUEST: lambda word: word in (ModeRequest.STANDBY, ModeRequest.TRACTOR),
    Action.FAULT_LOG: lambda word: word in (0, 1),
}
"""What the driver says, and nothing else."""

RANGED = (
    "max_velocity",
    "max_accel",
    "max_decel",
    "max_dtz_decel",
    "coastdown_decel",
    "max_yaw_rate",
    "max_yaw_accel",
    "tire_diameter",
    "wheel_base",
    "gear_ratio",
    "lateral_accel",
)
"""Parameters that may be anything within their documented range."""


def track_allowed(word: int) -> bool:
    """The 110's own track width is below the minimum that dialect B2 documents."""
    return as_float32(RMP110_TRACK_MINIMUM_M) <= word_to_float(word) <= 1.0


PARAMETERS: Mapping[str, Check] = {
    "track_width": track_allowed,
    "input_bitmap": lambda word: word & CAN_INPUT_BITS.unwanted == 0 and word <= 0x1FFF,
    # With all bitmaps zero the base never answers again; the first one must keep some bits.
    "feedback_bitmap_1": lambda word: word != 0,
    "feedback_bitmap_2": lambda _: True,
    "feedback_bitmap_3": lambda _: True,
    "feedback_bitmap_4": lambda word: word == 0,
}
"""Parameters with a rule of their own; network settings are in neither table and never pass."""


def _checks(book: Vocabulary) -> Mapping[int, Check]:
    by_name: dict[str, Check] = {name: book.parameter(name).accepts for name in RANGED if _stores(book, name)}
    by_name |= PARAMETERS
    checks = {book.actions[action]: check for action, check in ACTIONS.items()}
    return checks | {p.number: by_name[p.name] for p in book.parameters if p.name in by_name}


def _stores(book: Vocabulary, name: str) -> bool:
    return any(parameter.name == name for parameter in book.parameters)


_ALLOWED: Mapping[Dialect, Mapping[int, Check]] = {name: _checks(book) for name, book in VOCABULARIES.items()}


def guard(dialect: Dialect) -> Callable[[Frame], str | None]:
    """The whitelist of one dialect, for a transport."""
    return partial(forbidden, dialect=dialect)


def forbidden(frame: Frame, dialect: Dialect = Dialect.B2) -> str | None:
    """Why this frame must not be sent to a base of this dialect; None where it may.

    The same number says something else in another dialect (fact sheet 6.3): B2's rules also fit B3, B1's
    fit neither.
    """
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
    check = _ALLOWED[dialect].get(high)
    if check is None:
        return f"configuration command {high} is not for routine use"
    if not check(low):
        return f"configuration command {high} with parameter 0x{low:08X} is not allowed"
    return None
