"""What differs between the dialects of the 0x500 family, as tables (fact sheet 4.6, 6).

Motion, poll, framing and mode numbers are the same in all; numbers of parameters and actions, the feedback
words and the length of a configuration reply are not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from drivers.rmp110.codec import feedback_words_b1, feedback_words_b3
from drivers.rmp110.codec.dialect import Action, Dialect
from drivers.rmp110.codec.feedback import COMPACT_BITMAPS, FACTORY_BITMAPS, Layout
from drivers.rmp110.codec.feedback_words import WORDS, Word
from drivers.rmp110.codec.frames import CONFIG_ID, Frame, pack_words
from drivers.rmp110.codec.parameters import (
    BY_NAME,
    CAN_INPUT_BITS,
    PARAMETERS,
    InputBits,
    Kind,
    Number,
    Parameter,
    Stored,
)

Bitmaps = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """One dialect: its parameters in the order of a configuration reply, its actions, its feedback words."""

    dialect: Dialect
    parameters: tuple[Parameter, ...]
    actions: Mapping[Action, int]
    """Configuration command by action; an action that is not here does not exist in this dialect."""
    words: tuple[Word, ...]
    factory_bitmaps: Bitmaps
    compact_bitmaps: Bitmaps
    """Eleven frames with all that the driver needs (fact sheet 3.6)."""
    input_bits: InputBits = CAN_INPUT_BITS

    @property
    def config_reply_frames(self) -> int:
        """CAN frames of a forced configuration reply; tells the dialect."""
        return (len(self.parameters) + 1) // 2

    @property
    def valid_bitmaps(self) -> Bitmaps:
        """Feedback bits that have a word."""
        one, two, three = (sum(1 << word.bit for word in self.words if word.bitmap == n) for n in (1, 2, 3))
        return one, two, three, 0

    def layout(self, bitmaps: Sequence[int]) -> Layout:
        """The reply that these feedback bitmaps switch on."""
        return Layout.of(bitmaps, self.words)

    def stored(self, words: Sequence[int]) -> Stored:
        """Stored parameters from a configuration reply; ValueError where there are too few words."""
        return Stored(tuple(words[: len(self.parameters)]), self.parameters)

    def parameter(self, name: str) -> Parameter:
        """KeyError where this dialect does not store it."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(name)

    def store(self, name: str, value: float) -> Frame:
        """The frame that writes a parameter, in its unit."""
        parameter = self.parameter(name)
        return pack_words(CONFIG_ID, parameter.number, parameter.word(value))

    def act(self, action: Action, word: int = 0) -> Frame:
        """The frame that asks for an action; KeyError where this dialect has none."""
        return pack_words(CONFIG_ID, self.actions[action], word)


_B2_ACTIONS: Mapping[Action, int] = {
    Action.NONE: Number.NONE,
    Action.FORCE_CONFIG_FEEDBACK: Number.FORCE_CONFIG_FEEDBACK,
    Action.AUDIO: Number.AUDIO,
    Action.MODE_REQUEST: Number.MODE_REQUEST,
    Action.FAULT_LOG: Number.FAULT_LOG,
    Action.RESET_INTEGRATORS: Number.RESET_INTEGRATORS,
    Action.RESET_PARAMETERS: Number.RESET_PARAMETERS,
}

B2 = Vocabulary(Dialect.B2, PARAMETERS, _B2_ACTIONS, WORDS, FACTORY_BITMAPS, COMPACT_BITMAPS)

B3 = Vocabulary(
    Dialect.B3,
    (
        *PARAMETERS[:18],
        replace(BY_NAME["feedback_bitmap_3"], factory=0x007FFFFF),
        PARAMETERS[19],
        Parameter(21, "lateral_accel", Kind.FLOAT, "m/s^2", 4.905, 0.981, 9.81),
    ),
    {**_B2_ACTIONS, Action.CONTINUOUS_DATA: 36},
    feedback_words_b3.WORDS,
    (0xFFFFFFFF, 0xFFFFFFFF, 0x007FFFFF, 0),
    (0xFB000FEF, 0x0000000F, 0, 0),
)

_B1_NUMBERS: Mapping[str, int] = {
    "max_velocity": 0x1,
    "max_accel": 0x2,
    "max_decel": 0x3,
    "max_dtz_decel": 0x4,
    "coastdown_decel": 0x5,
    "max_yaw_rate": 0x6,
    "max_yaw_accel": 0x7,
    "tire_diameter": 0x8,
    "track_width": 0x9,
    "gear_ratio": 0xA,
    "input_bitmap": 0xB,
    "ip_address": 0xC,
    "ip_port": 0xD,
    "subnet_mask": 0xE,
    "gateway": 0xF,
    "feedback_bitmap_1": 0x10,
    "feedback_bitmap_2": 0x11,
    "feedback_bitmap_3": 0x12,
}
"""No wheel base and no fourth bitmap; ranges are taken from B2, nobody published B1's (fact sheet 6.3)."""

B1 = Vocabulary(
    Dialect.B1,
    tuple(
        replace(BY_NAME[name], number=number, factory=0x001FFFFF if number == 0x12 else BY_NAME[name].factory)
        for name, number in _B1_NUMBERS.items()
    ),
    {
        Action.NONE: 0x0,
        Action.FORCE_CONFIG_FEEDBACK: 0x13,
        Action.AUDIO: 0x14,
        Action.MODE_REQUEST: 0x15,
        Action.FAULT_LOG: 0x16,
        Action.RESET_INTEGRATORS: 0x17,
        Action.RESET_PARAMETERS: 0x18,
    },
    feedback_words_b1.WORDS,
    (0xFFFFFFFF, 0xFFFFFFFF, 0x001FFFFF, 0),
    COMPACT_BITMAPS,
)

VOCABULARIES: Mapping[Dialect, Vocabulary] = {book.dialect: book for book in (B1, B2, B3)}
