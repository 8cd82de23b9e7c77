"""Environments drawn as a grid of cells, and the tables that searches run on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.experiments.ground import UNSEEN, Goal, Ground, far, wedges_of
from ghal360_robot.guidance.egocentric import N_WEDGES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Mask = NDArray[np.bool_]

FREE, WALL, FURNITURE = ".", "#", "o"
"""Furniture is in the way, but one looks over it."""
SUBSTEPS = 4
"""Points of a step that have to be free, at least."""
RAY_STEP = 0.5
"""Of a cell: how finely a line of sight is followed."""
CHUNK = 64
"""Places looked from at once: some 30,000 lines of sight."""


@dataclass(frozen=True, slots=True)
class Thing:
    """Something with a name, at a place in metres (x east, y north)."""

    name: str
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class GridMap:
    """Rows of FREE, WALL and FURNITURE cells, the northernmost row first; the south-west corner is (0, 0)."""

    name: str
    cell_m: float
    rows: tuple[str, ...]
    targets: tuple[Thing, ...]
    clutter: tuple[Thing, ...]
    partial_steps: bool = False
    """A step goes as far as it is free, as a robot that steers would; else a blocked step is none (paper)."""

    @property
    def cells(self) -> NDArray[np.str_]:
        """(rows, columns) of characters, the southernmost row first."""
        return np.array([list(row) for row in reversed(self.rows)])


def ground_of(grid: GridMap, *, step_m: float, range_m: float) -> Ground:
    """The tables of a grid for steps of `step_m` and things that are known for what they are up to `range_m`."""
    cells = grid.cells
    free = cells == FREE
    index = np.full(cells.shape, -1)
    index[free] = np.arange(np.count_nonzero(free))
    at = np.argwhere(free)[:, ::-1]
    xy = _middles(free, grid.cell_m)
    sight = _Sight(cells == WALL, grid.cell_m, range_m)
    goals = tuple(
        _goal(target, [*grid.clutter, *(other for other in grid.targets if other is not target)], xy, sight)
        for target in grid.targets
    )
    return Ground(
        name=grid.name,
        xy=xy,
        moves=_moves(free, index, at, step_m / grid.cell_m, partial=grid.partial_steps),
        goals=goals,
        tolerance_m=grid.cell_m / 2,
        look=lambda: _spot_wedges(xy, _middles(cells != WALL, grid.cell_m), sight),
    )


def _middles(mask: Mask, cell_m: float) -> Floats:
    """(n, 2) the middles of the cells that are set, metres."""
    return np.asarray((np.argwhere(mask)[:, ::-1] + 0.5) * cell_m, dtype=np.float64)


def _moves(
    free: Mask, index: NDArray[np.int64], at: NDArray[np.int64], step: float, *, partial: bool
) -> NDArray[np.int64]:
    """(n, 8) the place a step of `step` cells leads to; every point on the way has to be free."""
    depth, width = free.shape
    moves = np.tile(np.arange(len(at))[:, None], (1, N_WEDGES))
    substeps = max(SUBSTEPS, round(step))
    for wedge in range(N_WEDGES):
        bearing = wedge * math.pi / 4
        shift = np.round(np.array([math.sin(bearing), math.cos(bearing)]) * step)
        open_way = np.ones(len(at), bool)
        for part in range(1, substeps + 1):
            x, y = np.floor(at + 0.5 + shift * part / substeps).astype(np.int64).T
            inside = (x >= 0) & (x < width) & (y >= 0) & (y < depth)
            open_way &= inside & free[np.clip(y, 0, depth - 1), np.clip(x, 0, width - 1)]
            if partial or part == substeps:
                moves[open_way, wedge] = index[y[open_way], x[open_way]]
    return moves


@dataclass(frozen=True, slots=True, eq=False)
class _Sight:
    """Walls hide, furniture does not."""

    wall: Mask
    cell_m: float
    range_m: float

    def clear(self, here: Floats, there: Floats) -> Mask:
        """(k,) whether no wall stands between points `here` (k, 2) and `there` (k, 2), metres, and they are near."""
        between = there - here
        clear: Mask = far(between) <= self.range_m + 1e-9
        if not self.wall.any():
            return clear
        near = np.flatnonzero(clear)
        steps = max(2, math.ceil(self.range_m / (self.cell_m * RAY_STEP)))
        for part in np.linspace(0.0, 1.0, steps + 1)[1:-1]:
            x, y = np.floor((here[near] + part * between[near]) / self.cell_m).astype(np.int64).T
            hidden = self.wall[np.clip(y, 0, self.wall.shape[0] - 1), np.clip(x, 0, self.wall.shape[1] - 1)]
            clear[near[hidden]] = False
            near = near[~hidden]
        return clear


def _goal(target: Thing, others: list[Thing], xy: Floats, sight: _Sight) -> Goal:
    clutter = np.zeros(len(xy), np.uint8)
    for other in others:
        bearing, seen = _look(other, xy, sight)
        clutter |= np.where(seen, 1 << wedges_of(bearing), 0).astype(np.uint8)
    bearing, seen = _look(target, xy, sight)
    return Goal(
        name=target.name,
        xy=(target.x, target.y),
        bearing=np.where(seen, bearing, np.nan),
        distance_m=far(xy - (target.x, target.y)),
        clutter=clutter,
    )


def _look(thing: Thing, xy: Floats, sight: _Sight) -> tuple[Floats, Mask]:
    """Bearing of a thing from every place, and whether it can be seen from there."""
    at = np.array([thing.x, thing.y])
    bearing: Floats = np.arctan2(at[0] - xy[:, 0], at[1] - xy[:, 1])
    return bearing, sight.clear(xy, np.broadcast_to(at, xy.shape))


def _spot_wedges(xy: Floats, spots: Floats, sight: _Sight) -> NDArray[np.uint8]:
    """(n, m) the wedge in which each spot is seen from each place, or UNSEEN."""
    wedge = np.full((len(xy), len(spots)), UNSEEN, np.uint8)
    for begin in range(0, len(xy), CHUNK):
        here = xy[begin : begin + CHUNK]
        towards = spots[None] - here[:, None]
        place, spot = np.nonzero(np.hypot(towards[..., 0], towards[..., 1]) <= sight.range_m)
        seen = sight.clear(here[place], spots[spot])
        place, spot = place[seen], spot[seen]
        wedge[begin + place, spot] = wedges_of(np.arctan2(*towards[place, spot].T))
    return wedge
