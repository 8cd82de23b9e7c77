"""One revolution as the rest of the robot wants it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.tim571.codec.scandata import Channel, ScanData
from drivers.tim571.geometry import beam_yaw

FIRST_RANGE_CODE = 16
"""Smaller samples are codes, not millimetres: 0 no echo, 1 dazzled, 2 invalid (fact sheet section 4)."""


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One revolution; `stamp_ns` is the last beam on this machine's monotonic clock."""

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


def has_ranges(data: ScanData) -> bool:
    """Whether the telegram holds distances: one polled before the first revolution has none."""
    distance = data.channel("DIST1")
    return distance is not None and len(distance.samples) > 0


def scan_of(data: ScanData, stamp_ns: int, arrival_ns: int, frame: bytes) -> Scan:
    """The scan in a telegram that `has_ranges`."""
    distance = data.channel("DIST1")
    if distance is None:
        raise ValueError("the telegram has no distances")
    rssi = data.channel("RSSI1")
    metres = _physical(distance) * np.float32(1e-3)
    # No scale that a device sends makes a range negative or endless; damage might.
    metres[(distance.samples < FIRST_RANGE_CODE) | ~(metres > 0) | np.isinf(metres)] = np.nan
    return Scan(
        stamp_ns=stamp_ns,
        ranges=metres,
        yaw=beam_yaw(distance.start_1e4deg, distance.step_1e4deg, len(distance.samples)),
        codes=distance.samples,
        rssi=_physical(rssi) if rssi is not None and len(rssi.samples) == len(metres) else None,
        scan_counter=data.scan_counter,
        telegram_counter=data.telegram_counter,
        device_time_us=data.scan_tick_us,
        transmit_time_us=data.transmit_tick_us,
        device_ok=data.status == (0, 0),
        arrival_ns=arrival_ns,
        frame=frame,
    )


def _physical(channel: Channel) -> NDArray[np.float32]:
    """`samples * scale + offset`, hostile scales giving inf or NaN rather than a warning."""
    with np.errstate(all="ignore"):
        return channel.samples.astype(np.float32) * np.float32(channel.scale) + np.float32(channel.offset)
