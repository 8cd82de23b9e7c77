"""Reading telegram parameters in either dialect; layouts as in `fields`. Whatever doesn't fit is refused."""

from __future__ import annotations

import re
import struct
from functools import lru_cache
from operator import ge
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.tim571.codec import hexwords
from drivers.tim571.codec.faults import Fault
from drivers.tim571.errors import TimMalformedError

Samples = NDArray[np.unsignedinteger]

BLANK = b" "
CONTROL = re.compile(rb"[\x00-\x1f]")  # never inside CoLa-A
_HEX = b"0123456789ABCDEFabcdef"
_HEX_AND_BLANK = _HEX + BLANK
_WORTHWHILE = 8  # numbers: fewer are read faster one by one
_LONGEST_NUMBER = 11  # "+4294967295"
_BITS = {"B": 8, "H": 16, "I": 32, "h": 16, "i": 32}
SAMPLE: dict[str, type[np.uint8 | np.uint16]] = {"B": np.uint8, "H": np.uint16}
BIG_ENDIAN: dict[str, np.dtype[Any]] = {"B": np.dtype(np.uint8), "H": np.dtype(">u2")}


class Reader(Protocol):
    """Takes parameters off the front of a telegram's body; raises TimMalformedError where they don't fit."""

    def take(self, layout: str) -> tuple[Any, ...]:
        """The next numbers; `layout` without `S`."""

    def tag(self, length: int) -> str:
        """The next fixed-length name, such as `DIST1`."""

    def string(self) -> str:
        """The next string (latin-1, so that every byte survives)."""

    def samples(self, count: int, letter: str) -> Samples:
        """The next `count` samples of letter `B` or `H`."""

    @property
    def rest(self) -> bytes:
        """What has not been taken yet."""

    @property
    def canonical(self) -> bool:
        """Whether all samples so far were spelt as a device spells them."""


class BinaryReader:
    """CoLa-B parameters: packed, big-endian, nothing in between."""

    __slots__ = ("_at", "_body")

    canonical = True  # there is one way only to write a number

    def __init__(self, body: bytes) -> None:
        self._body = body
        self._at = 0

    def take(self, layout: str) -> tuple[Any, ...]:
        layout = ">" + layout
        return struct.unpack(layout, self._bytes(struct.calcsize(layout)))

    def tag(self, length: int) -> str:
        return self._bytes(length).decode("latin-1")

    def string(self) -> str:
        return self._bytes(int.from_bytes(self._bytes(2))).decode("latin-1")

    def samples(self, count: int, letter: str) -> Samples:
        dtype = BIG_ENDIAN[letter]
        raw: Samples = np.frombuffer(self._bytes(count * dtype.itemsize), dtype)
        return raw.astype(SAMPLE[letter])

    @property
    def rest(self) -> bytes:
        return self._body[self._at :]

    def _bytes(self, count: int) -> bytes:
        taken = self._body[self._at : self._at + count]
        if len(taken) < count:
            raise TimMalformedError(f"{count} bytes expected, {len(taken)} left", Fault.BUFFER_UNDERFLOW)
        self._at += count
        return taken


class TextReader:
    """CoLa-A parameters: blank-separated tokens, except that a string may hold blanks."""

    __slots__ = ("_at", "_body", "canonical")

    def __init__(self, body: bytes) -> None:
        self._body = body
        self._at = 0
        self.canonical = True

    def take(self, layout: str) -> tuple[Any, ...]:
        if len(layout) == 1:
            return (_number(self._token(), layout),)
        if len(layout) >= _WORTHWHILE and (values := self._take_plain(_limits(layout))):
            return values
        return _numbers(tuple([self._token() for _ in layout]), layout)

    def _take_plain(self, limits: tuple[int, ...]) -> tuple[int, ...]:
        """Many unsigned hex numbers at once; none at all if anything about them is unusual."""
        count = len(limits)
        tokens = self._body[self._at : self._at + count * (_LONGEST_NUMBER + 1)].split(BLANK, count)[:count]
        text = BLANK.join(tokens)
        if len(tokens) < count or not all(tokens) or text.translate(None, _HEX_AND_BLANK):
            return ()
        values = tuple([int(token, 16) for token in tokens])
        if any(map(ge, values, limits)):
            return ()
        self._at += len(text) + 1
        return values

    def tag(self, length: int) -> str:
        token = self._token()
        if len(token) != length or CONTROL.search(token):
            raise TimMalformedError(f"a name of {length} characters expected, got {len(token)}")
        return token.decode("latin-1")

    def string(self) -> str:
        length = _number(self._token(), "H")
        end = self._at + length
        text = self._body[self._at : end]
        if len(text) < length:
            raise TimMalformedError(f"a string of {length}, {len(text)} left", Fault.BUFFER_UNDERFLOW)
        if not length:
            return ""
        if CONTROL.search(text):
            raise TimMalformedError("a string with a control character", Fault.INVALID_CHARACTER)
        if end < len(self._body) and self._body[end : end + 1] != BLANK:
            raise TimMalformedError("a string longer than its length says", Fault.INVALID_CHARACTER)
        self._at = end + 1
        return text.decode("latin-1")

    def samples(self, count: int, letter: str) -> Samples:
        values, self._at, canonical = hexwords.parse(self._body, self._at, count, SAMPLE[letter])
        self.canonical &= canonical
        return values.astype(SAMPLE[letter], copy=False)

    @property
    def rest(self) -> bytes:
        return self._body[self._at :]

    def _token(self) -> bytes:
        if self._at >= len(self._body):
            raise TimMalformedError("a parameter is missing", Fault.BUFFER_UNDERFLOW)
        end = self._body.find(BLANK, self._at)
        end = len(self._body) if end < 0 else end
        token = self._body[self._at : end]
        self._at = end + 1
        return token


@lru_cache(maxsize=64)
def _limits(layout: str) -> tuple[int, ...]:
    """What each number must stay below; zero for what is not plainly unsigned."""
    return tuple(1 << _BITS[letter] if letter.isupper() else 0 for letter in layout)


@lru_cache(maxsize=256)
def _numbers(tokens: tuple[bytes, ...], layout: str) -> tuple[Any, ...]:
    """Remembered, for the head of a channel is the same in every telegram."""
    return tuple([_number(token, letter) for token, letter in zip(tokens, layout, strict=True)])


def _number(token: bytes, letter: str) -> Any:
    """One CoLa-A number: hex, or decimal when it carries a sign; a float is the hex of its IEEE-754 word."""
    if letter == "f":
        return struct.unpack(">f", struct.pack(">I", _number(token, "I")))[0]
    bits = _BITS[letter]
    signed = letter.islower()
    if not token or len(token) > _LONGEST_NUMBER:
        raise TimMalformedError(f"{token[:20]!r} is no number", Fault.INVALID_CHARACTER)
    if token[0] in b"+-":
        if not token[1:].isdigit():
            raise TimMalformedError(f"{token!r} is no decimal number", Fault.INVALID_CHARACTER)
        value = int(token)
    elif token.strip(_HEX):
        raise TimMalformedError(f"{token!r} is no hex number", Fault.INVALID_CHARACTER)
    else:
        value = int(token, 16)
        if signed and 1 << (bits - 1) <= value < 1 << bits:
            value -= 1 << bits
    low, high = (-(1 << (bits - 1)), 1 << (bits - 1)) if signed else (0, 1 << bits)
    if not low <= value < high:
        raise TimMalformedError(f"{token!r} does not fit its parameter", Fault.VALUE_OVERFLOW)
    return value
