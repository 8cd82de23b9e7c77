"""A scan's numbers in the smallest form that gives back every bit.

Devices measure in whole millimetres and count echoes in 8 or 16 bits. Where the metres of a scan are the
float32 nearest to whole millimetres, the millimetres are stored (0 for NaN); otherwise the float32 itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float32]


def millimetres(ranges: Floats) -> NDArray[np.uint16] | None:
    """Whole millimetres of `ranges` (n,) in metres, 0 for NaN; None where that would lose a bit."""
    scaled = np.nan_to_num(np.rint(ranges.astype(np.float64) * 1000.0), nan=0.0, posinf=-1.0, neginf=-1.0)
    if scaled.size and (scaled.min() < 0 or scaled.max() > np.iinfo(np.uint16).max):
        return None
    whole = scaled.astype(np.uint16)
    return whole if np.array_equal(metres(whole), ranges, equal_nan=True) else None


def metres(whole: NDArray[np.uint16]) -> Floats:
    """The inverse of `millimetres`: float32 metres, NaN for 0."""
    ranges = (whole.astype(np.float64) / 1000.0).astype(np.float32)
    ranges[whole == 0] = np.nan
    return ranges


def counts(rssi: Floats, dtype: type[np.unsignedinteger]) -> NDArray[np.unsignedinteger] | None:
    """`rssi` as whole numbers of `dtype`; None where that would lose a bit."""
    if rssi.size and not (np.isfinite(rssi).all() and rssi.min() >= 0 and rssi.max() <= np.iinfo(dtype).max):
        return None
    whole = rssi.astype(dtype)
    return whole if np.array_equal(whole.astype(np.float32), rssi) else None
