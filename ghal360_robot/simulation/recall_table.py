"""How often the detectors find the things that are searched for, by distance: the measured table and its reader.

`data/recall.json` is what `benchmarks/recall.py` writes; experiments without pictures draw sightings from it.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


@dataclass(frozen=True, slots=True)
class Row:
    """What was found of one class in one world (`all` for both) from between two distances, in metres."""

    detector: str
    name: str
    world: str
    near_m: float
    far_m: float
    views: int
    single: float
    """Share of the pictures in which the thing was reported with its own class, at the detector's thresholds."""
    fused: float
    """Share of the views in which it was believed to be there after 2 s."""
    score: float
    """Mean score where it was reported; 0 where it never was."""


@dataclass(frozen=True, slots=True)
class Share:
    """How many of how many."""

    found: int
    of: int

    @property
    def share(self) -> float:
        return self.found / self.of if self.of else 0.0

    def interval(self, z: float = 1.96) -> tuple[float, float]:
        """Wilson's interval for the chance behind it, 95 % unless another quantile is given."""
        if not self.of:
            return 0.0, 1.0
        n, p = self.of, self.share
        middle, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        scale = 1 + z * z / n
        return max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale)

    def to_json(self) -> dict[str, Any]:
        low, high = self.interval()
        return {"share": round(self.share, 3), "views": self.of, "interval": [round(low, 3), round(high, 3)]}


def within(rows: Sequence[Row], detector: str, name: str, limit_m: float) -> Share:
    """Views in both worlds from no farther than this, and after how many of them the thing was believed in."""
    near = [row for row in rows if (row.detector, row.name, row.world) == (detector, name, "all")]
    near = [row for row in near if row.far_m <= limit_m]
    return Share(sum(round(row.fused * row.views) for row in near), sum(row.views for row in near))


@dataclass(frozen=True, slots=True)
class RecallTable:
    """All rows, and under which configuration they were measured."""

    config: Mapping[str, Any]
    rows: tuple[Row, ...]

    def recall(self, detector: str, name: str, distance_m: float, *, fused: bool = False, world: str = "all") -> float:
        """Chance to find a thing in unhindered view in one picture, or after 2 s (`fused`); 0 beyond what was measured.

        Nearer than the nearest measured distance, that one counts. Raises KeyError for what was not measured.
        """
        rows = [row for row in self.rows if (row.detector, row.name, row.world) == (detector, name, world)]
        if not rows:
            raise KeyError(f"the recall of {name!r} by {detector!r} was not measured")
        for row in sorted(rows, key=lambda row: row.far_m):
            if distance_m <= row.far_m:
                return row.fused if fused else row.single
        return 0.0


def config_hash(config: Mapping[str, Any]) -> str:
    """The same for the same configuration, whatever the order of its entries."""
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:16]


def table_of(document: Mapping[str, Any]) -> RecallTable:
    """The table in a parsed file. Raises ValueError if its configuration is not the one it was written with."""
    config, rows = document["config"], document["rows"]
    if config_hash(config) != document["config_hash"]:
        raise ValueError("The recall table does not fit its configuration; write it anew with benchmarks/recall.py.")
    return RecallTable(config, tuple(Row(**row) for row in rows))


@cache
def shipped() -> RecallTable:
    """The table that comes with the package."""
    text = resources.files("ghal360_robot.simulation").joinpath("data/recall.json").read_text("utf-8")
    return table_of(json.loads(text))


def as_text(rows: Sequence[Row]) -> str:
    """A table to read: one line a class and distance, two columns a detector (single picture, after 2 s)."""
    detectors = list(dict.fromkeys(row.detector for row in rows))
    lines = [f"{'class':12}{'world':8}{'metres':>11}" + "".join(f"{name:>18}" for name in detectors)]
    cells: dict[tuple[str, str, float, float], dict[str, Row]] = {}
    for row in rows:
        cells.setdefault((row.name, row.world, row.near_m, row.far_m), {})[row.detector] = row
    for (name, world, near, far), found in cells.items():
        columns = "".join(f"{found[d].single:9.2f}{found[d].fused:9.2f}" if d in found else " " * 18 for d in detectors)
        lines.append(f"{name:12}{world:8}{near:5.1f}-{far:<5.1f}{columns}")
    return "\n".join(lines)
