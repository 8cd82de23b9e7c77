"""Sums over trials that add up across environments, and what is reported from them: means with standard errors."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.experiments.ground import DISTANCES_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

KEYS = tuple(f"{distance:g}" for distance in DISTANCES_M)
"""Distances as they are written in results."""


@dataclass(slots=True)
class Sums:
    """Of some trials: how many, how many found, their times (not found: the limit), and those of the found."""

    n: int = 0
    found: int = 0
    wrong: int = 0
    time: float = 0.0
    time2: float = 0.0
    found_time: float = 0.0
    found_time2: float = 0.0

    def add(self, seconds: NDArray[np.float64], limit_s: float) -> None:
        """Take in trials: inf is not found, negative is a wrong find."""
        right = np.isfinite(seconds) & (seconds >= 0)
        censored = np.where(right, np.minimum(seconds, limit_s), limit_s)
        self.n += len(seconds)
        self.found += int(right.sum())
        self.wrong += int((seconds < 0).sum())
        self.time += float(censored.sum())
        self.time2 += float((censored**2).sum())
        self.found_time += float(seconds[right].sum())
        self.found_time2 += float((seconds[right] ** 2).sum())

    def merge(self, other: Sums) -> None:
        for name in Sums.__slots__:
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def to_json(self) -> list[float]:
        return [getattr(self, name) for name in Sums.__slots__]

    @classmethod
    def from_json(cls, values: list[float]) -> Sums:
        return cls(*(int(value) for value in values[:3]), *values[3:])

    def report(self) -> dict[str, Any]:
        """Shares and times in seconds; None where there is nothing to tell a mean of."""
        return {
            "n": self.n,
            "success": _share(self.found, self.n),
            "success_se": _share_se(self.found, self.n),
            "wrong": _share(self.wrong, self.n),
            "mean_time_s": _mean(self.time, self.n),
            "mean_time_se_s": _mean_se(self.time, self.time2, self.n),
            "found_only_mean_time_s": _mean(self.found_time, self.found),
            "found_only_mean_time_se_s": _mean_se(self.found_time, self.found_time2, self.found),
        }


@dataclass(slots=True)
class Tally:
    """Sums of one system, by distance and by run."""

    by_distance: list[Sums] = field(default_factory=lambda: [Sums() for _ in DISTANCES_M])
    by_run: dict[str, Sums] = field(default_factory=dict)

    def add(
        self, seconds: NDArray[np.float64], distance: NDArray[np.int64], run: NDArray[np.int64], limit_s: float
    ) -> None:
        for d, sums in enumerate(self.by_distance):
            sums.add(seconds[distance == d], limit_s)
        for r in np.unique(run).tolist():
            self.by_run.setdefault(str(r), Sums()).add(seconds[run == r], limit_s)

    def merge(self, other: Tally) -> None:
        for mine, theirs in zip(self.by_distance, other.by_distance, strict=True):
            mine.merge(theirs)
        for run, sums in other.by_run.items():
            self.by_run.setdefault(run, Sums()).merge(sums)

    @property
    def total(self) -> Sums:
        total = Sums()
        for sums in self.by_distance:
            total.merge(sums)
        return total

    def to_json(self) -> dict[str, Any]:
        return {
            "by_distance": [sums.to_json() for sums in self.by_distance],
            "by_run": {run: sums.to_json() for run, sums in self.by_run.items()},
        }

    @classmethod
    def from_json(cls, body: dict[str, Any]) -> Tally:
        return cls(
            [Sums.from_json(values) for values in body["by_distance"]],
            {run: Sums.from_json(values) for run, values in body["by_run"].items()},
        )

    def report(self) -> dict[str, Any]:
        """Overall, by distance, and how far the runs lie apart."""
        runs = [sums.found / sums.n for _, sums in sorted(self.by_run.items()) if sums.n]
        return {
            **self.total.report(),
            "success_by_run": [round(share, 4) for share in runs],
            "by_distance": {key: sums.report() for key, sums in zip(KEYS, self.by_distance, strict=True) if sums.n},
        }


@dataclass(slots=True)
class Difference:
    """Paired differences of censored times by distance: first minus second system."""

    n: list[int] = field(default_factory=lambda: [0] * len(DISTANCES_M))
    total: list[float] = field(default_factory=lambda: [0.0] * len(DISTANCES_M))
    squares: list[float] = field(default_factory=lambda: [0.0] * len(DISTANCES_M))

    def add(
        self,
        first: NDArray[np.float64],
        second: NDArray[np.float64],
        distance: NDArray[np.int64],
        limit_s: float,
    ) -> None:
        gap = np.minimum(first, limit_s) - np.minimum(second, limit_s)
        for d in range(len(DISTANCES_M)):
            here = gap[distance == d]
            self.n[d] += len(here)
            self.total[d] += float(here.sum())
            self.squares[d] += float((here**2).sum())

    def merge(self, other: Difference) -> None:
        for name in Difference.__slots__:
            mine, theirs = getattr(self, name), getattr(other, name)
            setattr(self, name, [a + b for a, b in zip(mine, theirs, strict=True)])

    def to_json(self) -> dict[str, Any]:
        return {"n": self.n, "total": self.total, "squares": self.squares}

    @classmethod
    def from_json(cls, body: dict[str, Any]) -> Difference:
        return cls(body["n"], body["total"], body["squares"])

    def report(self) -> dict[str, Any]:
        return {
            key: {"mean_s": _mean(total, n), "se_s": _mean_se(total, squares, n)}
            for key, n, total, squares in zip(KEYS, self.n, self.total, self.squares, strict=True)
            if n
        }


def _share(part: int, n: int) -> float | None:
    return round(part / n, 4) if n else None


def _share_se(part: int, n: int) -> float | None:
    return round(math.sqrt(part / n * (1 - part / n) / n), 4) if n else None


def _mean(total: float, n: int) -> float | None:
    return round(total / n, 2) if n else None


def _mean_se(total: float, squares: float, n: int) -> float | None:
    if n < 2:
        return None
    return round(math.sqrt(max(0.0, squares / n - (total / n) ** 2) / (n - 1)), 2)
