"""What the virtual operator remembers: floor it has seen, things in the way, places it has been near.

A coarse picture of the surroundings made only of what `eyes.look` showed, as humans keep one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.simulation.eyes import VIEW_M

if TYPE_CHECKING:
    from typing import Self

    from numpy.typing import NDArray

    from ghal360_robot.messages import Pose2
    from ghal360_robot.simulation.eyes import View

    Marks = NDArray[np.uint8]
    Mask = NDArray[np.bool_]

CELL_M = 0.10
SIDE_CELLS = 320
"""32 m, the start in the middle: every place of a 14 m building from any start."""

SEEN = 1
"""Floor that was in view."""
SOLID = 2
"""Something stands here."""
NEAR = 4
"""Looked at from close by."""
GIVEN_UP = 8
"""Tried to get or see further here, in vain."""

NEAR_M = 2.0
"""From this close, whatever stands here has been seen."""
AROUND_M = 0.8
"""Floor this close to the robot has been seen from all sides on the way."""


@dataclass(frozen=True, slots=True, eq=False)
class Recollection:
    """`marks` (SIDE_CELLS, SIDE_CELLS), rows along y; cell (0, 0) begins at (`x0`, `y0`)."""

    x0: float
    y0: float
    marks: Marks

    @classmethod
    def empty(cls, pose: Pose2) -> Self:
        """Nothing seen yet; room for everything around `pose`."""
        half = SIDE_CELLS * CELL_M / 2
        return cls(pose.x - half, pose.y - half, _frozen(np.zeros((SIDE_CELLS, SIDE_CELLS), np.uint8)))

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a point, clipped to the edge."""
        row, column = int((y - self.y0) / CELL_M), int((x - self.x0) / CELL_M)
        return min(max(row, 0), SIDE_CELLS - 1), min(max(column, 0), SIDE_CELLS - 1)

    def has(self, mark: int) -> Mask:
        found: Mask = (self.marks & mark) != 0
        return found

    def clearance(self) -> NDArray[np.float64]:
        """Distance of each cell to the nearest thing remembered, m."""
        free = (~self.has(SOLID)).astype(np.uint8)
        return cv2.distanceTransform(free, cv2.DIST_L2, 3).astype(np.float64) * CELL_M


def remember(memory: Recollection, view: View) -> Recollection:
    """Add one look to the memory."""
    marks = memory.marks.copy()
    # A ray beside an edge must not open what is behind it: each reaches as far as its shorter neighbour.
    padded = np.concatenate((view.free_m[:1], view.free_m, view.free_m[-1:]))
    reach = np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
    fan = np.zeros_like(marks)
    origin = _cells(memory, np.array([view.pose.x]), np.array([view.pose.y]))
    cv2.fillPoly(fan, [np.concatenate((origin, _cells(memory, *_ends(view, reach))))], 1)
    cv2.circle(fan, tuple(map(int, origin[0])), round(AROUND_M / 2 / CELL_M), 1, -1)
    close = np.zeros_like(marks)
    cv2.circle(close, tuple(map(int, origin[0])), round(NEAR_M / CELL_M), 1, -1)
    around = np.zeros_like(marks)
    cv2.circle(around, tuple(map(int, origin[0])), round(AROUND_M / CELL_M), 1, -1)
    marks[fan > 0] |= SEEN
    marks[(fan & close | around) > 0] |= NEAR
    hit = view.free_m < VIEW_M
    inside = _cells(memory, *_ends(view, view.free_m + 0.3 * CELL_M))[hit]
    marks[inside[:, 1], inside[:, 0]] |= SOLID
    return Recollection(memory.x0, memory.y0, _frozen(marks))


def give_up(memory: Recollection, x: float, y: float, radius_m: float) -> Recollection:
    """Remember that nothing more is to be had around a place."""
    marks = memory.marks.copy()
    disc = np.zeros_like(marks)
    row, column = memory.cell(x, y)
    cv2.circle(disc, (column, row), round(radius_m / CELL_M), GIVEN_UP, -1)
    return Recollection(memory.x0, memory.y0, _frozen(marks | disc))


def forget_tries(memory: Recollection) -> Recollection:
    """Start over: keep the floor and the things, forget what was looked at closely or given up."""
    return Recollection(memory.x0, memory.y0, _frozen(memory.marks & (SEEN | SOLID)))


def _ends(view: View, reach: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return view.pose.x + reach * np.cos(view.yaws), view.pose.y + reach * np.sin(view.yaws)


def _cells(memory: Recollection, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int32]:
    """(k, 2) column and row of points, in OpenCV's order."""
    columns = np.floor((x - memory.x0) / CELL_M)
    rows = np.floor((y - memory.y0) / CELL_M)
    cells: NDArray[np.int32] = np.clip(np.stack((columns, rows), axis=1), 0, SIDE_CELLS - 1).astype(np.int32)
    return cells


def _frozen(marks: Marks) -> Marks:
    marks.flags.writeable = False
    return marks
