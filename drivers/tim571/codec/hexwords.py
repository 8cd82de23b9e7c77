"""Long runs of CoLa-A hex numbers, without a Python loop over the samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.tim571.codec.faults import Fault
from drivers.tim571.errors import TimMalformedError

_BLANK = 0x20
_DIGITS = b"0123456789ABCDEF "
_WIDEST = 4
_PAD = b" " * (_WIDEST - 1)
# By a number's width and its blank: the bytes that are its own among the four before the blank behind it.
_OWN = np.array([0, 0, 0xFF000000, 0xFFFF0000, 0xFFFFFF00, 0xFFFFFFFF], np.uint32)
_NIBBLES = bytes.maketrans(b"0123456789ABCDEF", bytes(range(16)))
_PAIRS = np.uint32(0x00FF00FF)
_FOUR = np.dtype("<u4")
_SPELT = np.array([1] * 0x10 + [2] * 0xF0 + [3] * 0xF00 + [4] * 0xF000, np.uint8)  # digits by value


class Words(NamedTuple):
    """Numbers read, where the token behind them starts, and whether they were spelt as a device spells them."""

    values: NDArray[np.uint16]
    end: int
    canonical: bool
    """Upper-case and without leading zeros; a damaged digit often is neither."""


def parse(text: bytes, start: int, count: int, dtype: type[np.uint8 | np.uint16]) -> Words:
    """Read `count` blank-separated hex numbers from `text[start:]`.

    Raises TimMalformedError where there are fewer, or one is no hex number or too wide for `dtype`.
    """
    widest = 2 * np.dtype(dtype).itemsize
    if not count:
        return Words(np.zeros(0, np.uint16), start, canonical=True)
    run = _PAD + text[start : start + count * (widest + 1)]
    blanks = np.frombuffer(run, np.uint8, offset=len(_PAD)) == _BLANK
    ends = blanks.nonzero()[0][:count]
    if len(ends) < count:
        if len(ends) < count - 1 or start + len(blanks) < len(text):
            raise TimMalformedError(f"{count} samples announced, {len(ends)} found", Fault.BUFFER_UNDERFLOW)
        ends = np.append(ends, len(blanks))
    widths = np.empty(count, np.intp)  # with the blank behind
    widths[0] = ends[0] + 1
    np.subtract(ends[1:], ends[:-1], out=widths[1:])
    if widths.min() < 2:
        raise TimMalformedError("an empty sample", Fault.INVALID_CHARACTER)
    if widths.max() > widest + 1:
        raise TimMalformedError("a sample is too wide", Fault.VALUE_OVERFLOW)
    size = int(ends[-1])
    if run[: len(_PAD) + size].translate(None, _DIGITS):
        return _parse_lower_case(text, start, size, count, dtype)
    # The four digits before each blank as one word, however it is aligned; the last one is its highest byte.
    every_four: NDArray[np.uint32] = np.ndarray((len(run) - len(_PAD),), _FOUR, run.translate(_NIBBLES), strides=(1,))
    four = every_four[ends - 1]
    four &= _OWN[widths]
    pairs = four << 4
    four >>= 8
    pairs |= four
    pairs &= _PAIRS
    values = (pairs << 8 | pairs >> 16).astype(np.uint16)
    spelt = int(_SPELT[values].sum()) + count - 1
    return Words(values, start + size + 1, canonical=size == spelt)


def _parse_lower_case(text: bytes, start: int, size: int, count: int, dtype: type[np.uint8 | np.uint16]) -> Words:
    upper = text[start : start + size].upper()
    if upper.translate(None, _DIGITS):
        raise TimMalformedError("a sample is not a hex number", Fault.INVALID_CHARACTER)
    values, _, _ = parse(upper, 0, count, dtype)
    return Words(values, start + size + 1, canonical=False)


def build(values: NDArray[np.unsignedinteger]) -> bytes:
    """The values as blank-separated upper-case hex without leading zeros."""
    numbers = values.tolist()
    return " ".join(["%X"] * len(numbers)).encode() % tuple(numbers)
