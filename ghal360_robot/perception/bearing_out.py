"""Which sightings bear out a question to the operator: strong ones, of things that measure what they should. Pure.

A weak sighting is enough to remember a thing, as from nearer it will be known better; pointed at and asked about
is only what was seen well. How large a thing is follows from the angle it covers and the lidar's range below it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi, tan
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ghal360_robot.messages import Detection

ASK_SCORE = 0.45
"""Half again what small networks report things from (0.3): below, rooms without the thing have about as many."""
FOOT_M = (-0.25, 0.35)
"""Where the foot of a box falls, seen at the lidar's range, that shows a thing which the lidar itself met (its plane is
at 0.25 m); higher up, or below the floor, the range is of something beneath or beyond, and no thing is too large."""
WIDEST = 0.8 * pi
"""rad. A box around half of the robot has no size."""


@dataclass(frozen=True, slots=True)
class AskSettings:
    """How good a sighting has to be."""

    score: float = ASK_SCORE
    score_class: Mapping[str, float] = field(default_factory=dict)
    """Other values of `score` by class."""
    sizes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Metres that the longer side of a class measures, at least and at most."""
    camera_height: float = 1.2
    """m above the floor."""

    def bears_out(self, name: str, found: Detection, range_m: float | None, *, measurable: bool = False) -> bool:
        """Whether a sighting of this class may lead to a question; `range_m` is how far away it is, if known.

        What is `measurable`, as there is a lidar, but not measured, as it is behind the robot, has to wait.
        """
        if found.score < self.score_class.get(name, self.score):
            return False
        bounds, angle = self.sizes.get(name), max(found.width, found.height)
        if bounds is None:
            return True
        if range_m is None:
            return not measurable
        return angle <= WIDEST and self._fits(bounds, found, angle, range_m)

    def _fits(self, bounds: tuple[float, float], found: Detection, angle: float, range_m: float) -> bool:
        size = 2 * range_m * tan(angle / 2)
        foot = self.camera_height + range_m * tan(max(found.pitch - found.height / 2, -WIDEST / 2))
        met = FOOT_M[0] <= foot <= FOOT_M[1]
        return size >= bounds[0] and (not met or size <= bounds[1])
