"""Long runs of CoLa-A hex numbers, without a Python loop over the samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.tim571.codec.faults import Fault
from drivers.tim571.errors import TimMalformedError

_BLANK = 0x20
_NOT_HEX = 0x80
_DIGITS = np.full(256, _NOT_HEX, np.uint8)
for _value, _pair in enumerate(zip("0123456789abcdef", "0123456789ABCDEF", strict=True)):
    for _character in _pair:
        _DIGITS[ord(_character)] = _value


def parse(text: bytes, start: int, count: int, dtype: type[np.uint8 | np.uint16]) -> tuple[NDArray[np.uint16], int]:
    """Read `count` blank-separated hex numbers from `text[start:]`; return them and where the next token starts.

    Raises TimMalformedError where there are fewer, or one is no hex number or too wide for `dtype`.
    """
    widest = 2 * np.dtype(dtype).itemsize
    values = np.zeros(count, np.uint16)
    if not count:
        return values, start
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
    if bad & _NOT_HEX:
        raise TimMalformedError("a sample is not a hex number", Fault.INVALID_CHARACTER)
    return values, start + int(ends[-1]) + 1


def build(values: NDArray[np.unsignedinteger]) -> bytes:
    """The values as blank-separated upper-case hex without leading zeros."""
    numbers = values.tolist()
    return " ".join(["%X"] * len(numbers)).encode() % tuple(numbers)
