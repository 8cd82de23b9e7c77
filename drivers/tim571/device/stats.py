"""What the driver knows about the lidar and its link."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum

from drivers.tim571.codec.commands import OutputContent
from drivers.tim571.codec.dialect import Dialect


class LinkState(Enum):
    """Where the link stands."""

    CLOSED = "closed"
    CONNECTING = "connecting"
    IDENTIFYING = "identifying"
    CONFIGURING = "configuring"
    STREAMING = "streaming"
    BACKOFF = "backoff"


class DeviceState(Enum):
    """`SCdevicestate`, and UNKNOWN for what it doesn't list."""

    BUSY = 0
    READY = 1
    ERROR = 2
    UNKNOWN = -1

    @classmethod
    def _missing_(cls, value: object) -> DeviceState:
        return cls.UNKNOWN


@dataclass(frozen=True, slots=True)
class Identity:
    """What the device says about itself; empty or None where it didn't say."""

    dialect: Dialect
    type: str = ""
    version: str = ""
    firmware: str = ""
    serial: str = ""
    name: str = ""
    state: DeviceState = DeviceState.UNKNOWN
    operating_hours: float | None = None
    power_ons: int | None = None
    output: OutputContent | None = None


@dataclass(frozen=True, slots=True)
class TimStats:
    """A snapshot; counters run from the driver's start."""

    state: LinkState
    detail: str
    """Why the link is where it is, in a sentence."""
    identity: Identity | None
    received: int = 0
    """Scans."""
    lost: int = 0
    """Scans that the scan counter says we missed."""
    repeated: int = 0
    """Telegrams with a scan we already had."""
    damaged: int = 0
    """Stretches of bytes that were no good telegram."""
    dropped: int = 0
    """Scans that a slow consumer never took."""
    reconnects: int = 0
    restarts: int = 0
    """Times the device itself began anew."""
    rate_hz: float = 0.0
    last_ns: int | None = None
    """Arrival of the newest scan."""


class Rate:
    """Arrivals per second over the newest two seconds of scans."""

    def __init__(self, window: int = 31) -> None:
        self._arrivals: deque[int] = deque(maxlen=window)

    def add(self, arrival_ns: int) -> None:
        """One more arrived."""
        self._arrivals.append(arrival_ns)

    def clear(self) -> None:
        """The stream was interrupted."""
        self._arrivals.clear()

    @property
    def hz(self) -> float:
        """0.0 until two have arrived."""
        spans = len(self._arrivals) - 1
        elapsed_ns = self._arrivals[-1] - self._arrivals[0] if spans > 0 else 0
        return spans * 1e9 / elapsed_ns if elapsed_ns > 0 else 0.0
