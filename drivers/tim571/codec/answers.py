"""What the values of an answer mean, as types instead of tuples (fact sheet section 3)."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from enum import Enum
from ipaddress import IPv4Address
from typing import Any, NamedTuple

from drivers.tim571.codec import commands
from drivers.tim571.codec.commands import OutputContent, OutputRange
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.faults import Fault, meaning, named
from drivers.tim571.codec.telegram import FAULT, Telegram

_DECIHOUR = timedelta(minutes=6)


class DeviceState(Enum):
    """`SCdevicestate`, and UNKNOWN for what it doesn't list."""

    BUSY = 0
    READY = 1
    ERROR = 2
    STANDBY = 3
    UNKNOWN = -1

    @classmethod
    def _missing_(cls, value: object) -> DeviceState:
        return cls.UNKNOWN

    def __str__(self) -> str:
        return _STATES[self]


_STATES = {
    DeviceState.BUSY: "busy: starting up, or somebody is logged in, which switches the laser off",
    DeviceState.READY: "ready",
    DeviceState.ERROR: "error: power-cycle it, and have it serviced if that does not help",
    DeviceState.STANDBY: "standby: the motor is off; log in and call Run",
    DeviceState.UNKNOWN: "unknown",
}


class DeviceIdent(NamedTuple):
    """`DeviceIdent`, also under the index 0."""

    type: str
    version: str


class ScanConfig(NamedTuple):
    """`LMPscancfg`; a TiM571 has one only."""

    rate_hz: float
    sectors: int
    sector: OutputRange

    def __str__(self) -> str:
        return f"{self.rate_hz:g} Hz, {self.sector}"


class Refusal(NamedTuple):
    """`sFA`."""

    code: Fault | int
    words: str


class Digits(bytes):
    """An answer whose layout depends on the device: as it came."""

    __slots__ = ()

    def __str__(self) -> str:
        return self.hex(" ")


def _address(*octets: int) -> IPv4Address:
    return IPv4Address(bytes(octets))


def _scan_config(rate_chz: int, sectors: int, step: int, start: int, stop: int) -> ScanConfig:
    return ScanConfig(rate_chz / 100, sectors, OutputRange(start, stop, step))


def _dialect(binary: int) -> Dialect:
    return Dialect.B if binary else Dialect.A


_VARIABLES: dict[str, Callable[..., Any]] = {
    "0": DeviceIdent,
    "DeviceIdent": DeviceIdent,
    "SCdevicestate": DeviceState,
    "ODoprh": lambda decihours: decihours * _DECIHOUR,
    "EIHstCola": _dialect,
    "LMDscandatacfg": lambda *values: OutputContent.from_values(values),
    "LMPoutputRange": lambda *values: OutputRange.from_values(values),
    "LMPscancfg": _scan_config,
    "EIIpAddr": _address,
    "EImask": _address,
    "EIgate": _address,
    "TSCTCSrvAddr": _address,
    "TSCTCtimezone": lambda shifted: timedelta(hours=shifted - 12),
    "LFPparticle": lambda on, threshold: threshold if on else None,
    "LFPmeanfilter": lambda on, scans, _reserved: scans if on else None,
    "LIDoutputstate": Digits,
    "LIDinputstate": Digits,
    "LFErec": Digits,
}
_SUCCESS_IS_ZERO = {"LMCstartmeas", "LMCstopmeas", "LMCstandby"}
"""Methods that return an error code; the others return 1 for done."""


def understand(telegram: Telegram) -> Any:
    """An answer's meaning: a variable's typed value, whether a method succeeded, whether an event is on, a Refusal.

    A written variable gives None, a method that returns nothing True. Raises TimMalformedError as `values_of`.
    """
    values = commands.values_of(telegram)
    match telegram.kind:
        case "sRA" | "sSN":
            read: Callable[..., Any] = _VARIABLES.get(telegram.name, _only)
            return read(*values)
        case "sAN":
            return values[0] == (0 if telegram.name in _SUCCESS_IS_ZERO else 1) if values else True
        case "sEA":
            return bool(values[0])
        case _ if telegram.kind == FAULT:
            return Refusal(named(values[0]), meaning(values[0]))
    return None


def _only(value: Any) -> Any:
    return value
