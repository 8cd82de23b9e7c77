"""One revolution as the rest of the robot wants it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from drivers.tim571.codec.scandata import Channel, ScanData
from drivers.tim571.geometry import SCAN_RATE_HZ, beam_lags_s, beam_yaw, sweep_s

FIRST_RANGE_CODE = 16
"""Smaller samples are codes, not millimetres: 0 no echo, 1 dazzled, 2 invalid (fact sheet section 4)."""


class Beam(Enum):
    """A beam of the revolution that a time belongs to."""

    FIRST = "first"
    """At -45 degrees of device angle, the right-hand rear."""
    LAST = "last"
    """At 225 degrees, the left-hand rear, 50 ms later."""


class DeviceStatus(Enum):
    """The status word of a scan telegram (fact sheet section 4; pollution is from sister devices' manuals)."""

    OK = 0
    ERROR = 1
    POLLUTION_WARNING = 2
    POLLUTION_ERROR = 5
    UNKNOWN = -1

    @classmethod
    def _missing_(cls, value: object) -> DeviceStatus:
        return cls.UNKNOWN

    def __str__(self) -> str:
        return _STATUS_WORDS[self]


_STATUS_WORDS = {
    DeviceStatus.OK: "well",
    DeviceStatus.ERROR: "error: do not trust its ranges; power-cycle it, and have it serviced if that doesn't help",
    DeviceStatus.POLLUTION_WARNING: "its hood is getting dirty: clean it with a soft damp cloth",
    DeviceStatus.POLLUTION_ERROR: "its hood is dirty and its ranges are not to be trusted: clean it now",
    DeviceStatus.UNKNOWN: "a status that no manual lists",
}


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One revolution; `stamp_ns` is its last beam on this machine's monotonic clock, unless configured otherwise."""

    stamp_ns: int
    ranges: NDArray[np.float32]
    """(n,) metres, NaN where the device saw nothing usable."""
    yaw: NDArray[np.float32]
    """(n,) radians, counter-clockwise, zero straight ahead; increasing, 1/3 degree apart."""
    codes: NDArray[np.unsignedinteger]
    """(n,) samples as on the wire; below 16 they say why there is no range."""
    rssi: NDArray[np.float32] | None
    """(n,) signal strength in the device's digits, or None if it doesn't send them."""
    scan_counter: int
    telegram_counter: int
    device_time_us: int
    """Time since start-up, about the last beam; wraps at 2**32."""
    transmit_time_us: int
    """Time since start-up at transmission; wraps at 2**32."""
    device_ok: bool
    arrival_ns: int
    """Arrival of the telegram's first byte."""
    frame: bytes
    """The telegram exactly as received."""
    offsets_s: NDArray[np.float32]
    """(n,) seconds from the stamp to each beam: all zero or negative if the stamp is the last beam's."""
    status: DeviceStatus = DeviceStatus.OK
    lost: int = 0
    """Revolutions missed between the scan before and this one."""
    clock_locked: bool = False
    """Whether the stamp comes from a fit to seconds of arrivals, good to 0.2 ms; if not, from few or from this one."""


def has_ranges(data: ScanData) -> bool:
    """Whether the telegram holds distances: one polled before the first revolution has none."""
    distance = data.channel("DIST1")
    return distance is not None and len(distance.samples) > 0


def scan_of(
    data: ScanData,
    tick_ns: int,
    arrival_ns: int,
    frame: bytes,
    *,
    locked: bool = False,
    lost: int = 0,
    tick_marks: Beam = Beam.LAST,
    stamp_marks: Beam = Beam.LAST,
) -> Scan:
    """The scan in a telegram that `has_ranges`, `tick_ns` being our time of its scan tick.

    `tick_marks` is the beam at which the device takes its tick, `stamp_marks` the one that the stamp shall mean.
    """
    distance = data.channel("DIST1")
    if distance is None:
        raise ValueError("the telegram has no distances")
    rssi = data.channel("RSSI1")
    metres = _physical(distance) * np.float32(1e-3)
    # No scale that a device sends makes a range negative or endless; damage might.
    metres[(distance.samples < FIRST_RANGE_CODE) | ~(metres > 0) | np.isinf(metres)] = np.nan
    beams = (distance.start_1e4deg, distance.step_1e4deg, len(distance.samples))
    rate_hz = data.scan_frequency_chz / 100 or SCAN_RATE_HZ
    sweep_ns = round(1e9 * sweep_s(rate_hz))
    last_ns = tick_ns + (sweep_ns if tick_marks is Beam.FIRST else 0)
    lags_s = beam_lags_s(*beams, rate_hz)
    low, high = data.status
    return Scan(
        stamp_ns=last_ns if stamp_marks is Beam.LAST else last_ns - sweep_ns,
        ranges=metres,
        yaw=beam_yaw(*beams),
        codes=distance.samples,
        rssi=_physical(rssi) if rssi is not None and len(rssi.samples) == len(metres) else None,
        scan_counter=data.scan_counter,
        telegram_counter=data.telegram_counter,
        device_time_us=data.scan_tick_us,
        transmit_time_us=data.transmit_tick_us,
        device_ok=data.status == (0, 0),
        arrival_ns=arrival_ns,
        frame=frame,
        offsets_s=lags_s if stamp_marks is Beam.LAST else lags_s + np.float32(sweep_s(rate_hz)),
        status=DeviceStatus(low | high << 8),
        lost=lost,
        clock_locked=locked,
    )


def _physical(channel: Channel) -> NDArray[np.float32]:
    """`samples * scale + offset`, hostile scales giving inf or NaN rather than a warning."""
    with np.errstate(all="ignore"):
        return channel.samples.astype(np.float32) * np.float32(channel.scale) + np.float32(channel.offset)
