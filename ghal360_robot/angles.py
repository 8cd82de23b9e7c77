"""One angle, wrapped. Arrays of them: `perception.sphere.wrap_angle`."""

from __future__ import annotations

import math


def wrap(angle: float) -> float:
    """The same direction in [-pi, pi), radians."""
    wrapped = (angle + math.pi) % math.tau - math.pi
    # The modulo of a tiny negative number rounds up to the modulus itself.
    return -math.pi if wrapped >= math.pi else wrapped
