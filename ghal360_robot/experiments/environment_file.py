"""Grid environments as JSON files; docs/environments.md describes the format. Hostile files are refused."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

from ghal360_robot.experiments.errors import EnvironmentFileError
from ghal360_robot.experiments.grid import FREE, FURNITURE, WALL, GridMap, Thing

if TYPE_CHECKING:
    from pathlib import Path

FORMAT = "ghal360-environment"
VERSION = 1
MAX_BYTES = 64_000_000
"""The largest Matterport graphs have 30 MB."""
MAX_CELLS = 20_000
"""Tables grow with the square: 20,000 cells are 0.4 GB."""
MAX_THINGS = 500


def to_json(grid: GridMap) -> str:
    """The file's text: stable, one row of the map per line."""
    body = {
        "format": FORMAT,
        "version": VERSION,
        "name": grid.name,
        "cell_m": grid.cell_m,
        "steps": "partial" if grid.partial_steps else "whole",
        "rows": list(grid.rows),
        "targets": [{"name": t.name, "x": t.x, "y": t.y} for t in grid.targets],
        "clutter": [{"name": t.name, "x": t.x, "y": t.y} for t in grid.clutter],
    }
    return json.dumps(body, indent=1) + "\n"


def read_json(path: Path) -> Any:
    """The contents of a JSON file of bearable size. Raises EnvironmentFileError."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise EnvironmentFileError(f"cannot read the environment {path}: {error.strerror}") from error
    if len(data) > MAX_BYTES:
        raise EnvironmentFileError(f"{path} is larger than any environment ({MAX_BYTES // 1_000_000} MB)")
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        raise EnvironmentFileError(f"{path} is no JSON file") from None


def from_json(body: Any, where: str) -> GridMap:
    """Raises EnvironmentFileError, naming `where`, for anything that is not an environment of this version."""
    if not isinstance(body, dict) or body.get("format") != FORMAT or body.get("version") != VERSION:
        raise EnvironmentFileError(f"{where} is no environment of format {FORMAT!r}, version {VERSION}")
    rows = body.get("rows")
    if not isinstance(rows, list) or not rows or not all(isinstance(row, str) for row in rows):
        raise EnvironmentFileError(f"{where}: 'rows' has to be a list of strings")
    width = len(rows[0])
    if not width or any(len(row) != width or set(row) - {FREE, WALL, FURNITURE} for row in rows):
        raise EnvironmentFileError(f"{where}: every row has to be as long as the first, of '.', '#' and 'o' only")
    if width * len(rows) > MAX_CELLS:
        raise EnvironmentFileError(f"{where}: {width} x {len(rows)} cells are more than {MAX_CELLS}; use larger cells")
    cell_m = number(body.get("cell_m"), f"{where}: 'cell_m'", 0.05, 5.0)
    steps = body.get("steps", "whole")
    if steps not in {"whole", "partial"}:
        raise EnvironmentFileError(f"{where}: 'steps' has to be 'whole' or 'partial'")
    targets = _things(body.get("targets"), f"{where}: 'targets'")
    if not targets:
        raise EnvironmentFileError(f"{where}: there is nothing to search for in it")
    return GridMap(
        name=text(body.get("name"), f"{where}: 'name'"),
        cell_m=cell_m,
        rows=tuple(rows),
        targets=targets,
        clutter=_things(body.get("clutter", []), f"{where}: 'clutter'"),
        partial_steps=steps == "partial",
    )


def number(value: Any, what: str, low: float, high: float) -> float:
    """A finite number in [low, high]. Raises EnvironmentFileError."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise EnvironmentFileError(f"{what} has to be a number, not {value!r:.40}")
    if not low <= value <= high:
        raise EnvironmentFileError(f"{what} has to lie in {low:g} .. {high:g}, not at {value:g}")
    return float(value)


def text(value: Any, what: str) -> str:
    """A short name. Raises EnvironmentFileError."""
    if not isinstance(value, str) or not 0 < len(value) <= 100:
        raise EnvironmentFileError(f"{what} has to be a name, not {value!r:.40}")
    return value


def _things(items: Any, what: str) -> tuple[Thing, ...]:
    if not isinstance(items, list) or len(items) > MAX_THINGS:
        raise EnvironmentFileError(f"{what} has to be a list of at most {MAX_THINGS} things")
    found = []
    for item in items:
        if not isinstance(item, dict):
            raise EnvironmentFileError(f"{what} has to hold objects with 'name', 'x' and 'y'")
        found.append(
            Thing(
                text(item.get("name"), f"{what}: 'name'"),
                number(item.get("x"), f"{what}: 'x'", -1e4, 1e4),
                number(item.get("y"), f"{what}: 'y'", -1e4, 1e4),
            )
        )
    return tuple(found)
