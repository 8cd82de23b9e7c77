"""From a velocity in REP-103 signs to the pair on the wire, and back (fact sheet 3.3).

A base of the 0x500 family scales a normalised command by its own stored limits and turns clockwise for
positive yaw; a V3 base takes m/s and rad/s as they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.rmp110.errors import RmpBadCommand


@dataclass(frozen=True, slots=True)
class MotionScale:
    """What a velocity is divided by, and what it is clamped to.

    `stored_*` are the base's F-RAM limits, `max_*` the configured ones. `track_ratio` is the true track
    over the stored one: a base that refuses the 110's track turns too fast or too slow by that ratio.
    """

    stored_v_mps: float
    stored_w_rps: float
    max_v_mps: float
    max_w_rps: float
    track_ratio: float = 1.0

    def __post_init__(self) -> None:
        values = (self.stored_v_mps, self.stored_w_rps, self.max_v_mps, self.max_w_rps, self.track_ratio)
        if not all(math.isfinite(value) and value > 0 for value in values):
            raise RmpBadCommand(f"motion limits must be positive numbers, got {values}")


@dataclass(frozen=True, slots=True)
class Normalised:
    """A command on the wire (`velocity`, `yaw_rate`: -1..1 and clockwise, or SI as it is) and what it means.

    `v`, `w`: SI, REP-103.
    """

    velocity: float
    yaw_rate: float
    v: float
    w: float


def normalise(v: float, w: float, scale: MotionScale) -> Normalised:
    """Clamp `v` m/s and `w` rad/s (counter-clockwise) to every limit and scale them for the 0x500 family's wire.

    Raises RmpBadCommand where a value is not a finite number: such a command is dropped, not guessed at.
    """
    v, w = _limited(v, w, scale)
    # `0.0 +` and `0.0 -` rather than a sign: a zero command is then eight zero bytes, not minus zero.
    velocity = 0.0 + _clamp(v / scale.stored_v_mps, 1.0)
    yaw_rate = 0.0 - _clamp(w * scale.track_ratio / scale.stored_w_rps, 1.0)
    applied_w = 0.0 - yaw_rate * scale.stored_w_rps / scale.track_ratio
    return Normalised(velocity, yaw_rate, velocity * scale.stored_v_mps, applied_w)


def in_si(v: float, w: float, scale: MotionScale) -> Normalised:
    """The same for a V3 base, which takes m/s and rad/s, counter-clockwise (fact sheet section 11)."""
    v, w = _limited(v, w, scale)
    velocity = 0.0 + _clamp(v, scale.stored_v_mps)
    yaw_rate = 0.0 + _clamp(w * scale.track_ratio, scale.stored_w_rps)
    return Normalised(velocity, yaw_rate, velocity, yaw_rate / scale.track_ratio)


def _limited(v: float, w: float, scale: MotionScale) -> tuple[float, float]:
    if not (math.isfinite(v) and math.isfinite(w)):
        raise RmpBadCommand(f"velocity ({v} m/s, {w} rad/s) is not a finite number; the command was dropped")
    return _clamp(v, scale.max_v_mps), _clamp(w, scale.max_w_rps)


def _clamp(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
