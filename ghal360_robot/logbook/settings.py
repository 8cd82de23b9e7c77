"""What a recorder may be told: where and how much to write, and who may watch."""

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


@dataclass(frozen=True, slots=True)
class LiveSettings:
    """Where viewers connect."""

    host: str = "127.0.0.1"
    port: int = 9876
    web_port: int | None = None
    """Also serve the viewer itself to browsers, on this port."""
    history_bytes: int = 96 << 20
    """What the server keeps for viewers that come later: at least two groups of pictures, or they see none."""
    memory_bytes: int = 1 << 30
    """A server that needs more, because of a viewer that is too slow, is started again."""
