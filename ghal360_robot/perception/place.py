"""Where an object stands, from the directions it was seen in and the lidar's ranges in those directions. Pure.

Every sighting says on which line through the camera the object is, every range roughly how far along it. Both are
linear in the place, so all of them together are one weighted least-squares fit, kept as its normal equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, sin, sqrt

BEARING_SIGMA = 0.035
"""rad (2 degrees): a box's centre wanders by a few pixels, the robot's yaw by less."""
RANGE_SIGMA_M = 0.5
"""The lidar sees what is 0.25 m above the floor: the desk's leg and not the laptop, the wall behind the television."""
FORGETTING = 0.97
"""Kept of the old at every sighting: odometry drifts, things are moved, and repeated errors are not independent."""
FIRST_GUESS_M = 3.0
"""How far away a thing is taken to be before anything is known about it: half a room."""
KNOWN_SIGMA_M = 1.0
"""A place known worse than this is none."""
MIN_DISTANCE_M = 0.3
"""Nothing is nearer to the camera's axis than the robot's own body."""


@dataclass(frozen=True, slots=True)
class Place:
    """Normal equations of the place, odometry frame, metres: the matrix (xx, xy, yy) and the right side (x, y)."""

    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0
    x: float = 0.0
    y: float = 0.0

    def seen(self, camera: tuple[float, float], yaw: float, range_m: float | None = None) -> Place:
        """With one more sighting from `camera` in the direction `yaw`; `range_m` from there to what the lidar met."""
        known = self.position()
        distance = hypot(known[0] - camera[0], known[1] - camera[1]) if known is not None else range_m or FIRST_GUESS_M
        across = 1.0 / (max(distance, MIN_DISTANCE_M) * BEARING_SIGMA) ** 2
        grown = self._faded()._with(-sin(yaw), cos(yaw), across, camera, 0.0)
        if range_m is None:
            return grown
        return grown._with(cos(yaw), sin(yaw), 1.0 / RANGE_SIGMA_M**2, camera, range_m)

    def position(self) -> tuple[float, float] | None:
        """The place, or None while it is not known in both directions."""
        determinant = self.xx * self.yy - self.xy * self.xy
        if determinant <= 0.0 or self.sigma_m() > KNOWN_SIGMA_M:
            return None
        return (
            (self.yy * self.x - self.xy * self.y) / determinant,
            (self.xx * self.y - self.xy * self.x) / determinant,
        )

    def sigma_m(self) -> float:
        """Standard deviation along the worse known direction, m; infinite where nothing is known about it."""
        mean, half = (self.xx + self.yy) / 2, hypot((self.xx - self.yy) / 2, self.xy)
        least = mean - half
        # Below rounding of the larger one it is not known at all.
        return 1.0 / sqrt(least) if least > 1e-9 * (mean + half) and least > 0.0 else float("inf")

    def _faded(self) -> Place:
        return Place(*(FORGETTING * value for value in (self.xx, self.xy, self.yy, self.x, self.y)))

    def _with(self, nx: float, ny: float, weight: float, camera: tuple[float, float], offset: float) -> Place:
        """With one more equation: `n . (place - camera) = offset`."""
        value = nx * camera[0] + ny * camera[1] + offset
        return Place(
            self.xx + weight * nx * nx,
            self.xy + weight * nx * ny,
            self.yy + weight * ny * ny,
            self.x + weight * nx * value,
            self.y + weight * ny * value,
        )
