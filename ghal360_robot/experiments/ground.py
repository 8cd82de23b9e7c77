"""Where a target search takes place, as tables: whatever an environment was made from, searches run on these.

A place is a cell of a grid or a viewpoint of a navigation graph. Wedges are clockwise and wedge 0 is north
(+y of the environment), as in `guidance.egocentric`; heads point at the middle of a wedge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from ghal360_robot.guidance.egocentric import BORDER_SNAP, N_WEDGES, WEDGE_WIDTH

if TYPE_CHECKING:
    from collections.abc import Callable

UNSEEN = N_WEDGES
"""In place of a wedge: the target cannot be seen from here."""
DISTANCES_M = (2.0, 4.0, 6.0, 8.0, 10.0, 12.0)
"""Starting distances of the paper."""


def far(towards: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k,) lengths of vectors (k, 2)."""
    return np.asarray(np.hypot(towards[:, 0], towards[:, 1]), dtype=np.float64)


def wedges_of(bearing: NDArray[np.float64]) -> NDArray[np.int64]:
    """The wedges of finite clockwise bearings, borders as in `egocentric.wedge_of`."""
    wedges: NDArray[np.int64] = np.floor(bearing / WEDGE_WIDTH + 0.5 + BORDER_SNAP).astype(np.int64) % N_WEDGES
    return wedges


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """One thing to find, seen from every place of n."""

    name: str
    xy: tuple[float, float]
    bearing: NDArray[np.float64]
    """(n,) clockwise from north, radians; NaN where the target cannot be seen."""
    distance_m: NDArray[np.float64]
    """(n,) straight to the target, seen or not."""
    clutter: NDArray[np.uint8]
    """(n,) bit k: something else stands in wedge k."""

    @property
    def wedge(self) -> NDArray[np.int64]:
        """(n,) the wedge of the target, or UNSEEN."""
        seen = np.isfinite(self.bearing)
        return np.where(seen, wedges_of(np.where(seen, self.bearing, 0.0)), UNSEEN)

    def in_view(self, fov_rad: float) -> NDArray[np.uint8]:
        """(n,) bit k: a head in wedge k with this field of view has the target's centre in it."""
        off = (self.bearing[:, None] - np.arange(N_WEDGES) * WEDGE_WIDTH + np.pi) % (2 * np.pi) - np.pi
        inside = np.abs(off) <= fov_rad / 2 + 1e-9  # NaN is never inside
        return np.asarray(inside @ (1 << np.arange(N_WEDGES)), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Ground:
    """Places, the steps between them, and what there is to find."""

    name: str
    xy: NDArray[np.float64]
    """(n, 2) metres, x east, y north."""
    moves: NDArray[np.int64]
    """(n, 8) where a step in each wedge leads; the same place where it is blocked."""
    goals: tuple[Goal, ...]
    tolerance_m: float
    """A start at 4 m may be this much nearer or further."""
    look: Callable[[], NDArray[np.uint8]]
    """Computes `spot_wedge`: only the planner needs it."""

    @cached_property
    def spot_wedge(self) -> NDArray[np.uint8]:
        """(n, m) the wedge in which place i sees what lies at spot j, or UNSEEN. Spots are wherever a thing may lie."""
        return self.look()

    @cached_property
    def path_m(self) -> NDArray[np.float32]:
        """(n, n) metres of steps from i to j, inf where there is no way."""
        n = len(self.xy)
        start = np.repeat(np.arange(n), N_WEDGES)
        end = self.moves.ravel()
        real = start != end
        start, end = start[real], end[real]
        length = far(self.xy[end] - self.xy[start])
        graph = csr_matrix((length, (start, end)), shape=(n, n))
        return np.asarray(dijkstra(graph), dtype=np.float32)

    def starts(self, goal: Goal, distance_m: float) -> NDArray[np.int64]:
        """The places about so far from the target from which one can walk to a place where it is in view."""
        near = np.abs(goal.distance_m - distance_m) <= self.tolerance_m
        return np.flatnonzero(near & self.leads_to_view(goal))

    def leads_to_view(self, goal: Goal) -> NDArray[np.bool_]:
        """(n,) whether some walk leads to where the target can be seen."""
        leads = np.isfinite(goal.bearing)
        while True:
            more = leads | leads[self.moves].any(axis=1)
            if np.array_equal(more, leads):
                return leads
            leads = more
