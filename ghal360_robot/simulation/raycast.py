"""Distances and lines of sight among boxes and cylinders, vectorised over rays or points."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from ghal360_robot.simulation.objects import WorldObject

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

EPSILON = 1e-12
"""Keeps the slab test's division finite for rays parallel to a face."""


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """Upright boxes and cylinders as arrays: boxes `boxes` (n, 8), cylinders `rounds` (m, 5).

    A box is centre x, y, cosine and sine of its yaw, half width, half depth, bottom, top;
    a cylinder is centre x, y, radius, bottom, top. Metres.
    """

    boxes: Floats
    rounds: Floats

    @classmethod
    def of(
        cls, objects: Iterable[WorldObject], walls: Iterable[tuple[float, float, float, float]], height: float
    ) -> Self:
        """The shapes of objects, and of walls given as x0, y0, x1, y1 that reach from the floor to `height`."""
        boxes = [
            ((x0 + x1) / 2, (y0 + y1) / 2, 1.0, 0.0, (x1 - x0) / 2, (y1 - y0) / 2, 0.0, height)
            for x0, y0, x1, y1 in walls
        ]
        rounds = []
        for item in objects:
            if item.round:
                rounds.append((item.x, item.y, item.size[0] / 2, item.z, item.top))
            else:
                half = (item.size[0] / 2, item.size[1] / 2)
                boxes.append((item.x, item.y, math.cos(item.yaw), math.sin(item.yaw), *half, item.z, item.top))
        return cls(np.array(boxes, float).reshape(-1, 8), np.array(rounds, float).reshape(-1, 5))

    def ranges(self, x: float, y: float, yaw: Floats) -> Floats:
        """Distance (k,) from one point along each direction `yaw` (k,) to the nearest shape; inf if none."""
        dx, dy = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
        nearest = np.full(yaw.shape, np.inf)
        if len(self.boxes):
            nearest = self._box_ranges(x, y, dx, dy).min(axis=1, initial=np.inf)
        if len(self.rounds):
            nearest = np.minimum(nearest, self._round_ranges(x, y, dx, dy).min(axis=1))
        return nearest

    def _box_ranges(self, x: float, y: float, dx: Floats, dy: Floats) -> Floats:
        cx, cy, cos, sin, hx, hy = self.boxes.T[:6]
        ox, oy = cos * (x - cx) + sin * (y - cy), -sin * (x - cx) + cos * (y - cy)
        inverse_x, inverse_y = 1.0 / _nonzero(dx * cos + dy * sin), 1.0 / _nonzero(dy * cos - dx * sin)
        # Slab test, with |half / direction| instead of sorting the two crossings of each axis.
        middle_x, reach_x = -ox * inverse_x, hx * np.abs(inverse_x)
        middle_y, reach_y = -oy * inverse_y, hy * np.abs(inverse_y)
        enter = np.maximum(middle_x - reach_x, middle_y - reach_y)
        leave = np.minimum(middle_x + reach_x, middle_y + reach_y)
        return np.where((leave >= enter) & (leave >= 0.0), np.maximum(enter, 0.0), np.inf)

    def _round_ranges(self, x: float, y: float, dx: Floats, dy: Floats) -> Floats:
        cx, cy, radius = self.rounds.T[:3]
        ox, oy = x - cx, y - cy
        half_b, c = ox * dx + oy * dy, ox * ox + oy * oy - radius * radius
        discriminant = half_b * half_b - c
        root = np.sqrt(np.maximum(discriminant, 0.0))
        enter, leave = -half_b - root, -half_b + root
        return np.where((discriminant >= 0.0) & (leave >= 0.0), np.maximum(enter, 0.0), np.inf)

    def clearance(self, points: Floats) -> Floats:
        """Distance (k,) of points (k, 2) to the nearest shape's outline, 0 inside; inf if there is none."""
        nearest = np.full(len(points), np.inf)
        if len(self.boxes):
            cx, cy, cos, sin, hx, hy = self.boxes.T[:6]
            px, py = points[:, :1] - cx, points[:, 1:] - cy
            outside_x = np.maximum(np.abs(cos * px + sin * py) - hx, 0.0)
            outside_y = np.maximum(np.abs(cos * py - sin * px) - hy, 0.0)
            nearest = np.hypot(outside_x, outside_y).min(axis=1)
        if len(self.rounds):
            cx, cy, radius = self.rounds.T[:3]
            away = np.hypot(points[:, :1] - cx, points[:, 1:] - cy) - radius
            nearest = np.minimum(nearest, np.maximum(away, 0.0).min(axis=1))
        return nearest

    def sees(self, eyes: Floats, aim: tuple[float, float, float]) -> NDArray[np.bool_]:
        """For each of `eyes` (k, 3), whether the straight line to `aim` meets no shape."""
        free = np.ones(len(eyes), bool)
        away = np.array(aim) - eyes
        start = eyes[:, :, None]
        step = away[:, :, None]
        if len(self.boxes):
            cx, cy, cos, sin, hx, hy, low, high = self.boxes.T
            px, py = start[:, 0] - cx, start[:, 1] - cy
            axes = (
                (cos * px + sin * py, cos * step[:, 0] + sin * step[:, 1], hx),
                (cos * py - sin * px, cos * step[:, 1] - sin * step[:, 0], hy),
                (start[:, 2] - (low + high) / 2, step[:, 2] + 0.0 * cx, (high - low) / 2),
            )
            enter, leave = np.zeros_like(px), np.ones_like(px)
            for origin, direction, half in axes:
                inverse = 1.0 / _nonzero(direction)
                middle, reach = -origin * inverse, half * np.abs(inverse)
                enter, leave = np.maximum(enter, middle - reach), np.minimum(leave, middle + reach)
            free &= ~(enter <= leave).any(axis=1)
        if len(self.rounds):
            cx, cy, radius, low, high = self.rounds.T
            px, py = start[:, 0] - cx, start[:, 1] - cy
            a = np.maximum(step[:, 0] ** 2 + step[:, 1] ** 2, EPSILON)
            half_b = px * step[:, 0] + py * step[:, 1]
            discriminant = half_b**2 - a * (px * px + py * py - radius**2)
            root = np.sqrt(np.maximum(discriminant, 0.0))
            inverse = 1.0 / _nonzero(step[:, 2])
            middle, reach = (-(start[:, 2] - (low + high) / 2) * inverse, (high - low) / 2 * np.abs(inverse))
            enter = np.maximum(np.maximum((-half_b - root) / a, middle - reach), 0.0)
            leave = np.minimum(np.minimum((-half_b + root) / a, middle + reach), 1.0)
            free &= ~((discriminant >= 0.0) & (enter <= leave)).any(axis=1)
        return free


def _nonzero(values: Floats) -> Floats:
    return np.where(np.abs(values) < EPSILON, EPSILON, values)
