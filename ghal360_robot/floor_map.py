"""The floor around the robot as its lidar sees it, in the odometry frame: good for finding one's way."""

from __future__ import annotations

import base64
import math
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

RESOLUTION_M = 0.1
CELLS = 400
"""40 m across; a robot that drives further takes its map along."""

MARGIN = 80
HIT, MISS, LIMIT = 3, -1, 20
"""Evidence of one scan, and the most that is remembered: what has gone is forgotten within two seconds."""

MAX_M = 12.0
JUMP_M = 1.0
"""Nobody drives so far between two scans: the odometry has begun anew, and nothing is where it was."""

PATH_M = 0.2
MAX_PATH = 500

FREE_GREY, UNKNOWN_GREY, OCCUPIED_GREY = 254, 205, 0


class FloorMap:
    """`add` scans at their poses; `cells` and `png` are what can be drawn."""

    def __init__(self) -> None:
        self._evidence = np.zeros((CELLS, CELLS), np.int8)
        self._corner = (-CELLS * RESOLUTION_M / 2, -CELLS * RESOLUTION_M / 2)
        self._last: tuple[float, float] | None = None
        self.path: list[tuple[float, float]] = []

    def add(self, pose: tuple[float, float, float], yaws: NDArray[np.float64], ranges: NDArray[np.float64]) -> None:
        """One scan: directions (n,) in the base frame, ranges (n,) in metres, 0 where nothing was seen."""
        x, y, yaw = pose
        if not all(map(math.isfinite, pose)):
            return
        if self._last is not None and math.dist(self._last, (x, y)) > JUMP_M:
            self._forget()
        self._last = (x, y)
        self._follow(x, y)
        seen = ranges > 0.0
        reach = np.minimum(ranges, MAX_M)
        ends_x, ends_y = x + reach * np.cos(yaws + yaw), y + reach * np.sin(yaws + yaw)
        outline = np.column_stack((self._cells(ends_x, 0), self._cells(ends_y, 1)))
        here = np.array([[self._cells(np.array([x]), 0)[0], self._cells(np.array([y]), 1)[0]]])
        outline[~seen] = here
        swept = np.zeros((CELLS, CELLS), np.uint8)
        cv2.fillPoly(swept, [np.concatenate((here, outline)).astype(np.int32)], 1)
        evidence = self._evidence.astype(np.int16) + MISS * swept.astype(np.int16)
        hits = outline[seen & (ranges < MAX_M)]
        evidence[hits[:, 1], hits[:, 0]] += HIT - MISS
        self._evidence = np.clip(evidence, -LIMIT, LIMIT).astype(np.int8)
        if not self.path or math.dist(self.path[-1], (x, y)) > PATH_M:
            self.path.append((round(x, 2), round(y, 2)))
            del self.path[:-MAX_PATH]

    @property
    def corner(self) -> tuple[float, float]:
        """Lower left, metres."""
        return self._corner

    def cells(self) -> NDArray[np.uint8]:
        """Grey values (CELLS, CELLS), row 0 at the largest y."""
        picture = np.full((CELLS, CELLS), UNKNOWN_GREY, np.uint8)
        picture[self._evidence < -1] = FREE_GREY
        picture[self._evidence > 1] = OCCUPIED_GREY
        return picture[::-1]

    def png(self) -> str:
        """`cells` as a picture in base64."""
        _, data = cv2.imencode(".png", self.cells())
        return base64.b64encode(data.tobytes()).decode("ascii")

    def _forget(self) -> None:
        self._evidence[:] = 0
        self._corner = (-CELLS * RESOLUTION_M / 2, -CELLS * RESOLUTION_M / 2)
        self.path.clear()

    def _cells(self, values: NDArray[np.float64], axis: int) -> NDArray[np.intp]:
        cells = np.floor((values - self._corner[axis]) / RESOLUTION_M).astype(np.intp)
        return np.clip(cells, 0, CELLS - 1)

    def _follow(self, x: float, y: float) -> None:
        """Shift the map where the robot comes near its edge."""
        for axis, value in ((0, x), (1, y)):
            cell = math.floor((value - self._corner[axis]) / RESOLUTION_M)
            if MARGIN <= cell < CELLS - MARGIN:
                continue
            shift = cell - CELLS // 2
            moved = np.zeros_like(self._evidence)
            if abs(shift) < CELLS:
                kept, place = slice(max(shift, 0), CELLS + min(shift, 0)), slice(max(-shift, 0), CELLS - max(shift, 0))
                if axis == 0:
                    moved[:, place] = self._evidence[:, kept]
                else:
                    moved[place] = self._evidence[kept]
            self._evidence = moved
            corner = list(self._corner)
            corner[axis] += shift * RESOLUTION_M
            self._corner = (corner[0], corner[1])
