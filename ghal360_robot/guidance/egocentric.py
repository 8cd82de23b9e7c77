"""The operator's surroundings as eight wedges, numbered clockwise from the gaze, and their 16-bit code.

Bearings in this module are clockwise (a compass's sense): a bearing is `-yaw` of REP-103. Wedge k is
centred on bearing 45*k degrees. Egocentric W_0 is the wedge the operator focuses on and W_i the i-th to
its right; the code is `sum_i W_i * 4**i`. Functions on codes take one int or an integer array.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.angles import wrap

if TYPE_CHECKING:
    from collections.abc import Sequence

N_WEDGES = 8
WEDGE_WIDTH = math.tau / N_WEDGES
N_CODES = 1 << 2 * N_WEDGES

EMPTY = 0
"""w0 of the paper: nothing of interest."""
CLUTTER = 1
"""w1: objects that resemble the target or occlude; also the bit that says so."""
TARGET = 2
"""w2: the target alone; also the bit that says so."""
BOTH = CLUTTER | TARGET
"""w3: the target among clutter."""

BORDER_SNAP = 1e-9
"""In wedges. Borders written in degrees differ from those in radians by 1e-15; they must fall one way."""

Code = TypeVar("Code", int, NDArray[np.int64])


def wedge_of(bearing: float) -> int:
    """The wedge 0..7 that a clockwise bearing in radians falls into.

    A border belongs to the wedge on its right: +22.5 degrees is wedge 1 and -22.5 degrees is wedge 0.
    Raises ValueError for a bearing that is not finite.
    """
    if not math.isfinite(bearing):
        raise ValueError(f"A bearing must be a finite angle in radians, not {bearing}.")
    # The first modulo keeps bearings of many turns as exact at the borders as those of one.
    return math.floor(wrap(bearing) / WEDGE_WIDTH + 0.5 + BORDER_SNAP) % N_WEDGES


def wedge_centre(wedge: int) -> float:
    """The clockwise bearing of a wedge's centre in [-pi, pi)."""
    return wrap(wedge * WEDGE_WIDTH)


def wedge_offset(origin: int, wedge: int) -> int:
    """Wedges to turn from `origin` to `wedge` on the shorter side, right positive: -3..4."""
    return (wedge - origin + N_WEDGES // 2 - 1) % N_WEDGES - (N_WEDGES // 2 - 1)


def wedge_distance(a: int, b: int) -> int:
    """Wedges between two wedges on the shorter side: 0..4."""
    return abs(wedge_offset(a, b))


def sticky_wedge(bearing: float, previous: int | None, margin: float) -> int:
    """`wedge_of`, but staying in `previous` until the bearing is more than `margin` radians outside it."""
    wedge = wedge_of(bearing)
    if previous is None or wedge == previous:
        return wedge
    outside = abs(wrap(bearing - wedge_centre(previous))) - WEDGE_WIDTH / 2
    return wedge if outside > margin else previous


def egocentric(allocentric: Sequence[int], head_wedge: int) -> tuple[int, ...]:
    """Wedge values as seen from the head: `W_i = A[(head + i) mod 8]`."""
    return tuple(allocentric[(head_wedge + i) % N_WEDGES] for i in range(N_WEDGES))


def encode(wedges: Sequence[int]) -> int:
    """The 16-bit code of eight wedge values. Raises ValueError unless there are eight of 0..3."""
    if len(wedges) != N_WEDGES or not all(EMPTY <= value <= BOTH for value in wedges):
        raise ValueError(f"A wedge state is {N_WEDGES} values of 0..3, not {tuple(wedges)}.")
    return sum(int(value) << 2 * i for i, value in enumerate(wedges))


def decode(code: int) -> tuple[int, ...]:
    """The wedge values W_0..W_7 of a code. Raises ValueError unless it is in 0..65535."""
    if not 0 <= code < N_CODES:
        raise ValueError(f"A wedge code is in 0..{N_CODES - 1}, not {code}.")
    return tuple(code >> 2 * i & 3 for i in range(N_WEDGES))


def rotate_right(code: Code) -> Code:
    """The code after the head turned one wedge to the right: the old W_1 is the new W_0."""
    return code >> 2 | (code & 3) << 2 * (N_WEDGES - 1)


def rotate_left(code: Code) -> Code:
    """The code after the head turned one wedge to the left: the old W_7 is the new W_0."""
    shifted: Code = code << 2 & (N_CODES - 1)
    return shifted | code >> 2 * (N_WEDGES - 1)


def mirror(code: Code) -> Code:
    """The code with left and right exchanged: W_i and W_(8-i) swap, W_0 and W_4 stay."""
    mirrored: Code = code & 3
    for i in range(1, N_WEDGES):
        mirrored = mirrored | (code >> 2 * i & 3) << 2 * (N_WEDGES - i)
    return mirrored


def nearest_targets(code: int) -> tuple[int, int] | None:
    """Wedges to turn to the first target on the right and on the left; None where there is no target.

    (0, 0) when the target is in focus. With exactly one target the two add up to 8.
    """
    offsets = [i for i, value in enumerate(decode(code)) if value & TARGET]
    if not offsets:
        return None
    return offsets[0], -offsets[-1] % N_WEDGES if offsets[0] else 0
