"""The commands of a TiM571 that a start-up and a probe need, as tables of names and layouts.

Names and layouts: fact sheet section 3. Layout letters: `fields`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drivers.tim571.codec import fields
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.faults import Fault
from drivers.tim571.codec.telegram import FAULT, Telegram
from drivers.tim571.errors import TimMalformedError


@dataclass(frozen=True, slots=True)
class Method:
    """A method's parameters and what it returns."""

    request: str
    answer: str


VARIABLES = {
    "0": "SS",  # by index: the same as DeviceIdent
    "DeviceIdent": "SS",
    "DItype": "S",
    "DIornr": "S",
    "FirmwareVersion": "S",
    "SerialNumber": "S",
    "SCdevicestate": "B",
    "ODoprh": "I",
    "ODpwrc": "I",
    "LocationName": "S",
    "EIHstCola": "B",
    "LMDscandatacfg": "BBBBBBBBBBBH",
    "LMPoutputRange": "HIii",
    "LMPscancfg": "IhIii",
}
METHODS = {
    "SetAccessMode": Method("BI", "B"),
    "Run": Method("", "B"),
    "LMCstartmeas": Method("", "B"),
    "LMCstopmeas": Method("", "B"),
    "mEEwriteall": Method("", "B"),
    "mSCreboot": Method("", ""),
}
EVENTS = ("LMDscandata", "LMDscandatamon")


@dataclass(frozen=True, slots=True)
class OutputContent:
    """`LMDscandatacfg`: what a scan telegram contains. `channels` is 1 for DIST1."""

    rssi: bool = False
    rssi_bits: int = 8
    """8 or 16."""
    name: bool = True
    every: int = 1
    """Every n-th scan is sent."""
    channels: int = 1
    unit: int = 0
    encoder: int = 0
    position: bool = False
    comment: bool = False
    time: bool = False
    """A TiM5xx stores it; none was seen to send the time block."""

    def to_values(self) -> tuple[int, ...]:
        """The parameters in wire order; two-byte fields go low byte first."""
        return (
            self.channels & 0xFF,
            self.channels >> 8,
            int(self.rssi),
            int(self.rssi_bits == 16),
            self.unit,
            self.encoder & 0xFF,
            self.encoder >> 8,
            int(self.position),
            int(self.name),
            int(self.comment),
            int(self.time),
            self.every,
        )

    @classmethod
    def from_values(cls, values: tuple[int, ...]) -> OutputContent:
        """From the parameters in wire order."""
        low, high, rssi, wide, unit, encoder_low, encoder_high, position, name, comment, time, every = values
        return cls(
            rssi=bool(rssi),
            rssi_bits=16 if wide else 8,
            name=bool(name),
            every=every,
            channels=low | high << 8,
            unit=unit,
            encoder=encoder_low | encoder_high << 8,
            position=bool(position),
            comment=bool(comment),
            time=bool(time),
        )


def read(dialect: Dialect, name: str) -> Telegram:
    """Request: read a variable by name, or by index if `name` is a number."""
    return Telegram(dialect, "sRI" if name.isdigit() else "sRN", name, b"")


def write(dialect: Dialect, name: str, *values: Any) -> Telegram:
    """Request: write a variable."""
    return Telegram(dialect, "sWN", name, fields.pack(dialect, VARIABLES[name], *values))


def invoke(dialect: Dialect, name: str, *values: Any) -> Telegram:
    """Request: call a method."""
    return Telegram(dialect, "sMN", name, fields.pack(dialect, METHODS[name].request, *values))


def subscribe(dialect: Dialect, name: str, on: bool = True) -> Telegram:
    """Request: switch an event stream on or off."""
    return Telegram(dialect, "sEN", name, fields.pack(dialect, "B", int(on)))


def value_answer(dialect: Dialect, name: str, *values: Any) -> Telegram:
    """Answer: a variable's value."""
    return Telegram(dialect, "sRA", name, fields.pack(dialect, VARIABLES[name], *values))


def written_answer(dialect: Dialect, name: str) -> Telegram:
    """Answer: a variable was written."""
    return Telegram(dialect, "sWA", name, b"")


def method_answer(dialect: Dialect, name: str, *values: Any) -> Telegram:
    """Answer: what a method returned."""
    return Telegram(dialect, "sAN", name, fields.pack(dialect, METHODS[name].answer, *values))


def event_answer(dialect: Dialect, name: str, on: int) -> Telegram:
    """Answer: an event stream was switched."""
    return Telegram(dialect, "sEA", name, fields.pack(dialect, "B", on))


def fault(dialect: Dialect, code: int) -> Telegram:
    """Answer: `sFA` with its code."""
    return Telegram(dialect, FAULT, "", fields.pack(dialect, "B" if dialect is Dialect.A else "H", code))


def values_of(telegram: Telegram) -> tuple[Any, ...]:
    """The parameters of a request or an answer of these tables.

    Raises TimMalformedError if they do not fit, or the telegram is not in the tables; its `fault` is what a
    device answers such a request with.
    """
    return fields.unpack(telegram.dialect, telegram.body, _layout(telegram.kind, telegram.name))


def _layout(kind: str, name: str) -> str:
    match kind:
        case "sRN" | "sRI" | "sWA" if name in VARIABLES:
            return ""
        case "sRA" | "sWN" if name in VARIABLES:
            return VARIABLES[name]
        case "sMN" if name in METHODS:
            return METHODS[name].request
        case "sAN" if name in METHODS:
            return METHODS[name].answer
        case "sEN" | "sEA" if name in EVENTS:
            return "B"
        case "sFA":
            return "H"
    raise TimMalformedError(f"{kind} {name} is not in the tables", _UNKNOWN.get(kind, Fault.UNKNOWN_COMMAND))


_UNKNOWN = {
    "sRN": Fault.UNKNOWN_VARIABLE,
    "sRI": Fault.UNKNOWN_VARIABLE,
    "sWN": Fault.UNKNOWN_VARIABLE,
    "sMN": Fault.UNKNOWN_METHOD,
    "sEN": Fault.UNKNOWN_EVENT,
}
