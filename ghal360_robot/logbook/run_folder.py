"""The folder of one run: its name, and the `meta.json` that tells what it is without opening a recording."""

from __future__ import annotations

import hashlib
import json
import platform
import secrets
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from ghal360_robot.logbook.errors import RecordingNotWritableError

if TYPE_CHECKING:
    from pathlib import Path

    from ghal360_robot.logbook.statics import Run

PACKAGES = ("ghal360-robot", "rerun-sdk", "numpy", "av", "opencv-python-headless", "python-can")


def new_run_id(wall_ns: int) -> str:
    """`2026-10-11T09-30-00Z-a1b2c3`: sortable, a file name everywhere, unique."""
    started = datetime.fromtimestamp(wall_ns // 1_000_000_000, UTC)
    return f"{started:%Y-%m-%dT%H-%M-%SZ}-{secrets.token_hex(3)}"


def create(directory: Path, run: Run) -> Path:
    """Make `<directory>/<run_id>` with its `meta.json`.

    Raises:
        RecordingNotWritableError: the place cannot be written, or holds this run already.
    """
    folder = directory / run.run_id
    try:
        folder.mkdir(parents=True)
        (folder / "meta.json").write_text(json.dumps(_meta(run), indent=2, ensure_ascii=False) + "\n")
    except FileExistsError as error:
        raise RecordingNotWritableError(
            f"A recording named {run.run_id} is already in {directory}: choose another name."
        ) from error
    except OSError as error:
        raise RecordingNotWritableError(
            f"Recordings cannot be written to {directory} ({error.strerror}): "
            "make that folder writable or choose another one."
        ) from error
    return folder


def _meta(run: Run) -> dict[str, object]:
    return {
        "run_id": run.run_id,
        "started": datetime.fromtimestamp(run.anchor.wall_ns / 1e9, UTC).isoformat(),
        "anchor": {"monotonic_ns": run.anchor.monotonic_ns, "wall_ns": run.anchor.wall_ns},
        "versions": {"python": platform.python_version(), **_versions()},
        "config_sha256": hashlib.sha256(run.config_json.encode()).hexdigest(),
        "config_json": run.config_json,
        "properties": dict(run.properties),
        "mounts": {name: {"x": m.x, "y": m.y, "z": m.z, "yaw": m.yaw} for name, m in run.mounts.items()},
    }


def _versions() -> dict[str, str]:
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
