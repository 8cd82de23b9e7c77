"""Scans that are kept for a second, to ask of a place: was it seen to be free then?

Everything that makes two scans of a world at rest differ is on the safe side here: a place counts as seen free
only if all beams around its direction passed it by clearly, so that noise, the base's motion during a sweep,
late odometry, a lidar mounted a little askew and the thinnest chair leg do not make things appear to move.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.frames import place_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ghal360_robot.messages import Pose2, Surroundings

    Floats = NDArray[np.float64]

SWEEP_S = 0.050
"""From a TiM571's first beam to its last: 270 of 360 degrees at 15 Hz. The stamp is the last beam's."""

MIDDLE_NS = 25_000_000
"""The middle of the sweep is half of it before the stamp; the pose of that instant stands for all beams."""

ASTRAY = 0.035
"""rad: how far a direction may be out: 3 cm of place at 1 m, or odometry and mounting after half a turn."""

ASTRAY_SOON = 0.0175
"""rad: the same from one scan to another a quarter of a second later, in which odometry and mounting are out alike.
Who comes out from behind an edge is then hidden by its neighbourhood for a scan less."""

PASSED_M = 0.08
"""A beam that went this much further passed a place: four sigma of a smoothed range and 3 cm of odometry."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """One scan in the odometry frame: where the lidar was, and how far each direction was free.

    `free` (n,) metres is the least range of all beams within `ASTRAY`, NaN where one of them saw nothing;
    `free_soon` (n,) that of those within `ASTRAY_SOON`.
    """

    stamp_ns: int
    x: float
    y: float
    yaw: float
    free: NDArray[np.float32]
    free_soon: NDArray[np.float32]
    first: float
    """Direction of the first beam in the base frame."""
    step: float
    """Angle from beam to beam; negative where they run clockwise."""

    def soon(self) -> Look:
        """This scan for a comparison with one that was taken soon after it."""
        return Look(self.stamp_ns, self.x, self.y, self.yaw, self.free_soon, self.free_soon, self.first, self.step)


def beam_step(around: Surroundings) -> float:
    """Angle between two beams, negative where they run clockwise; 0 for a scan of fewer than two."""
    bearings = around.bearings
    if len(bearings) < 2:
        return 0.0
    sign = math.copysign(1.0, math.remainder(float(bearings[1] - bearings[0]), math.tau))
    return sign * (sign * float(bearings[-1] - bearings[0]) % math.tau) / (len(bearings) - 1)


def look(around: Surroundings, pose: Pose2, turning: float) -> Look:
    """Keep a scan taken at `pose` (middle of its sweep) by a base that turned at `turning` rad/s."""
    step = beam_step(around)
    aside = abs(turning) * SWEEP_S / 2
    width, narrow = (math.ceil((astray + aside) / abs(step)) if step else 0 for astray in (ASTRAY, ASTRAY_SOON))
    x, y = place_of(pose, around.origin)
    return Look(
        around.stamp_ns,
        x,
        y,
        pose.yaw,
        least_around(around.raw, width),
        least_around(around.raw, narrow),
        float(around.bearings[0]) if len(around.bearings) else 0.0,
        step,
    )


def least_around(ranges: NDArray[np.float32], width: int) -> NDArray[np.float32]:
    """Each range replaced by the least within `width` neighbours to either side; 0 near the ends of the scan.

    NaN where one of them is.
    """
    n = len(ranges)
    least = np.zeros(n, np.float32)
    if n <= 2 * width:
        return least
    window, span = ranges, 1
    while 2 * span <= 2 * width + 1:
        window = np.minimum(window[:-span], window[span:])
        span *= 2
    rest = 2 * width + 1 - span
    least[width : n - width] = np.minimum(window[: n - 2 * width], window[rest:]) if rest else window
    return least


def seen_free(looks: Sequence[Look], points: Floats, turning: float = 0.0) -> NDArray[np.bool_]:
    """Whether each of `points` (n, 2), odometry frame, lay in ground that a scan saw through: (looks, n).

    `turning` (rad/s) is that of the base while the points were measured: they are out by as much of a sweep.
    """
    useful = [past for past in looks if past.step]
    if not useful or len(points) == 0:
        return np.zeros((0, len(points)), bool)
    # All scans at once, and in single precision: that is a hundredth of a beam here.
    where = np.array([(past.x, past.y, past.yaw + past.first, past.step, len(past.free)) for past in useful])
    dx = (points[:, 0] - where[:, 0:1]).astype(np.float32)
    dy = (points[:, 1] - where[:, 1:2]).astype(np.float32)
    far = np.sqrt(dx * dx + dy * dy) + np.float32(PASSED_M)
    step = where[:, 3:4].astype(np.float32)
    turns = (np.arctan2(dy, dx) - where[:, 2:3].astype(np.float32)) * (np.sign(step) / np.float32(math.tau))
    beam = np.rint((turns - np.floor(turns)) * (np.float32(math.tau) / np.abs(step))).astype(np.intp)
    last = where[:, 4:5].astype(np.intp) - 1
    inside = beam <= last
    np.minimum(beam, last, out=beam)  # a direction before the first beam comes out as almost a whole turn
    free = _stacked(useful)
    row = np.arange(len(useful))[:, None] * free.shape[1]
    passed: NDArray[np.bool_] = inside & (free.take(row + beam) > far)
    aside = math.ceil(abs(turning) * SWEEP_S / 2 / float(np.abs(where[:, 3]).min()))
    if aside:
        passed &= free.take(row + np.maximum(beam - aside, 0)) > far
        passed &= free.take(row + np.minimum(beam + aside, last)) > far
    return passed


def _stacked(looks: Sequence[Look]) -> NDArray[np.float32]:
    """The free ranges of several scans, row by row; shorter ones end in nothing free."""
    rows = np.zeros((len(looks), max(len(past.free) for past in looks)), np.float32)
    for n, past in enumerate(looks):
        rows[n, : len(past.free)] = past.free
    return rows
