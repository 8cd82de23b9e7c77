"""What `ghal360 probe tim571` asks a lidar and says about it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.tim571.device.config import TimConfig
from drivers.tim571.device.probe import probe
from drivers.tim571.transport.tcp import TcpTransport
from drivers.tim571.transport.usb import UsbTransport
from ghal360_robot.errors import UsageError
from ghal360_robot.hardware.lidar import CONTENTS, DIALECTS, SWITCHES, TRY_FIRST

if TYPE_CHECKING:
    from drivers.tim571.device.probe import ProbeReport
    from drivers.tim571.transport import Transport

VARIABLES = ("DItype", "DIornr", "LMPscancfg", "EIHstCola", "EIIpAddr", "EImask", "EIgate")
"""Asked besides the identity; a device that does not know one says so."""


@dataclass(frozen=True, slots=True)
class Way:
    """How to reach the lidar and what to change in it, as given on the command line."""

    host: str
    port: int
    usb: bool
    serial: str | None
    dialect: str
    rssi: str
    switch: str

    def transport(self) -> Transport:
        return UsbTransport(self.serial) if self.usb or self.serial else TcpTransport(self.host, self.port)

    def config(self) -> TimConfig:
        """Raises UsageError."""
        for option, value, known in (
            ("dialect", self.dialect, DIALECTS),
            ("rssi", self.rssi, CONTENTS),
            ("switch", self.switch, SWITCHES),
        ):
            if value not in known:
                raise UsageError(f"--{option} is one of {', '.join(known)}, not '{value}'")
        return TimConfig(
            dialect=DIALECTS[self.dialect],
            dialects=TRY_FIRST["usb" if self.usb or self.serial else "tcp"],
            output=CONTENTS[self.rssi],
            switch_to=SWITCHES[self.switch],
        )


async def probe_lidar(way: Way, seconds: float) -> dict[str, Any]:
    """All that the lidar told, by the names of the report."""
    return told(await probe(way.transport(), way.config(), seconds, asked=VARIABLES))


def told(found: ProbeReport) -> dict[str, Any]:
    """The report: plain values, and sentences where a number would not be understood."""
    stats, scan, identity, variables = found.stats, found.scan, found.stats.identity, found.variables
    assert identity is not None  # noqa: S101 - scans come only from a device that was identified
    seen = np.isfinite(scan.ranges)
    nearest = int(np.nanargmin(scan.ranges)) if seen.any() else None
    network = [str(variables[name]) for name in ("EIIpAddr", "EImask", "EIgate") if variables[name] is not None]
    config = variables["LMPscancfg"]
    return {
        "type": identity.type,
        "version": identity.version,
        "type_code": variables["DItype"],
        "order_number": variables["DIornr"],
        "firmware": identity.firmware,
        "serial": identity.serial,
        "name": identity.name,
        "dialect": identity.dialect.value,
        "network": " ".join(network) or None,
        "state": identity.state.name.lower(),
        "state_means": str(identity.state),
        "operating_hours": None if identity.operating_hours is None else round(identity.operating_hours, 1),
        "power_ons": identity.power_ons,
        "output": None if identity.output is None else str(identity.output),
        "output_range": None if identity.output_range is None else str(identity.output_range),
        "scan_config": None if config is None else str(config),
        "rssi": scan.rssi is not None,
        "beams": len(scan.ranges),
        "beams_with_range": int(seen.sum()),
        "nearest_m": None if nearest is None else round(float(scan.ranges[nearest]), 3),
        "nearest_yaw_deg": None if nearest is None else round(math.degrees(float(scan.yaw[nearest])), 1),
        "device_ok": scan.device_ok,
        "status": str(scan.status),
        "received": stats.received,
        "lost": stats.lost,
        "repeated": stats.repeated,
        "damaged": stats.damaged,
        "implausible": stats.implausible,
        "doubts": list(stats.doubts),
        "rate_hz": round(stats.rate_hz, 3),
        "clock": _clock(found),
        "clock_locked": stats.clock.locked,
        "drift_ppm": round(stats.clock.drift_ppm, 1),
        "jitter_us": round(stats.clock.spread_us),
        "transmit_delay_ms": round((scan.transmit_time_us - scan.device_time_us) % (1 << 32) / 1000, 1),
        "warning": stats.warning or None,
    }


def _clock(found: ProbeReport) -> str:
    clock = found.stats.clock
    if not clock.locked:
        return "not steady: stamps come from arrivals"
    return f"{abs(clock.drift_ppm):.1f} ppm {'faster' if clock.drift_ppm > 0 else 'slower'} than this machine's"
