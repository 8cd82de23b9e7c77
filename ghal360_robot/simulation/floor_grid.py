"""The floor as a grid of cells: what is joined to what, and how far the walk is."""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

CELL_M = 0.10


def flood(mask: NDArray[np.bool_], seed: tuple[np.intp, ...] | tuple[int, int]) -> NDArray[np.bool_]:
    """The cells of `mask` that four-neighbour steps join to `seed`."""
    reached = np.zeros_like(mask)
    reached[seed] = mask[seed]
    count = 0
    while (now := int(reached.sum())) != count:
        count = now
        for axis in (0, 1):
            for step in (1, -1):
                _sweep(reached, mask, axis, step)
    return reached


def _sweep(reached: NDArray[np.bool_], mask: NDArray[np.bool_], axis: int, step: int) -> None:
    """Spread `reached` along one direction as far as the mask goes, in place."""
    front, wall = np.moveaxis(reached, axis, 0)[::step], np.moveaxis(mask, axis, 0)[::step]
    for line in range(1, len(front)):
        front[line] |= front[line - 1] & wall[line]


def walking_distance(mask: NDArray[np.bool_], goals: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Shortest eight-neighbour way on `mask` from each cell to any of `goals`, m; inf where there is none."""
    length = np.where(goals, 0.0, np.inf)
    queue = [(0.0, (int(row), int(column))) for row, column in np.argwhere(goals)]
    steps = [(dy, dx, CELL_M * math.hypot(dx, dy)) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dx, dy) != (0, 0)]
    rows, columns = mask.shape
    while queue:
        so_far, (row, column) = heapq.heappop(queue)
        if so_far > length[row, column]:
            continue
        for dy, dx, cost in steps:
            y, x = row + dy, column + dx
            if 0 <= y < rows and 0 <= x < columns and mask[y, x] and so_far + cost < length[y, x]:
                length[y, x] = so_far + cost
                heapq.heappush(queue, (so_far + cost, (y, x)))
    return length
