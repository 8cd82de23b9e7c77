"""What can be chosen about the camera, with the reason for each default."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Mode(Enum):
    """Live picture sizes of the V; which of them this camera offers is read from its descriptors."""

    TWO_K = (1920, 960)
    FOUR_K = (3840, 1920)

    @property
    def width(self) -> int:
        return self.value[0]

    @property
    def height(self) -> int:
        return self.value[1]


@dataclass(frozen=True, slots=True)
class ThetaConfig:
    mode: Mode = Mode.TWO_K
    serial: str | None = None
    """Eight digits on the camera's base; None takes the first THETA found."""
    pass_tainted: bool = True
    """Hand out pictures that inherit damage, marked; False drops them until the next key picture."""
    queue_units: int = 8
    """Pictures a slow reader may fall behind (a quarter of a second) before older ones are dropped."""
    stall_s: float = 1.0
    """Without a picture for so long the recovery ladder begins: thirty pictures are missing by then."""
    first_picture_s: float = 3.0
    """As stall_s, for the first picture after a start: the camera's encoder has to get going."""
    key_picture_s: float = 5.0
    """So long damage is carried, or a reader kept waiting, for want of a key picture; then the stream is restarted."""
    reenumeration_s: float = 10.0
    """How long the camera may take to come back after the switch to live mode (fact sheet 4.4)."""
    backoff_min_s: float = 0.25
    """First pause before trying again; doubles with each failure."""
    backoff_max_s: float = 5.0
    """A camera plugged in again is found at the latest after this long."""
    health_s: float = 10.0
    """How often battery and faults are asked for while streaming; also keeps the camera awake. 0: never."""
    keep_awake: bool = True
    """Never let it sleep or switch itself off. False is for finding out when it would: with `health_s` 0."""
