"""Left and right learned as one: which half of the table is kept, and how the other half is read from it.

Two orbits that mirror each other are kept as the smaller one, which the caller sees to; an orbit that is
its own mirror image keeps the positions to one side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.guidance.mdp import CONFIRM
from ghal360_robot.guidance.orbits import N_ACTIONS, N_ORBITS, ROW, mirror_orbit

if TYPE_CHECKING:
    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Fold:
    """Where mirrored states are kept: in orbits that are their own mirror image, position p with -p."""

    position: Ints
    """(256, 8)"""
    swapped: NDArray[np.bool_]
    """(256, 8) whether left and right change places."""

    def whole(self, q: Floats, row: Ints) -> Floats:
        """(n, 24) values of all eight positions of `row` (n,), kept in `q` as in `training`."""
        orbit = row % N_ORBITS
        kept = q.reshape(-1, N_ORBITS, N_WEDGES, N_ACTIONS)[
            (row // N_ORBITS)[:, None], orbit[:, None], self.position[orbit]
        ]
        return np.where(self.swapped[orbit][..., None], kept[..., [1, 0, CONFIRM]], kept).reshape(-1, ROW)


def mirror_fold() -> Fold:
    """Positions right of the target are kept; those left of it are their mirror images."""
    orbit, position = np.meshgrid(np.arange(N_ORBITS), np.arange(N_WEDGES), indexing="ij")
    swapped = (mirror_orbit(orbit) == orbit) & (position > N_WEDGES // 2)
    return Fold(np.where(swapped, -position % N_WEDGES, position), swapped)


def unfold(q: Floats) -> Floats:
    """(seeds, 256, 8, 3) values of every state from those of the half that was learned."""
    orbit, position = np.meshgrid(np.arange(N_ORBITS), np.arange(N_WEDGES), indexing="ij")
    twin = mirror_orbit(orbit)
    swapped = (twin < orbit) | ((twin == orbit) & (position > N_WEDGES // 2))
    kept = q[:, np.minimum(orbit, twin), np.where(swapped, -position % N_WEDGES, position)]
    return np.where(swapped[..., None], kept[..., [1, 0, CONFIRM]], kept)
