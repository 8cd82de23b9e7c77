"""Where the beams of a TiM571 point (fact sheet sections 1 and 6).

The device counts its angle counter-clockwise from its right-hand side, 90 degrees being straight ahead; this
driver turns it by a quarter so that zero is ahead (REP-103).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

BEAMS = 811
SCAN_RATE_HZ = 15.0
FIRST_ANGLE_1E4DEG = -450_000
LAST_ANGLE_1E4DEG = 2_250_000
WIRE_STEP_1E4DEG = 3333
"""The wire's rounding of the true 1/3 degree; added up it is 0.027 degrees off at the last beam."""
BEAMS_PER_DEGREE = 3
NEAREST_M = 0.05
FARTHEST_M = 25.0
_AHEAD_DEG = 90.0


def _frozen(yaw: NDArray[np.float64]) -> NDArray[np.float32]:
    rounded = yaw.astype(np.float32)
    rounded.flags.writeable = False
    return rounded


BEAM_YAW: NDArray[np.float32] = _frozen(np.radians(np.arange(BEAMS) / BEAMS_PER_DEGREE - 135.0))
"""(811,) radians, -135 to +135 degrees, counter-clockwise, zero ahead; not writeable."""


@lru_cache(maxsize=16)
def beam_yaw(start_1e4deg: int, step_1e4deg: int, count: int) -> NDArray[np.float32]:
    """(count,) radians for a channel's start and step as on the wire; not writeable.

    A step of 3333 is read as 1/3 degree, and the start as the beam it can only mean.
    """
    if step_1e4deg == WIRE_STEP_1E4DEG:
        first = round((start_1e4deg - FIRST_ANGLE_1E4DEG) * BEAMS_PER_DEGREE / 10_000)
        if first >= 0 and first + count <= BEAMS:
            return BEAM_YAW[first : first + count]
    degrees = (start_1e4deg + step_1e4deg * np.arange(count)) / 10_000 - _AHEAD_DEG
    return _frozen(np.radians(degrees))


@lru_cache(maxsize=16)
def beam_lags_s(start_1e4deg: int, step_1e4deg: int, count: int, rate_hz: float) -> NDArray[np.float32]:
    """(count,) seconds from the last beam of the revolution (at 225 degrees) to each beam, zero or negative.

    The mirror turns evenly: 61.7 us a beam at 15 Hz, 50 ms for all 811; not writeable.
    """
    yaw = beam_yaw(start_1e4deg, step_1e4deg, count).astype(np.float64)
    last = math.radians(LAST_ANGLE_1E4DEG / 10_000 - _AHEAD_DEG)
    return _frozen((yaw - last) / (math.tau * rate_hz))


def sweep_s(rate_hz: float) -> float:
    """From the first beam to the last of a whole revolution: 50 ms at 15 Hz."""
    return (LAST_ANGLE_1E4DEG - FIRST_ANGLE_1E4DEG) / 3_600_000 / rate_hz


def beam_index(angle_1e4deg: int) -> int:
    """The beam nearest to a device angle; may lie outside 0..810."""
    return math.floor((angle_1e4deg - FIRST_ANGLE_1E4DEG) * BEAMS_PER_DEGREE / 10_000 + 0.5)
