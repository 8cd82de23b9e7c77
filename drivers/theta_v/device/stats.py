"""How the camera is doing, counted where it happens and read as one frozen value."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from enum import StrEnum

from drivers.theta_v.codec.access_units import AccessUnit

WINDOW_NS = 2_000_000_000  # rates are over the last two seconds
MAX_IN_WINDOW = 256  # four times as many pictures as the camera sends in that time


class Link(StrEnum):
    """State of the link, in the words all devices of this robot share."""

    CLOSED = "closed"
    CONNECTING = "connecting"
    IDENTIFYING = "identifying"
    CONFIGURING = "configuring"
    STREAMING = "streaming"
    BACKOFF = "backoff"


@dataclass(frozen=True, slots=True)
class ThetaStats:
    link: Link = Link.CLOSED
    detail: str = ""
    """Why, in words for the person at the robot; empty when all is well."""
    received: int = 0
    """Pictures that came, whatever their state."""
    damaged: int = 0
    """Of these, pictures with missing or doubtful bytes."""
    tainted: int = 0
    """Of these, pictures that are damaged or inherit damage or loss."""
    lost: int = 0
    """Pictures known never to have come."""
    dropped: int = 0
    """Good pictures not handed out because a reader was too slow, over all readers."""
    restarts: int = 0
    """Times the recovery ladder restarted the stream without letting go of the camera."""
    reconnects: int = 0
    rate_hz: float = 0.0
    bit_rate: float = 0.0
    """Bits per second of H.264."""
    last_ns: int | None = None
    """Arrival of the newest picture."""
    model: str = ""
    serial: str = ""
    firmware: str = ""
    usb_id: str = ""
    width: int = 0
    height: int = 0
    battery_percent: int | None = None
    """None until the camera has told."""
    charging: str = ""
    faults: tuple[str, ...] = ()
    """What the camera itself complains about, most urgent first: heat, battery, hardware."""


class Meter:
    """Counts access units in the collecting thread; read from the event loop."""

    def __init__(self) -> None:
        self.received = 0
        self.damaged = 0
        self.tainted = 0
        self.last_ns: int | None = None
        self._window: deque[tuple[int, int]] = deque(maxlen=MAX_IN_WINDOW)
        self._lock = threading.Lock()

    def count(self, unit: AccessUnit) -> None:
        with self._lock:
            self.received += 1
            self.damaged += unit.damaged
            self.tainted += unit.tainted
            self.last_ns = unit.stamp_ns
            self._window.append((unit.stamp_ns, len(unit.raw)))

    def rates(self, now_ns: int) -> tuple[float, float]:
        """Pictures and bits per second of the last two seconds."""
        with self._lock:
            recent = [(t, size) for t, size in self._window if now_ns - t < WINDOW_NS]
        if len(recent) < 2:
            return 0.0, 0.0
        # A stream that stopped slows down on the display instead of keeping its last rate.
        newest = max(recent[-1][0], now_ns - WINDOW_NS // 4)
        span_s = max((newest - recent[0][0]) / 1e9, 1e-3)
        return (len(recent) - 1) / span_s, 8 * sum(size for _, size in recent[1:]) / span_s
