"""What the virtual operator remembers: floor and space it has seen, things in the way, places it was near.

A coarse picture of the surroundings made only of what `eyes` showed, as humans keep one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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

FLOOR = 1
"""Free floor."""
SOLID = 2
"""Something stands here."""
SPACE = 4
"""Looked into from near enough to recognise what is there."""
HIDING = 8
"""Something here hides what is behind it."""
NEAR = 16
"""Floor seen from close by."""
GIVEN_UP = 32
"""Tried to get or see further here, in vain."""

SEARCHED_M = 4.0
"""Further away, a small thing among others is easily overlooked."""
NEAR_M = 3.0
"""From this close, whatever stands here has been seen."""


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
        return cls(pose.x - half, pose.y - half, _fixed(np.zeros((SIDE_CELLS, SIDE_CELLS), np.uint8)))

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a point, clipped to the edge."""
        row, column = int((y - self.y0) / CELL_M), int((x - self.x0) / CELL_M)
        return min(max(row, 0), SIDE_CELLS - 1), min(max(column, 0), SIDE_CELLS - 1)

    def has(self, mark: int) -> Mask:
        """Where any of these marks is."""
        found: Mask = (self.marks & mark) != 0
        return found

    def clearance(self) -> NDArray[np.float64]:
        """Distance of each cell to the nearest thing remembered, m."""
        free = (~self.has(SOLID)).astype(np.uint8)
        return cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE).astype(np.float64) * CELL_M


def remember(memory: Recollection, view: View) -> Recollection:
    """Add one look to the memory."""
    marks = memory.marks.copy()
    for reach, mark in (
        (view.floor_m, FLOOR),
        (np.minimum(view.space_m, SEARCHED_M), SPACE),
        (np.minimum(view.floor_m, NEAR_M), NEAR),
    ):
        marks[_fan(memory, view, reach)] |= mark
    for reach, mark in ((view.floor_m, SOLID), (view.space_m, HIDING)):
        # A little inside, for the surface itself may lie on a border of cells.
        ends = _cells(memory, *_ends(view, reach + 0.3 * CELL_M))[reach < VIEW_M]
        marks[ends[:, 1], ends[:, 0]] |= mark
    return replace(memory, marks=_fixed(marks))


def give_up(memory: Recollection, x: float, y: float, radius_m: float) -> Recollection:
    """Remember that nothing more is to be had around a place."""
    disc = np.zeros_like(memory.marks)
    row, column = memory.cell(x, y)
    cv2.circle(disc, (column, row), round(radius_m / CELL_M), GIVEN_UP, -1)
    return replace(memory, marks=_fixed(memory.marks | disc))


def forget_tries(memory: Recollection) -> Recollection:
    """Start over: keep the floor and the things, forget what was looked at closely or given up."""
    return replace(memory, marks=_fixed(memory.marks & np.uint8(FLOOR | SOLID | SPACE | HIDING)))


def _fan(memory: Recollection, view: View, reach: NDArray[np.float64]) -> Mask:
    """The cells within `reach` (k,) of the robot."""
    # A ray beside an edge must not open what is behind it: each reaches as far as its shorter neighbour.
    safe = np.minimum(np.minimum(np.roll(reach, 1), reach), np.roll(reach, -1))
    fan = np.zeros_like(memory.marks)
    cv2.fillPoly(fan, [_cells(memory, *_ends(view, safe))], 1)
    inside: Mask = fan > 0
    return inside


def _ends(view: View, reach: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return view.pose.x + reach * np.cos(view.yaws), view.pose.y + reach * np.sin(view.yaws)


def _cells(memory: Recollection, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int32]:
    """(k, 2) column and row of points, in OpenCV's order."""
    points = np.stack((x - memory.x0, y - memory.y0), axis=1)
    cells: NDArray[np.int32] = np.clip(np.floor(points / CELL_M), 0, SIDE_CELLS - 1).astype(np.int32)
    return cells


def _fixed(marks: NDArray[np.integer]) -> Marks:
    fixed: Marks = marks.astype(np.uint8, copy=False)
    fixed.flags.writeable = False
    return fixed
