"""What a recorder may be told about where and how much to write."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.logbook.disk import Watermarks

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class RecorderSettings:
    """Defaults are those of the configuration's section [logbook]."""

    second_directory: Path | None = None
    """Where the recording goes on when the first place is full, broken or gone."""
    part_bytes: int = 512 << 20
    part_s: float = 600.0
    """A part ends at the next key picture after so many bytes or seconds."""
    watermarks: Watermarks = Watermarks()
    video_always: bool = True
    """Otherwise pictures are written around bookmarks only, from 30 s before to 30 s after."""
