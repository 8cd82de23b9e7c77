"""How much room a disk has for a recording, and what still goes onto it."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

# A trial this long does not fit into the last corner of a full disk.
TRIAL_BYTES = 1 << 20

# A level that was left is entered again only with this much more room: no flapping at the mark.
HYSTERESIS = 1.1


class Level(IntEnum):
    """The smaller, the better."""

    FINE = 0
    LOW = 1
    NO_VIDEO = 2
    STOP = 3
    GONE = 4
    """Not writable at all: full, removed, read-only, unplugged."""


@dataclass(frozen=True, slots=True)
class Watermarks:
    """Free bytes below which the robot warns, records no more video, and records nothing."""

    warn: int = 5 << 30
    no_video: int = 2 << 30
    stop: int = 512 << 20

    def level(self, free: int, before: Level = Level.FINE) -> Level:
        """The level at `free` bytes; getting better than `before` takes a little more than getting worse."""
        for level, mark in ((Level.STOP, self.stop), (Level.NO_VIDEO, self.no_video), (Level.LOW, self.warn)):
            if free < (mark * HYSTERESIS if before >= level else mark):
                return level
        return Level.FINE


@dataclass(frozen=True, slots=True)
class Disk:
    """One place where recordings may go, as it was found just now."""

    directory: Path
    level: Level
    free: int

    @property
    def free_text(self) -> str:
        return f"{self.free / 1e9:.1f} GB" if self.free >= 1e9 else f"{self.free / 1e6:.0f} MB"


def look_at(directory: Path, marks: Watermarks, before: Level = Level.FINE) -> Disk:
    """The disk under `directory`, or under its nearest existing parent; GONE where nothing can be written."""
    place = directory
    while not place.is_dir() and place != place.parent:
        place = place.parent
    try:
        free = shutil.disk_usage(place).free
    except OSError:
        return Disk(directory, Level.GONE, 0)
    if not os.access(place, os.W_OK):
        return Disk(directory, Level.GONE, free)
    return Disk(directory, marks.level(free, before), free)


def takes_bytes(folder: Path) -> bool:
    """Whether a trial file really arrives in `folder`."""
    trial = folder / ".trial"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with trial.open("wb") as file:
                file.write(bytes(TRIAL_BYTES))
                file.flush()
                os.fdatasync(file.fileno())
        finally:
            trial.unlink(missing_ok=True)
    except OSError:
        return False
    return True
