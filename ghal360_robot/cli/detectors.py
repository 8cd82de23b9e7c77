"""`ghal360 detectors`: which detectors there are, and how to add one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ghal360_robot.errors import UsageError
from ghal360_robot.perception.detectors import store
from ghal360_robot.perception.detectors.base import CENTERNET, DETECTORS
from ghal360_robot.perception.detectors.npm import add_centernet

app = typer.Typer(help="Detectors and their weights.", no_args_is_help=True)

AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")]


@app.command("list", epilog="Example: ghal360 detectors list --json")
def list_(as_json: AsJson = False) -> None:
    """Detectors that can be chosen on this machine, and where their weights are."""
    kept = store.entries()
    rows = {name: {"kind": "built in", "ready": True, "files": []} for name in DETECTORS}
    rows[CENTERNET] = {"kind": CENTERNET, "ready": CENTERNET in kept, "files": []}
    for name, entry in kept.items():
        rows[name] = {"kind": entry.kind, "ready": True, "files": [str(path) for path, _ in entry.files.values()]}
    if as_json:
        print(json.dumps({"folder": str(store.cache_folder()), "detectors": rows}))
        return
    for name, row in rows.items():
        where = "" if row["ready"] else f": run `ghal360 detectors add {name}`"
        print(f"{name:16} {row['kind']}{where}")


@app.command(epilog="Example: ghal360 detectors add centernet")
def add(
    name: Annotated[str, typer.Argument(help="What it is to be called; centernet is fetched by itself")],
    paths: Annotated[list[Path] | None, typer.Argument(help="The packed npm package, where npm is elsewhere")] = None,
) -> None:
    """Keep a detector's weights on this machine, checked by hash."""
    if name != CENTERNET:
        raise UsageError(f"only {CENTERNET} can be added, not '{name}'")
    if paths and len(paths) > 1:
        raise UsageError("one file or folder at most: the packed package or its models folder")
    entry = add_centernet(paths[0] if paths else None)
    print(f"added {entry.name} in {store.cache_folder()}")
