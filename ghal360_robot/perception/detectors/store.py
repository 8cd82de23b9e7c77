"""The detectors' weights on this machine: a folder of files named by their hash, and a description of each detector.

A description is written last and replaced in one step, so that a detector is there whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ghal360_robot.perception.detectors.errors import WeightsError

if TYPE_CHECKING:
    from collections.abc import Mapping

CACHE_VARIABLE = "GHAL360_CACHE"
MAX_FILE_BYTES = 2 << 30
"""Eight times YOLOv3: nobody's detector for a robot is larger."""
NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}")


def cache_folder() -> Path:
    """Where weights are kept: GHAL360_CACHE, or `ghal360` in the user's cache."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ghal360" / "detectors"


@dataclass(frozen=True, slots=True)
class Entry:
    """One detector's weights; `files` are (path, SHA-256) by what they are (json, bin, cfg, weights, model)."""

    name: str
    kind: str
    files: dict[str, tuple[Path, str]]

    def has(self, role: str) -> bool:
        return role in self.files

    def read(self, role: str) -> bytes:
        """A file's content, checked against its hash. Raises WeightsError."""
        if role not in self.files:
            raise WeightsError(
                f"The description of the detector '{self.name}' names no {role} file: {again(self.name)}"
            )
        path, expected = self.files[role]
        try:
            content = path.read_bytes()
        except OSError as error:
            raise WeightsError(
                f"The weights of '{self.name}' cannot be read ({path}: {error.strerror}): {again(self.name)}"
            ) from error
        if hashlib.sha256(content).hexdigest() != expected:
            raise WeightsError(f"The weights of '{self.name}' are damaged ({path}): {again(self.name)}")
        return content


@dataclass(frozen=True, slots=True)
class Proposed:
    """Files that are not kept yet, to be read like those of an entry."""

    name: str
    kind: str
    contents: dict[str, bytes]

    def has(self, role: str) -> bool:
        return role in self.contents

    def read(self, role: str) -> bytes:
        return self.contents[role]


def proposed(name: str, kind: str, files: Mapping[str, tuple[str, bytes]]) -> Proposed:
    """The same as `save` would keep. Raises WeightsError for an impossible name."""
    check_name(name)
    return Proposed(name, kind, {role: content for role, (_, content) in files.items()})


def check_name(name: str) -> None:
    """Raises WeightsError."""
    if not NAME.fullmatch(name):
        raise WeightsError(f"'{name}' cannot be a detector's name: small letters, digits, '.', '_' and '-' only.")


def again(name: str) -> str:
    return f"add it again with `ghal360 detectors add {name}`."


def entries(folder: Path | None = None) -> dict[str, Entry]:
    """Every detector whose weights were added, by name; descriptions that cannot be read are left out."""
    where = folder or cache_folder()
    found = {}
    for path in sorted(where.glob("*.json")) if where.is_dir() else ():
        try:
            found[path.stem] = _parse(path)
        except WeightsError:
            continue
    return found


def entry(name: str, folder: Path | None = None) -> Entry | None:
    """The detector of this name, or None where it was never added. Raises WeightsError for a broken description."""
    if not NAME.fullmatch(name):
        return None
    path = (folder or cache_folder()) / f"{name}.json"
    return _parse(path) if path.is_file() else None


def save(
    name: str,
    kind: str,
    files: Mapping[str, tuple[str, bytes]],
    folder: Path | None = None,
) -> Entry:
    """Keep a detector's files ((file name, content) by what they are). Raises WeightsError."""
    check_name(name)
    where = folder or cache_folder()
    described: dict[str, dict[str, str]] = {}
    try:
        (where / "files").mkdir(parents=True, exist_ok=True)
        for role, (file_name, content) in files.items():
            digest = hashlib.sha256(content).hexdigest()
            kept = f"files/{digest[:16]}-{Path(file_name).name}"
            _replace(where / kept, content)
            described[role] = {"file": kept, "sha256": digest}
        description = {"kind": kind, "files": described}
        _replace(where / f"{name}.json", json.dumps(description, indent=1).encode())
    except OSError as error:
        raise WeightsError(
            f"The weights cannot be kept in {where} ({error.strerror}): free some space or set {CACHE_VARIABLE}."
        ) from error
    return _parse(where / f"{name}.json")


def _replace(path: Path, content: bytes) -> None:
    """Write a file so that nobody ever sees half of it."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".adding-")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _parse(path: Path) -> Entry:
    try:
        data: dict[str, Any] = json.loads(path.read_bytes())
        files = {role: (path.parent / file["file"], str(file["sha256"])) for role, file in data["files"].items()}
        return Entry(path.stem, str(data["kind"]), files)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise WeightsError(f"The description {path} of a detector is damaged: {again(path.stem)}") from error
