"""Long runs of CoLa-A hex numbers, without a Python loop over the samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.tim571.codec.faults import Fault
from drivers.tim571.errors import TimMalformedError

_BLANK = 0x20
_NOT_HEX = 0x80
_LOWER = 0x40
_DIGITS = np.full(256, _NOT_HEX, np.uint8)
for _value, _character in enumerate(b"0123456789ABCDEF"):
    _DIGITS[_character] = _value
for _character in b"abcdef":
    _DIGITS[_character] = _LOWER | int(chr(_character), 16)


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
    values = np.zeros(count, np.uint16)
    if not count:
        return Words(values, start, canonical=True)
    window = np.frombuffer(text, np.uint8)[start : start + count * (widest + 1)]
    ends = np.flatnonzero(window == _BLANK)[:count]
    if len(ends) < count:
        if len(ends) < count - 1 or start + len(window) < len(text):
            raise TimMalformedError(f"{count} samples announced, {len(ends)} found", Fault.BUFFER_UNDERFLOW)
        ends = np.append(ends, len(window))
    widths = np.diff(ends, prepend=-1) - 1
    if widths.min() < 1:
        raise TimMalformedError("an empty sample", Fault.INVALID_CHARACTER)
    if widths.max() > widest:
        raise TimMalformedError("a sample is too wide", Fault.VALUE_OVERFLOW)
    digits = _DIGITS[window]
    bad = 0
    for place in range(widest):
        # Where a number is shorter, the index points into its neighbour and is masked to zero.
        digit = np.where(widths > place, digits[ends - 1 - place], 0)
        bad |= int(digit.max())
        values |= digit.astype(np.uint16) << np.uint16(4 * place)
    if bad >= _LOWER:
        if bad & _NOT_HEX:
            raise TimMalformedError("a sample is not a hex number", Fault.INVALID_CHARACTER)
        again = parse(text[: start + len(window)].upper(), start, count, dtype)
        return again._replace(canonical=False)
    end = int(ends[-1]) + 1
    shortest = 2 * count + sum(int(np.count_nonzero(values >= 1 << 4 * place)) for place in range(1, widest))
    return Words(values, start + end, canonical=end == shortest)


def build(values: NDArray[np.unsignedinteger]) -> bytes:
    """The values as blank-separated upper-case hex without leading zeros."""
    numbers = values.tolist()
    return " ".join(["%X"] * len(numbers)).encode() % tuple(numbers)
