"""The folder of one run: its name, and the `meta.json` that tells what it is without opening a recording."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import secrets
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ghal360_robot.logbook.clock import clock_quality
from ghal360_robot.logbook.errors import RecordingNotWritableError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ghal360_robot.logbook.statics import Run

PACKAGES = ("ghal360-robot", "rerun-sdk", "numpy", "torch", "av", "opencv-python-headless", "python-can", "pyarrow")
META = "meta.json"
MAX_META_BYTES = 4 << 20
"""Settings and a hundred bookmarks are some kilobytes."""


def new_run_id(wall_ns: int) -> str:
    """`2026-10-11T09-30-00Z-a1b2c3`: sortable, a file name everywhere, unique."""
    started = datetime.fromtimestamp(wall_ns // 1_000_000_000, UTC)
    return f"{started:%Y-%m-%dT%H-%M-%SZ}-{secrets.token_hex(3)}"


def create(directories: Sequence[Path], run: Run) -> list[Path]:
    """The run's folders, the first that can be made among them made, with its `meta.json`.

    Raises:
        RecordingNotWritableError: no place can be written, or one holds this run already.
    """
    folders = [directory.absolute() / run.run_id for directory in directories]
    for folder in folders:
        if folder.exists():
            raise RecordingNotWritableError(
                f"A recording named {run.run_id} is already in {folder.parent}: choose another name."
            )
    trouble = []
    for folder in folders:
        try:
            folder.mkdir(parents=True)
            write_meta(folder, meta(run, folders))
        except OSError as error:
            trouble.append(f"{folder.parent} ({error.strerror})")
        else:
            return folders
    raise RecordingNotWritableError(
        f"Recordings cannot be written to {' or '.join(trouble)}: make that folder writable or choose another one."
    )


def meta(run: Run, folders: Sequence[Path]) -> dict[str, Any]:
    """What `meta.json` says at the beginning of a run."""
    mounts = {name: {"x": m.x, "y": m.y, "z": m.z, "yaw": m.yaw} for name, m in run.mounts.items()}
    return {
        "run_id": run.run_id,
        "robot": run.properties.get("robot", ""),
        "host": platform.node(),
        "started": datetime.fromtimestamp(run.anchor.wall_ns / 1e9, UTC).isoformat(),
        "anchor": {"monotonic_ns": run.anchor.monotonic_ns, "wall_ns": run.anchor.wall_ns},
        "clock": clock_quality(),
        "versions": {"python": platform.python_version(), "git": git_commit(), **_versions()},
        "config_sha256": hashlib.sha256(run.config_json.encode()).hexdigest(),
        "config_json": run.config_json,
        "calibration_sha256": hashlib.sha256(run.calibration_json.encode()).hexdigest(),
        "calibration_json": run.calibration_json,
        "properties": dict(run.properties),
        "mounts": mounts,
        "folders": [str(folder) for folder in folders],
    }


def write_meta(folder: Path, content: dict[str, Any], *, sync: bool = True) -> None:
    """Replace the file as a whole: a power cut leaves the old one or the new one. Raises OSError.

    To `sync` is to wait for all that the disk still owes, which may be seconds' worth of video; without, the old or
    the new one is left where the file system writes a file out before it takes another's place (ext4, btrfs).
    """
    beside = folder / f".{META}"
    with beside.open("w", encoding="utf-8") as file:
        file.write(json.dumps(content, indent=2, ensure_ascii=False) + "\n")
        if sync:
            file.flush()
            os.fsync(file.fileno())
    beside.replace(folder / META)


def read_meta(folder: Path) -> dict[str, Any]:
    """The content, or nothing where it is missing or damaged."""
    try:
        with (folder / META).open("rb") as file:
            found = json.loads(file.read(MAX_META_BYTES))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def folders_of(folder: Path) -> list[Path]:
    """`folder` and the other places of the same run, as far as they are there."""
    named = read_meta(folder).get("folders")
    others = [Path(name) for name in named if isinstance(name, str)] if isinstance(named, list) else []
    same_run = [other for other in others if other.name == folder.name and other.is_dir()]
    return [folder, *(other for other in same_run if other.resolve() != folder.resolve())]


def files_of(folder: Path, suffix: str) -> list[Path]:
    """The parts of a run, or the logs ahead of them, in order, wherever they were written.

    Parts are numbered across all places: one of the same name elsewhere is what `folder` was copied from.
    """
    found: dict[str, Path] = {}
    for place in folders_of(folder):
        for file in place.glob(f"part-*{suffix}"):
            found.setdefault(file.name, file)
    return [found[name] for name in sorted(found)]


def git_commit() -> str:
    """The commit this code was checked out at; empty where it was not."""
    git = Path(__file__).parents[2] / ".git"
    try:
        head = (git / "HEAD").read_text().strip()
        if not head.startswith("ref: "):
            return head
        reference = head.removeprefix("ref: ")
        if (git / reference).is_file():
            return (git / reference).read_text().strip()
        packed = (git / "packed-refs").read_text().splitlines()
    except OSError:
        return ""
    return next((line.split()[0] for line in packed if line.endswith(f" {reference}")), "")


def ending(run: Run, stats: object, bookmarks: Sequence[object]) -> dict[str, Any]:
    """What is known only at the end of a run."""
    now = datetime.now(UTC)
    return {
        "ended": now.isoformat(),
        "seconds": round(now.timestamp() - run.anchor.wall_ns / 1e9, 3),
        "rows": asdict(stats),  # type: ignore[call-overload]
        "bookmarks": [asdict(bookmark) for bookmark in bookmarks],  # type: ignore[call-overload]
    }


def _versions() -> dict[str, str]:
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
