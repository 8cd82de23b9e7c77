"""What the driver knows about the lidar and its link."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum

from drivers.tim571.codec.answers import DeviceState
from drivers.tim571.codec.commands import OutputContent, OutputRange
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.device.clock import ClockState
from drivers.tim571.device.scan import DeviceStatus


class LinkState(Enum):
    """Where the link stands."""

    CLOSED = "closed"
    CONNECTING = "connecting"
    IDENTIFYING = "identifying"
    CONFIGURING = "configuring"
    STREAMING = "streaming"
    BACKOFF = "backoff"


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
    output_range: OutputRange | None = None


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
    """Stretches of bytes that were no good telegram, and telegrams that cannot be true."""
    implausible: int = 0
    """The latter of these alone: well framed, but they contradict themselves or those before."""
    doubts: tuple[str, ...] = ()
    """What the newest implausible telegram had against it."""
    dropped: int = 0
    """Scans that a slow consumer never took."""
    reconnects: int = 0
    restarts: int = 0
    """Times the device itself began anew."""
    rate_hz: float = 0.0
    last_ns: int | None = None
    """Arrival of the newest scan."""
    status: DeviceStatus = DeviceStatus.OK
    """What the newest scan says about the device's health."""
    clock: ClockState = ClockState()
    warning: str = ""
    """What is not as configured although scans come, and what to do; empty if all is."""


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
