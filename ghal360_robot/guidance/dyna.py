"""What Dyna relives: the pairs of state and action that an orbit has seen, and their last outcomes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.orbits import ROW

if TYPE_CHECKING:
    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

REMEMBERED = 8
"""Outcomes kept of each pair: enough to tell that an arrow is not always followed."""


class Remembered:
    """The memory of `rows` orbits."""

    def __init__(self, rows: int) -> None:
        self.pairs = np.zeros(rows, np.int64)
        self._seen = np.zeros((rows, ROW), np.int8)
        self._outcomes = np.zeros((rows, ROW, REMEMBERED), np.int8)
        self._counts = np.zeros((rows, ROW), np.int64)

    def note(self, row: Ints, pair: Ints, there: Ints) -> None:
        count = self._counts[row, pair]
        new = count == 0
        self._seen[row[new], self.pairs[row[new]]] = pair[new]
        self.pairs[row[new]] += 1
        self._outcomes[row, pair, count % REMEMBERED] = there
        self._counts[row, pair] = count + 1

    def recall(self, row: Ints, pair_u: Floats, outcome_u: Floats) -> tuple[Ints, Ints]:
        """A pair seen before and one of its outcomes, for uniform draws."""
        pair = self._seen[row, (pair_u * self.pairs[row]).astype(np.int64)].astype(np.int64)
        known = np.minimum(self._counts[row, pair], REMEMBERED)
        there = self._outcomes[row, pair, (outcome_u * known).astype(np.int64)].astype(np.int64)
        return pair, there
