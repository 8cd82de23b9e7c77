"""How late the control loop is: a histogram of fixed size, so that a day costs as much memory as a minute."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

BIN_MS = 0.05
BINS = 20_000
"""One second in steps of 50 us; anything later counts in the last bin, `max_ms` keeps its value."""


@dataclass(slots=True)
class Lateness:
    """Percentiles of tick lateness in milliseconds."""

    count: int = 0
    max_ms: float = 0.0
    skipped: int = 0
    """Ticks that were never run because an earlier one took too long."""
    _bins: np.ndarray = field(default_factory=lambda: np.zeros(BINS, np.int64))

    def note(self, late_ms: float) -> None:
        self.count += 1
        self.max_ms = max(self.max_ms, late_ms)
        self._bins[min(int(late_ms / BIN_MS), BINS - 1)] += 1

    def percentile_ms(self, percent: float) -> float:
        """Upper edge of the bin that holds this percentile; 0 before the first tick."""
        if self.count == 0:
            return 0.0
        cumulative = np.cumsum(self._bins)
        rank = max(1, math.ceil(percent * self.count / 100.0 - 1e-9))
        index = int(np.searchsorted(cumulative, rank))
        return min((index + 1) * BIN_MS, self.max_ms)

    def summary(self) -> dict[str, float]:
        return {
            "p50": round(self.percentile_ms(50), 3),
            "p99": round(self.percentile_ms(99), 3),
            "max": round(self.max_ms, 3),
        }
