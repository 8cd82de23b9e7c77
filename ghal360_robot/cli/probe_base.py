"""What `ghal360 probe rmp110` asks a base and says about it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.faults import dynamic_response_texts
from drivers.rmp110.codec.parameters import BY_NAME, Kind, OperationalState
from drivers.rmp110.codec.vocabulary import B3
from drivers.rmp110.codec.whitelist import guard
from drivers.rmp110.device.config import DIALECTS, Rmp110Config
from drivers.rmp110.device.rmp110 import Rmp110
from drivers.rmp110.device.state import LinkState
from drivers.rmp110.errors import RmpRefused, RmpWrongMode
from drivers.rmp110.transport.can_bus import CanTransport
from drivers.rmp110.transport.datagram import DatagramTransport
from drivers.rmp110.transport.serial_port import SerialTransport
from ghal360_robot.cli.address import split_address
from ghal360_robot.errors import GhalError, UsageError

if TYPE_CHECKING:
    from drivers.rmp110.codec.fault_log import FaultLog
    from drivers.rmp110.device.state import Identity, State
    from drivers.rmp110.transport.base import Transport

READY_S = 8.0
"""A base that is on answers within a tenth of a second; identification takes two, a fault log another."""
LOG_ENTRIES = 5
"""The newest ones say what happened; the log keeps twenty."""
NOT_TOLD = "not told by this feedback set; --fault-log reads it"
LATERAL_ACCEL = B3.parameter("lateral_accel")
"""Stored by B3 and V3 only."""
STANDING = (OperationalState.STANDBY, OperationalState.TRACTOR)


@dataclass(frozen=True, slots=True)
class Way:
    """How to reach the base, as given on the command line."""

    protocol: str
    interface: str
    channel: str
    address: str | None
    dialect: str
    host: str | None
    port: int
    device: str

    def transport(self) -> Callable[[], Transport]:
        """What makes connections. Raises UsageError."""
        if self.protocol not in WAYS:
            raise UsageError(f"--protocol is one of {', '.join(WAYS)}, not '{self.protocol}'")
        return WAYS[self.protocol](self)

    def config(self, *, fault_log: bool) -> Rmp110Config:
        """Settings that write nothing: a probe leaves the base's stored feedback set as it is."""
        if self.dialect not in DIALECTS:
            raise UsageError(f"--dialect is one of {', '.join(DIALECTS)}, not '{self.dialect}'")
        family = "can" if self.protocol == "can" else "v3"
        return Rmp110Config(
            write_feedback_set=False,
            observe_only=True,
            protocol=family,
            dialect=self.dialect,
            read_fault_log=fault_log,
        )


def _can(way: Way) -> Callable[[], Transport]:
    interface, options = way.interface, dict[str, Any]()
    if way.dialect == "b1":
        options["guard"] = guard(Dialect.B1)
    if way.address is not None:
        interface = "socketcand"
        options["host"], options["port"] = split_address(way.address)
    elif interface == "socketcand":
        raise UsageError("--interface socketcand needs --address HOST:PORT of its server")
    return lambda: CanTransport(interface, way.channel, **options)


def _udp(way: Way) -> Callable[[], Transport]:
    host = way.host
    if not host:
        raise UsageError("--protocol v3-udp needs --host with the base's address; they leave the works as 10.66.171.5")
    return lambda: DatagramTransport(host, way.port)


def _usb(way: Way) -> Callable[[], Transport]:
    return lambda: SerialTransport(way.device)


WAYS: dict[str, Callable[[Way], Callable[[], Transport]]] = {"can": _can, "v3-udp": _udp, "v3-usb": _usb}


async def probe_base(way: Way, seconds: float, *, fault_log: bool) -> dict[str, Any]:
    """Identify the base and listen for a while. Raises UsageError, GhalError, RmpError."""
    async with Rmp110(way.transport(), way.config(fault_log=fault_log)) as base:
        identity = await base.ready(READY_S)
        await asyncio.sleep(seconds)
        stats, state, refusal = base.stats, base.latest, base.refusal()
        if stats.link is not LinkState.STREAMING or state is None:
            raise GhalError(f"the base was there and is gone: {stats.detail}")
    found = {
        **_identity(identity),
        **_state(state),
        "motion_refused_because": refused_because(refusal, state),
        "received": stats.received,
        "lost": stats.lost,
        "damaged": stats.damaged,
        "rate_hz": round(stats.rate_hz, 2),
    }
    if fault_log:
        log = identity.fault_log
        found["fault_log"] = ["it did not come whole"] if log is None else log_lines(log)
    return found


def in_words(found: dict[str, Any]) -> dict[str, Any]:
    """The same for the person at the robot: stored parameters with units and against what is expected."""
    different = found["differences"]
    stored = {name: _stored(name, value, different.get(name)) for name, value in found["stored"].items()}
    refused = found["motion_refused_because"] or "it would not be, once tractor mode is requested"
    said = {key: value for key, value in found.items() if key != "differences"}
    return said | {"stored": stored, "motion_refused_because": refused}


def _stored(name: str, value: float, different: list[float] | None) -> str:
    parameter = BY_NAME.get(name, LATERAL_ACCEL)
    text = FORMATS[parameter.kind](value)
    expected = f", expected {FORMATS[parameter.kind](different[1])}" if different else ""
    return f"{text} {parameter.unit}".rstrip() + expected


def _dotted(value: float) -> str:
    """The byte order that the vendor's own tool puts on the wire (fact sheet 4.5)."""
    return ".".join(str(byte) for byte in int(value).to_bytes(4, "little"))


FORMATS: dict[Kind, Callable[[float], str]] = {
    Kind.FLOAT: "{:g}".format,
    Kind.UINT: "{:.0f}".format,
    Kind.HEX: lambda value: f"0x{int(value):08X}",
    Kind.IP: _dotted,
}


def refused_because(refusal: RmpRefused | None, state: State) -> str | None:
    """Why motion would be refused even if it was asked for; None where the base could be armed."""
    if refusal is None or (isinstance(refusal, RmpWrongMode) and state.mode in STANDING):
        return None
    return str(refusal)


def log_lines(log: FaultLog) -> list[str]:
    """The header and the newest entries of a fault log, in words."""
    life = f"{log.power_cycles} power cycles, {log.accumulated_s / 3600:.1f} h, {log.odometer_m} m"
    lines = [f"{log.entry_count} entries; {life}; serial 0x{log.serial:X}"]
    for entry in log.entries[:LOG_ENTRIES]:
        what = "; ".join(entry.texts) or "no fault bits"
        when = f"{entry.when:%Y-%m-%d %H:%M:%S %Z}"
        lines.append(f"{when}, power cycle {entry.power_cycle}, {entry.run_time_s} s after power-on: {what}")
    return lines


def _identity(identity: Identity) -> dict[str, Any]:
    stored = identity.stored
    return {
        "dialect": identity.dialect.name,
        "firmware": identity.firmware or NOT_TOLD,
        "stored": {parameter.name: round(float(stored[parameter.name]), 6) for parameter in stored.parameters},
        "differences": {name: list(pair) for name, pair in identity.differences.items()},
    }


def _state(state: State) -> dict[str, Any]:
    return {
        "mode": state.mode.name,
        "battery_percent": round(state.battery_percent, 2),
        "batteries": {pack.name: _pack(pack.percent, pack.temperature_degc) for pack in state.batteries},
        "temperature_degc": state.temperature_degc,
        "faults": list(state.faults),
        "warnings": list(state.warnings),
        "dynamic_response": state.dynamic_response,
        "acts_by_itself": list(dynamic_response_texts(state.dynamic_response)),
        "v_mps": round(state.v, 4),
        "w_radps": round(state.w, 4),
    }


def _pack(percent: float | None, temperature_degc: float | None) -> str:
    parts = (
        f"{percent:.1f} %" if percent is not None else "",
        f"{temperature_degc:.1f} degC" if temperature_degc is not None else "",
    )
    return ", ".join(part for part in parts if part) or "says nothing"
