"""A TiM571 that turns while the robot moves: each part of a sweep sees the world, and legs, of its own instant."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drivers.tim571.geometry import BEAM_YAW, FARTHEST_M, NEAREST_M, SCAN_RATE_HZ
from ghal360_robot.messages import LidarScan
from ghal360_robot.simulation.raycast import Shapes
from ghal360_robot.simulation.rooms import CEILING_M
from ghal360_robot.simulation.view import LIDAR_AHEAD_M

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ghal360_robot.messages import Pose2
    from ghal360_robot.simulation.world import World

    Floats = NDArray[np.float64]

NOISE_M = 0.020
"""Standard deviation of one range (data sheet of the TiM571: 20 mm)."""
STEP_NS = 10_000_000
"""The simulation's step, and the part of a sweep that is measured from one place."""
PARTS = 5
"""270 of 360 degrees at 15 Hz: 50 ms from the first beam to the last."""
DELAY_NS = 10_000_000
"""From the last beam to the last byte (fact sheet)."""

YAWS = np.array_split(np.asarray(BEAM_YAW, np.float64), PARTS)


@dataclass(frozen=True, slots=True)
class Sweep:
    """One scan on its way to the robot; `beams_on` (circles,) says how many beams ended on each moving circle."""

    scan: LidarScan
    arrival_ns: int
    beams_on: NDArray[np.intp]


class SweepingLidar:
    """`step` it every `STEP_NS` with where everything is; it returns a sweep when its last byte is out."""

    def __init__(self, world: World, rng: np.random.Generator) -> None:
        solid = (item for item in world.objects if item.solid)
        self._shapes = Shapes.of(solid, world.plan.wall_boxes(), CEILING_M)
        self._rng = rng
        self._offset_ns = int(rng.integers(round(1e9 / SCAN_RATE_HZ)))
        self._number = 0
        self._ranges: list[Floats] = []
        self._beams_on: NDArray[np.intp] | None = None
        self._waiting: Sweep | None = None

    def step(self, now_ns: int, pose: Pose2, moving: Callable[[], Floats]) -> Sweep | None:
        """Measure one part; `moving` gives circles (m, 3) of what moves: x, y, radius, world frame, metres."""
        begin_ns = self._offset_ns + round(self._number * 1e9 / SCAN_RATE_HZ)
        if now_ns >= begin_ns:
            self._measure(YAWS[len(self._ranges)], pose, moving())
            if len(self._ranges) == PARTS:
                self._waiting = self._finish(now_ns)
        if self._waiting is not None and now_ns >= self._waiting.arrival_ns:
            sweep, self._waiting = self._waiting, None
            return sweep
        return None

    def _measure(self, yaw: Floats, pose: Pose2, circles: Floats) -> None:
        x, y = pose.x + LIDAR_AHEAD_M * math.cos(pose.yaw), pose.y + LIDAR_AHEAD_M * math.sin(pose.yaw)
        nearest = within(self._shapes, x, y, pose.yaw + yaw).ranges(x, y, pose.yaw + yaw)
        beams_on = np.zeros(len(circles), np.intp)
        if len(circles):
            to_circles = circle_ranges(x, y, pose.yaw + yaw, circles)
            which = to_circles.argmin(axis=1)
            closest = to_circles[np.arange(len(yaw)), which]
            beams_on = np.bincount(which[closest < nearest], minlength=len(circles))
            nearest = np.minimum(nearest, closest)
        self._ranges.append(nearest)
        self._beams_on = beams_on if self._beams_on is None else self._beams_on + beams_on

    def _finish(self, now_ns: int) -> Sweep:
        ranges = np.concatenate(self._ranges)
        ranges += self._rng.normal(0.0, NOISE_M, len(ranges))
        ranges[(ranges < NEAREST_M) | (ranges > FARTHEST_M)] = np.nan
        number = self._number % 65536
        scan = LidarScan(now_ns, ranges.astype(np.float32), BEAM_YAW, number, number, now_ns // 1000)
        beams_on = self._beams_on if self._beams_on is not None else np.zeros(0, np.intp)
        self._number += 1
        self._ranges, self._beams_on = [], None
        return Sweep(scan, now_ns + DELAY_NS, beams_on)


def within(shapes: Shapes, x: float, y: float, yaw: Floats) -> Shapes:
    """Those of the shapes that rays in a sector of ascending directions `yaw` (k,) may meet: half of the work."""
    middle, half = (yaw[0] + yaw[-1]) / 2, (yaw[-1] - yaw[0]) / 2

    def meets(away_x: Floats, away_y: Floats, radius: Floats) -> NDArray[np.bool_]:
        far = np.maximum(np.hypot(away_x, away_y), 1e-9)
        off = np.abs((np.arctan2(away_y, away_x) - middle + math.pi) % math.tau - math.pi)
        found: NDArray[np.bool_] = (far <= radius) | (off <= half + np.arcsin(np.minimum(radius / far, 1.0)) + 1e-6)
        return found

    boxes, rounds = shapes.boxes, shapes.rounds
    reach = np.hypot(boxes[:, 4], boxes[:, 5])
    return Shapes(
        boxes[meets(boxes[:, 0] - x, boxes[:, 1] - y, reach)],
        rounds[meets(rounds[:, 0] - x, rounds[:, 1] - y, rounds[:, 2])],
    )


def circle_ranges(x: float, y: float, yaw: Floats, circles: Floats) -> Floats:
    """(k, m) distance from a point along each direction `yaw` (k,) to each circle (m, 3); inf where it misses."""
    away_x, away_y = circles[:, 0] - x, circles[:, 1] - y
    dx, dy = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    along = dx * away_x + dy * away_y
    aside = dx * away_y - dy * away_x
    half = np.sqrt(np.maximum(circles[:, 2] ** 2 - aside**2, 0.0))
    meets = (np.abs(aside) < circles[:, 2]) & (along + half > 0.0)
    return np.where(meets, np.maximum(along - half, 0.0), np.inf)
