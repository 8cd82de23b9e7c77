"""What comes back out of a recording: frozen values, stamps in the recorded robot's monotonic nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.messages import Stops

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ghal360_robot.messages import Applied, Command, Decision, Freshness, Lease, LinkStats, Lock, Pose2


@dataclass(frozen=True, slots=True)
class AccessUnit:
    stamp_ns: int
    data: bytes
    """Annex B, as received."""
    keyframe: bool
    sequence: int
    tainted: bool
    latency_ns: int


@dataclass(frozen=True, slots=True)
class Telegram:
    stamp_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class CanFrame:
    stamp_ns: int
    direction: str
    can_id: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Text:
    stamp_ns: int
    source: str
    level: str
    text: str


@dataclass(frozen=True, slots=True)
class Link:
    stamp_ns: int
    device: str
    stats: LinkStats


@dataclass(frozen=True, slots=True)
class Truth:
    stamp_ns: int
    pose: Pose2


@dataclass(frozen=True, slots=True)
class Map:
    stamp_ns: int
    cells: NDArray[np.uint8]
    resolution_m: float
    origin: Pose2


@dataclass(frozen=True, slots=True)
class Tick:
    """One control tick. The stamps name the messages it saw (None: nothing had come yet)."""

    stamp_ns: int
    tick: int
    base_ns: int | None
    scan_ns: int | None
    detections_ns: int | None
    operator_ns: int | None
    freshness: dict[str, Freshness]
    decision: Decision
    applied: Applied
    lateness_ms: float
    work_ms: float
    commands: tuple[Command, ...] = ()
    locks: tuple[Lock, ...] = ()
    lease: Lease | None = None
    stops: Stops = Stops()
