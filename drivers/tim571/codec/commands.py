"""The commands of a TiM571 and its sisters, as tables of names and layouts; requests and answers built from them.

Names and layouts: fact sheet section 3. Layout letters: `fields`. What the values of an answer mean: `answers`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, NamedTuple

from drivers.tim571.codec import fields
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.faults import Fault
from drivers.tim571.codec.telegram import FAULT, Telegram
from drivers.tim571.errors import TimMalformedError
from drivers.tim571.geometry import FIRST_ANGLE_1E4DEG, LAST_ANGLE_1E4DEG, WIRE_STEP_1E4DEG


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
    "EIIpAddr": "BBBB",
    "EImask": "BBBB",
    "EIgate": "BBBB",
    "LFPparticle": "BH",
    "LFPmeanfilter": "BHB",
    "TSCRole": "B",
    "TSCTCInterface": "B",
    "TSCTCSrvAddr": "BBBB",
    "TSCTCupdatetime": "I",
    "TSCTCtimezone": "B",  # hours + 12
    "LIDoutputstate": "R",
    "LIDinputstate": "R",
    "LFErec": "R",
}
METHODS = {
    "SetAccessMode": Method("BI", "B"),
    "Run": Method("", "B"),
    "LMCstartmeas": Method("", "B"),
    "LMCstopmeas": Method("", "B"),
    "LMCstandby": Method("", "B"),
    "LSPsetdatetime": Method("HBBBBBI", "B"),
    "mEEwriteall": Method("", "B"),
    "mSCreboot": Method("", ""),
    "mSCloadfacdef": Method("", ""),
    "mSCloadappdef": Method("", ""),
}
EVENTS = ("LMDscandata", "LMDscandatamon", "LIDoutputstate", "LIDinputstate", "LFErec")


class OutputRange(NamedTuple):
    """`LMPoutputRange`: which part of the revolution is sent, in 1/10000 degree of device angle."""

    start_1e4deg: int = FIRST_ANGLE_1E4DEG
    stop_1e4deg: int = LAST_ANGLE_1E4DEG
    step_1e4deg: int = WIRE_STEP_1E4DEG

    def to_values(self) -> tuple[int, ...]:
        """The parameters in wire order."""
        return 1, self.step_1e4deg, self.start_1e4deg, self.stop_1e4deg

    @classmethod
    def from_values(cls, values: tuple[int, ...]) -> OutputRange:
        """From the parameters in wire order."""
        _sectors, step, start, stop = values
        return cls(start, stop, step)

    @classmethod
    def from_yaw(cls, right_deg: float, left_deg: float) -> OutputRange:
        """From where to where, in degrees counter-clockwise from straight ahead: -135 to 135 is everything."""
        if not -135 <= right_deg < left_deg <= 135:
            raise ValueError(f"{right_deg:g} to {left_deg:g} degrees: a TiM571 sees from -135 to 135, right to left")
        return cls(round((right_deg + 90) * 10_000), round((left_deg + 90) * 10_000))

    def __str__(self) -> str:
        right, left = self.start_1e4deg / 10_000 - 90, self.stop_1e4deg / 10_000 - 90
        return f"{right:g} to {left:g} degrees, a beam every {self.step_1e4deg / 10_000:.3g}"


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

    def __str__(self) -> str:
        wanted = {
            f"{self.rssi_bits}-bit signal strength": self.rssi,
            "position": self.position,
            "name": self.name,
            "comment": self.comment,
            "time": self.time,
        }
        which = "every scan" if self.every == 1 else f"one scan in {self.every}"
        return ", ".join(["distances", *(words for words, on in wanted.items() if on), which])

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
    if telegram.kind == "sWA":
        return ()  # it is the acknowledgement that counts; sisters and emulators append something to it
    return fields.unpack(telegram.dialect, telegram.body, _layout(telegram.kind, telegram.name))


def _layout(kind: str, name: str) -> str:
    variable = VARIABLES.get(name, "R" if _FIELD.fullmatch(name) else None)
    if variable is not None:
        match kind:
            case "sRN" | "sRI":
                return ""
            case "sRA" | "sWN" | "sSN":
                return variable
    match kind:
        case "sMN" if name in METHODS:
            return METHODS[name].request
        case "sAN" if name in METHODS:
            return METHODS[name].answer
        case "sEN" | "sEA" if name in EVENTS:
            return "B"
        case "sFA":
            return "H"
    raise TimMalformedError(f"{kind} {name} is not in the tables", _UNKNOWN.get(kind, Fault.UNKNOWN_COMMAND))


_FIELD = re.compile(r"field\d{3}")  # a TiM7xx's protective fields, 48 of them
_UNKNOWN = {
    "sRN": Fault.UNKNOWN_VARIABLE,
    "sRI": Fault.UNKNOWN_VARIABLE,
    "sWN": Fault.UNKNOWN_VARIABLE,
    "sMN": Fault.UNKNOWN_METHOD,
    "sEN": Fault.UNKNOWN_EVENT,
}
