"""Learned policies on disk."""

from __future__ import annotations

from pathlib import Path

from ghal360_robot.atomic import write_atomically
from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.guidance.saved import MAX_BYTES, PolicyFormatError, SavedPolicy, from_bytes, to_bytes

KNOWN = "guidance.json"
"""In a run's folder: what the run began with, for its replay."""


def load_policy(path: Path) -> SavedPolicy:
    """Raises UsageError where there is no policy that can be read."""
    try:
        with path.open("rb") as file:
            return from_bytes(file.read(MAX_BYTES + 1))
    except OSError as error:
        raise UsageError(f"cannot read the policy {path}: {error.strerror}") from error
    except PolicyFormatError as error:
        raise UsageError(f"{path}: {error}") from error


def save_policy(path: Path, policy: SavedPolicy) -> None:
    """Whole or not at all. Raises GhalError where it cannot be written."""
    try:
        write_atomically(path, to_bytes(policy))
    except OSError as error:
        raise GhalError(f"cannot write the policy {path}: {error.strerror}") from error


def known_before(memory: str) -> SavedPolicy | None:
    """What is in the file named by `guidance.memory`; None where there is no such file yet, or none is named."""
    path = Path(memory).expanduser()
    return load_policy(path) if memory and path.exists() else None
