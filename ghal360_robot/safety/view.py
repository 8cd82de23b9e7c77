"""What the lidar cannot tell: scans that say nothing, and ground that it does not look at.

Behind the robot a quarter of the circle is out of the TiM571's sight. Nothing but a hand on the stick drives into
it, slowly, and only where the robot was or saw free ground a moment ago, with nobody about all the while: a person
who came up from behind meanwhile could not be seen.
"""

from __future__ import annotations

import math
from functools import lru_cache, reduce
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.safety.footprint import STANDSTILL, disc_velocity
from ghal360_robot.safety.sight import beam_step

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ghal360_robot.messages import Surroundings, Twist
    from ghal360_robot.safety.footprint import Disc

AHEAD = math.radians(50)
"""To either side of the way ahead there must be beams, and some of them must come back."""

BLOCKED_SHARE = 0.05
"""A lidar that gets less than this share of its beams back is covered, or faces 25 m of nothing."""

LEAST_BEAMS, COARSE = 16, math.radians(1.05)
"""Fewer beams, or beams further apart, are no scan to drive by: a leg 3 m away is two degrees wide."""

SILENT = math.radians(20.0)
"""So wide a stretch without a single echo may be a hall, a dark wall, or a label on the lidar's window."""

INSIDE_M, INSIDE_SHARE = 0.05, 0.03
"""Returns this far inside the robot's own outline, and the share of beams (8 degrees) that is more than dust."""

FRONT = tuple((math.cos(a), math.sin(a)) for a in map(math.radians, (-75.0, -50.0, -25.0, 0.0, 25.0, 50.0, 75.0)))
"""Directions of points on a disc's leading half that are looked at: neighbours are a fifth of a metre apart."""

FURTHER_M, OWN_M = 0.10, 0.05
"""They are looked at so much further on than the robot needs to stop; what is so close to it is its own ground: the
notches between the discs of an outline sweep slivers along its flanks."""


def scan_fault(around: Surroundings, footprint: Sequence[Disc]) -> str:
    """Why this scan says nothing at all, in words; empty where it does."""
    n = len(around.bearings)
    if n < LEAST_BEAMS or abs(beam_step(around)) > COARSE:
        return "the scan has too few beams"
    if len(around.points) < BLOCKED_SHARE * n:
        return "lidar sees nothing: covered?"
    x0, y0 = around.origin
    outermost = max(math.hypot(disc.x - x0, disc.y - y0) + disc.radius for disc in footprint)
    if np.count_nonzero(around.ranges < outermost) <= INSIDE_SHARE * n:
        return ""  # so few are near enough to be inside: nearly always
    near = around.points[around.ranges[around.beam] < outermost]
    x, y = near[:, 0], near[:, 1]
    inside = [(x - disc.x) ** 2 + (y - disc.y) ** 2 < max(disc.radius - INSIDE_M, 0.0) ** 2 for disc in footprint]
    if np.count_nonzero(reduce(np.logical_or, inside)) > INSIDE_SHARE * n:
        return "lidar sees something on the robot itself: is its window dirty?"
    return ""


def view_ahead(around: Surroundings) -> tuple[str, str]:
    """Why this scan says nothing about the way ahead, or where a wide stretch of it brings no echo: in words.

    The first forbids to drive ahead, the second only to do so fast; empty where there is nothing to say.
    """
    ahead, covered = _ahead(around.bearings.tobytes())
    if not covered:
        return "the scan does not cover the way ahead", ""
    heard = ahead[np.isfinite(around.ranges[ahead])]
    if len(heard) < BLOCKED_SHARE * len(ahead):
        return "lidar sees nothing ahead: covered?", ""
    between = int((heard[1:] - heard[:-1]).max(initial=1))
    most = max(int(heard[0] - ahead[0]), between - 1, int(ahead[-1] - heard[-1]))
    wide = most * abs(beam_step(around))
    return "", f"slow: lidar gets no echo over {math.degrees(wide):.0f} deg ahead" if wide >= SILENT else ""


@lru_cache(maxsize=4)
def _ahead(bearings: bytes) -> tuple[NDArray[np.intp], bool]:
    """The beams to either side of the way ahead, and whether they cover it: the same in every scan of a lidar."""
    yaws = np.frombuffer(bearings)
    ahead = np.flatnonzero(np.abs(yaws) <= AHEAD)
    ahead.setflags(write=False)
    edges = yaws[ahead]
    return ahead, bool(len(edges)) and edges.min() <= -0.9 * AHEAD and edges.max() >= 0.9 * AHEAD


def out_of_sight(around: Surroundings, twist: Twist, parts: Sequence[tuple[Disc, float]]) -> list[tuple[float, float]]:
    """Points of the outline's leading edge that are out of sight and not its own ground.

    `parts` are the discs of the outline, each with the metres that it moves until it stands.
    """
    step = beam_step(around)
    span = abs(step) * (len(around.bearings) - 1)
    first, sign = float(around.bearings[0]), math.copysign(1.0, step)
    hidden = []
    footprint = [disc for disc, _ in parts]
    for disc, way_m in parts:
        vx, vy = disc_velocity(disc, twist)
        speed = math.hypot(vx, vy)
        if speed < STANDSTILL:
            continue
        ux, uy, on_m = vx / speed, vy / speed, way_m + FURTHER_M
        for cos, sin in FRONT:
            x = disc.x + on_m * ux + disc.radius * (cos * ux - sin * uy)
            y = disc.y + on_m * uy + disc.radius * (cos * uy + sin * ux)
            bearing = math.atan2(y - around.origin[1], x - around.origin[0])
            if sign * (bearing - first) % math.tau > span and not _own(x, y, footprint):
                hidden.append((x, y))
    return hidden


def _own(x: float, y: float, footprint: Sequence[Disc]) -> bool:
    return any(math.hypot(x - disc.x, y - disc.y) <= disc.radius + OWN_M for disc in footprint)
