"""Which words a reply carries, and what they say (fact sheet 3.4, 3.6, 4)."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from drivers.rmp110.codec.feedback_words import WORDS, Word
from drivers.rmp110.codec.frames import FEEDBACK_ID, Frame, float_to_word, pack_words
from drivers.rmp110.codec.parameters import Kind

COMPACT_BITMAPS = (0x7B800F0F, 0x03030026, 0, 0)
"""Faults, time, mode, charge, limits, speeds, wheel positions, targets: 22 words, 11 frames (fact sheet 3.6)."""
FACTORY_BITMAPS = (0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0)
"""All 96 words, 48 frames."""
MAX_FRAMES = 48
"""All words on; no reply of any dialect is longer."""


@dataclass(frozen=True, slots=True)
class Layout:
    """The words of one reply, in wire order."""

    words: tuple[Word, ...]
    _names: tuple[str, ...] = field(init=False, repr=False, compare=False)
    _plain: struct.Struct = field(init=False, repr=False, compare=False)
    _typed: struct.Struct = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        # 132 words a hundred times a second: one conversion for all of them.
        kinds = "".join("f" if word.kind is Kind.FLOAT else "I" for word in self.words)
        object.__setattr__(self, "_names", tuple(word.name for word in self.words))
        object.__setattr__(self, "_plain", struct.Struct(f">{len(kinds)}I"))
        object.__setattr__(self, "_typed", struct.Struct(f">{kinds}"))

    @classmethod
    def of(cls, bitmaps: Sequence[int], words: Iterable[Word] = WORDS) -> Layout:
        """The layout that these user-defined feedback bitmaps (1..3, further ones ignored) switch on."""
        return cls(tuple(word for word in words if bitmaps[word.bitmap - 1] >> word.bit & 1))

    @property
    def frame_count(self) -> int:
        """CAN frames per reply; 0 means that the base never answers."""
        return (len(self.words) + 1) // 2

    def missing(self, names: Iterable[str]) -> tuple[str, ...]:
        """Those of the names that a reply does not carry."""
        present = {word.name for word in self.words}
        return tuple(name for name in names if name not in present)

    def decode(self, words: Sequence[int]) -> dict[str, float]:
        """Values by name: floats for float words, whole numbers for the others. NaN is not filtered here.

        Words beyond the layout's are ignored; where there are fewer, so are the last names.
        """
        if len(words) < len(self.words):
            return Layout(self.words[: len(words)]).decode(words)
        typed = self._typed.unpack(self._plain.pack(*words[: len(self.words)]))
        return dict(zip(self._names, typed, strict=True))

    def encode(self, values: dict[str, float]) -> tuple[int, ...]:
        """The words of a reply with these values; names that are missing read zero."""
        return tuple(
            float_to_word(values.get(word.name, 0.0)) if word.kind is Kind.FLOAT else int(values.get(word.name, 0))
            for word in self.words
        )


COMPACT = Layout.of(COMPACT_BITMAPS)


def split_frames(words: Sequence[int]) -> tuple[Frame, ...]:
    """A reply as CAN frames: two words each, ids counting up; an odd last word is followed by zero."""
    padded = [*words, 0] if len(words) % 2 else words
    return tuple(pack_words(FEEDBACK_ID + k, padded[2 * k], padded[2 * k + 1]) for k in range(len(padded) // 2))
