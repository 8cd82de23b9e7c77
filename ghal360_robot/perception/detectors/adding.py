"""Detectors of the user's own: which kind a set of files is, and whether it can be loaded at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ghal360_robot.errors import UsageError
from ghal360_robot.perception.detectors import store
from ghal360_robot.perception.detectors.base import CENTERNET, DETECTORS, DetectorOptions
from ghal360_robot.perception.detectors.networks import load_network
from ghal360_robot.perception.detectors.npm import add_centernet, read_file

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from ghal360_robot.perception.detectors.store import Entry

KINDS = {frozenset({".onnx"}): "onnx", frozenset({".cfg", ".weights"}): "darknet"}
"""What files of these endings are."""
ROLES = {".onnx": "model", ".cfg": "cfg", ".weights": "weights"}


def add(name: str, paths: Sequence[Path], names: Path | None = None, folder: Path | None = None) -> Entry:
    """Keep these files as the detector `name`, after loading it once. Raises UsageError, DetectorError."""
    if name == CENTERNET:
        if len(paths) > 1 or names is not None:
            raise UsageError("centernet is fetched by itself; at most give the packed npm package or a folder with it")
        return add_centernet(paths[0] if paths else None, folder)
    if name in DETECTORS:
        raise UsageError(f"'{name}' is built in: choose another name")
    kind = KINDS.get(frozenset(path.suffix.lower() for path in paths))
    if kind is None or len(paths) != len({path.suffix.lower() for path in paths}):
        raise UsageError("a detector is one .onnx file, or a .cfg and a .weights file; give their paths")
    files = {ROLES[path.suffix.lower()]: (path.name, read_file(path)) for path in paths}
    if names is not None:
        files["names"] = (names.name, read_file(names))
    load_network(store.proposed(name, kind, files), DetectorOptions())
    return store.save(name, kind, files, folder=folder)
