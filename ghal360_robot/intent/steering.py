"""The free heading nearest to the wanted one, from one lidar scan (in the manner of a vector field histogram).

Every point forbids one interval of headings: those along which a disc robot would touch it within the
look-ahead. The union of these intervals is found by sorting, so the answer is exact and needs no grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.angles import wrap

GRAZE = 1e-6
"""Radians by which an interval is widened, so that a tangent heading touches nothing by rounding."""


@dataclass(frozen=True, slots=True)
class SteeringSettings:
    """The robot as a disc, and how far it may be led off the wanted heading."""

    radius_m: float = 0.40
    margins_m: tuple[float, ...] = (0.12, 0.05, 0.02)
    """Distances to keep, the comfortable one first; the next counts only where nothing else is free."""
    look_ahead_m: tuple[float, ...] = (1.2, 0.8, 0.5, 0.3)
    """Free distance asked of a heading, longest first; a way into a door is free for short stretches only."""
    shortness: float = math.radians(40)
    """Cost in radians of heading per metre that a way is shorter than the longest look-ahead."""
    sweep: float = math.radians(60)
    """No further off the wanted heading than this; rather stop than go somewhere else."""
    pad: float = math.radians(5)
    """Keep this far from the ends of a gap, or to the middle of a narrow one."""
    loyalty: float = 0.3
    """Cost of leaving the previous heading, relative to that of leaving the wanted one."""

    def __post_init__(self) -> None:
        if not self.look_ahead_m or not self.margins_m or min(self.radius_m, *self.look_ahead_m) <= 0:
            raise ValueError("Steering needs a margin, and a positive radius and look-aheads.")
        if min(*self.margins_m, self.pad, self.loyalty, self.shortness) < 0:
            raise ValueError("Margins, pad and costs must not be negative.")
        if not 0 <= self.sweep <= math.pi / 2:
            raise ValueError(f"The sweep must be at most a quarter turn to each side, not {self.sweep} rad.")


def choose_heading(
    settings: SteeringSettings,
    desired: float,
    points: NDArray[np.floating],
    previous: float | None = None,
) -> float | None:
    """The free heading (rad CCW, base frame, in [-pi, pi)) nearest to `desired`, or None if all are blocked.

    `points` (N, 2) are metres in the base frame; rows that are not finite are ignored, and so are points
    that the robot moves away from. `previous` is the heading chosen last, in today's base frame.
    """
    x, y = np.asarray(points, dtype=np.float64).reshape(-1, 2).T
    distance = np.hypot(x, y)
    near = distance < max(settings.look_ahead_m) + settings.radius_m + max(settings.margins_m)  # false for NaN
    distance, bearing = distance[near], np.arctan2(y[near], x[near]) - desired
    loyal = 0.0 if previous is None else wrap(previous - desired)
    loyalty = 0.0 if previous is None else settings.loyalty
    for margin in settings.margins_m:
        options: list[tuple[float, float]] = []
        for reach in settings.look_ahead_m:
            detour = settings.shortness * (max(settings.look_ahead_m) - reach)
            for low, high in _free_gaps(settings, bearing, distance, settings.radius_m + margin, reach):
                # The sum of two distances is least at one of the two, or at an end of the gap.
                for offset in (min(max(0.0, low), high), min(max(loyal, low), high)):
                    cost = abs(offset) + loyalty * abs(offset - loyal) + detour
                    options += [(cost, offset)]
        if options:
            return wrap(desired + min(options)[1])
    return None


def _free_gaps(
    settings: SteeringSettings,
    bearing: NDArray[np.float64],
    distance: NDArray[np.float64],
    radius: float,
    reach: float,
) -> list[tuple[float, float]]:
    """Intervals of offsets within the sweep along which a disc moves `reach` metres freely, padded."""
    relevant = distance < reach + radius
    centres = (bearing[relevant] + math.pi) % math.tau - math.pi
    halves = _forbidden(np.maximum(distance[relevant], radius), radius, reach)
    # With at most a quarter turn of sweep and of half width no interval reaches the sweep from behind.
    starts, ends = centres - halves, centres + halves
    order = np.argsort(starts)
    starts = np.concatenate([starts[order], [np.inf]])
    ends = np.maximum.accumulate(np.concatenate([[-settings.sweep], ends[order]]))
    free = (ends <= starts) & (ends <= settings.sweep) & (starts >= -settings.sweep)
    low, high = ends[free], np.minimum(starts[free], settings.sweep)
    middle = (low + high) / 2
    low, high = np.minimum(low + settings.pad, middle), np.maximum(high - settings.pad, middle)
    return list(zip(low.tolist(), high.tolist(), strict=True))


def _forbidden(distance: NDArray[np.float64], radius: float, reach: float) -> NDArray[np.float64]:
    """Half width of the headings along which a disc touches a point at `distance` within `reach`."""
    # Beside the path the robot's flank would touch the point, beyond its end the front.
    flank = np.arcsin(radius / distance)
    front = np.arccos(np.clip((distance**2 + reach**2 - radius**2) / (2 * distance * reach), -1.0, 1.0))
    return np.where(distance**2 <= reach**2 + radius**2, flank, front) + GRAZE
