"""Writing telegram parameters in either dialect; layouts as in `fields`."""

from __future__ import annotations

import struct
from typing import Any, Protocol

from drivers.tim571.codec import hexwords
from drivers.tim571.codec.readers import BIG_ENDIAN, BLANK, CONTROL, SAMPLE, Samples


class Writer(Protocol):
    """Collects parameters; raises ValueError for one that the wire cannot carry."""

    def put(self, layout: str, *values: Any) -> None:
        """Append numbers; `layout` without `S`."""

    def tag(self, name: str) -> None:
        """Append a fixed-length name."""

    def string(self, text: str) -> None:
        """Append a string with its length."""

    def samples(self, values: Samples, letter: str) -> None:
        """Append samples of letter `B` or `H`."""

    def raw(self, rest: bytes) -> None:
        """Append what a reader returned as `rest`."""

    def body(self) -> bytes:
        """All of it."""


class BinaryWriter:
    """CoLa-B parameters."""

    __slots__ = ("_parts",)

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def put(self, layout: str, *values: Any) -> None:
        self._parts.append(_pack(layout, *values))

    def tag(self, name: str) -> None:
        self._parts.append(name.encode("latin-1"))

    def string(self, text: str) -> None:
        coded = text.encode("latin-1")
        self._parts += (_pack("H", len(coded)), coded)

    def samples(self, values: Samples, letter: str) -> None:
        self._parts.append(values.astype(BIG_ENDIAN[letter]).tobytes())

    def raw(self, rest: bytes) -> None:
        self._parts.append(rest)

    def body(self) -> bytes:
        return b"".join(self._parts)


class TextWriter:
    """CoLa-A parameters."""

    __slots__ = ("_tokens",)

    def __init__(self) -> None:
        self._tokens: list[bytes] = []

    def put(self, layout: str, *values: Any) -> None:
        for letter, value in zip(layout, values, strict=True):
            word = _pack(letter, value)
            self._tokens.append(word.hex().upper().encode() if letter == "f" else b"%X" % int.from_bytes(word))

    def tag(self, name: str) -> None:
        self._tokens.append(_text(name))

    def string(self, text: str) -> None:
        coded = _text(text)
        self._tokens.append(b"%X" % len(coded))
        if coded:
            self._tokens.append(coded)

    def samples(self, values: Samples, letter: str) -> None:
        if len(values):
            self._tokens.append(hexwords.build(values.astype(SAMPLE[letter])))

    def raw(self, rest: bytes) -> None:
        if rest:
            self._tokens.append(rest)

    def body(self) -> bytes:
        return BLANK.join(self._tokens)


def _text(text: str) -> bytes:
    coded = text.encode("latin-1")
    if CONTROL.search(coded):
        raise ValueError(f"{text!r} holds a control character, which CoLa-A cannot carry")
    return coded


def _pack(layout: str, *values: Any) -> bytes:
    try:
        return struct.pack(">" + layout, *values)
    except struct.error as error:
        raise ValueError(f"{values} does not fit layout {layout}: {error}") from error
