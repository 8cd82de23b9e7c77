"""What the device answers and when it refuses (fact sheet section 3), without any I/O.

It knows what a TiM5xx knows: protective fields, inputs, outputs and network time belong to its sisters.

Not documented and decided here: a connection that closes is logged out; a change of dialect holds for the
connection that asked and for later ones; settings not saved by `mEEwriteall` are lost at power-off.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from drivers.tim571.codec import commands
from drivers.tim571.codec.access import PASSWORDS, Level, password_hash
from drivers.tim571.codec.commands import OutputContent, OutputRange
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.faults import Fault
from drivers.tim571.codec.telegram import Telegram
from drivers.tim571.errors import TimMalformedError
from drivers.tim571.geometry import FIRST_ANGLE_1E4DEG, LAST_ANGLE_1E4DEG, WIRE_STEP_1E4DEG

SPIN_UP_S = 0.2  # from Run to the first scan; 223 ms on a real TiM5xx
LONGEST_NAME = 16
MOST_EVERY = 50_000
DELIVERED_NETWORK = {"EIIpAddr": (192, 168, 0, 1), "EImask": (255, 255, 255, 0), "EIgate": (0, 0, 0, 0)}
"""Takes effect after saving and a reboot, which a simulator on a socket of its own can only remember."""
_BUSY, _READY, _ERROR = 0, 1, 2
_VARIABLES = frozenset(commands.VARIABLES) - {
    "LFErec", "LFPparticle", "LFPmeanfilter", "LIDinputstate", "LIDoutputstate",
    "TSCRole", "TSCTCInterface", "TSCTCSrvAddr", "TSCTCtimezone", "TSCTCupdatetime",
}  # fmt: skip
_METHODS = frozenset(commands.METHODS) - {"LMCstandby", "LSPsetdatetime"}
_EVENTS = frozenset(("LMDscandata", "LMDscandatamon"))
_KNOWN = {
    "sRN": (_VARIABLES, Fault.UNKNOWN_VARIABLE),
    "sRI": (_VARIABLES, Fault.UNKNOWN_VARIABLE),
    "sWN": (_VARIABLES, Fault.UNKNOWN_VARIABLE),
    "sMN": (_METHODS, Fault.UNKNOWN_METHOD),
    "sEN": (_EVENTS, Fault.UNKNOWN_EVENT),
}
_METHOD_LEVELS = {
    "LMCstartmeas": Level.AUTHORISED_CLIENT,
    "LMCstopmeas": Level.AUTHORISED_CLIENT,
    "mEEwriteall": Level.AUTHORISED_CLIENT,
    "mSCreboot": Level.AUTHORISED_CLIENT,
    "mSCloadfacdef": Level.AUTHORISED_CLIENT,
    "mSCloadappdef": Level.AUTHORISED_CLIENT,
}
_WRITE_LEVELS = {
    "EIHstCola": Level.AUTHORISED_CLIENT,
    "LMDscandatacfg": Level.AUTHORISED_CLIENT,
    "LMPoutputRange": Level.AUTHORISED_CLIENT,
    "LocationName": Level.MAINTENANCE,
    "EIIpAddr": Level.AUTHORISED_CLIENT,
    "EImask": Level.AUTHORISED_CLIENT,
    "EIgate": Level.AUTHORISED_CLIENT,
}


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """Who the simulated device is; the defaults are those of a real TiM5xx's start-up log."""

    type: str = "TiM57x"
    version: str = "V2.60-12.05.20"
    type_code: str = "TiM571-2050101"
    order_number: str = "1075091"
    firmware: str = "V2.60"
    serial: int = 17461662
    name: str = "not defined"
    operating_decihours: int = 0x68C
    power_ons: int = 0x79
    startup_s: float = 0.0
    """Silence after power-on; a real device needs up to 30 s."""
    scan_rate_hz: float = 15.0
    tick_at_power_on_us: int = 0
    """Near 2**32 the wrap comes soon."""
    user_levels_enabled: bool = True
    """From V5.10 on an owner can forbid every login."""
    drift_ppm: float = 0.0
    """How much faster than this machine's the device's clock runs; 4.7 on a real one."""
    time_block: bool = False
    """Send the time block where it is configured; a TiM5xx takes the setting and was never seen to send it."""


@dataclass(slots=True)
class Client:
    """One connection, as the device sees it."""

    dialect: Dialect
    level: Level = Level.RUN
    events: set[str] = field(default_factory=set)
    """Names of the event streams that are switched on."""


@dataclass(slots=True)
class _Stored:
    """What survives power-off once saved."""

    dialect: Dialect
    output: OutputContent = field(default_factory=OutputContent)
    sector: OutputRange = field(default_factory=OutputRange)
    name: str = "not defined"
    network: dict[str, tuple[int, ...]] = field(default_factory=lambda: dict(DELIVERED_NETWORK))


class Behaviour:
    """The device's variables and methods. Times are seconds of any steady clock."""

    def __init__(self, settings: DeviceSettings, dialect: Dialect, fixed_dialect: bool = False) -> None:
        self.settings = settings
        self.failed = False
        """Set for a device that reports an error."""
        self._fixed_dialect = fixed_dialect
        self._saved = _Stored(dialect, name=settings.name)
        self.power_on(0.0)

    def power_on(self, now_s: float) -> None:
        """Begin anew with what was saved."""
        saved = self._saved
        self.dialect, self.output, self.sector, self.name = saved.dialect, saved.output, saved.sector, saved.name
        self._network = dict(saved.network)
        self.measuring = True
        self.reboot_wanted = False
        self._awake_s = self._laser_s = now_s + self.settings.startup_s

    def awake(self, now_s: float) -> bool:
        """Whether it listens at all."""
        return now_s >= self._awake_s

    def scanning(self, clients: list[Client], now_s: float) -> bool:
        """Whether the laser is on: nobody is logged in, and nobody has stopped it."""
        logged_in = any(client.level != Level.RUN for client in clients)
        return self.measuring and not logged_in and now_s >= self._laser_s

    def state(self, clients: list[Client], now_s: float) -> int:
        """`SCdevicestate`."""
        if self.failed:
            return _ERROR
        return _READY if self.scanning(clients, now_s) else _BUSY

    def answer(self, request: Telegram, client: Client, clients: list[Client], now_s: float) -> Telegram:
        """The answer to anything but `sRN LMDscandata`; in the dialect of the request."""
        dialect = request.dialect
        if request.kind in _KNOWN:
            names, unknown = _KNOWN[request.kind]
            if request.name not in names:
                return commands.fault(dialect, unknown)
        try:
            values = commands.values_of(request)
        except TimMalformedError as error:
            return commands.fault(dialect, error.fault)
        name = request.name
        match request.kind:
            case "sRN" | "sRI":
                return commands.value_answer(dialect, name, *self._read(name, clients, now_s))
            case "sWN":
                fault = self._write(name, values, client)
                return commands.fault(dialect, fault) if fault else commands.written_answer(dialect, name)
            case "sMN":
                if client.level < _METHOD_LEVELS.get(name, Level.RUN):
                    return commands.fault(dialect, Fault.METHOD_ACCESS_DENIED)
                return commands.method_answer(dialect, name, *self._call(name, values, client, now_s))
            case "sEN":
                return self._switch(dialect, name, values[0], client)
        return commands.fault(dialect, Fault.UNKNOWN_COMMAND)

    def _read(self, name: str, clients: list[Client], now_s: float) -> tuple[Any, ...]:
        settings = self.settings
        match name:
            case "0" | "DeviceIdent":
                return settings.type, settings.version
            case "SCdevicestate":
                return (self.state(clients, now_s),)
            case "EIHstCola":
                return (int(self.dialect is Dialect.B),)
            case "LMDscandatacfg":
                return self.output.to_values()
            case "LMPoutputRange":
                return self.sector.to_values()
            case "LMPscancfg":
                rate_chz = round(100 * settings.scan_rate_hz)
                return rate_chz, 1, WIRE_STEP_1E4DEG, FIRST_ANGLE_1E4DEG, LAST_ANGLE_1E4DEG
        plain: dict[str, Any] = {
            "DItype": settings.type_code,
            "DIornr": settings.order_number,
            "FirmwareVersion": settings.firmware,
            "SerialNumber": str(settings.serial),
            "ODoprh": settings.operating_decihours,
            "ODpwrc": settings.power_ons,
            "LocationName": self.name,
            **self._network,
        }
        value = plain[name]
        return value if isinstance(value, tuple) else (value,)

    def _write(self, name: str, values: tuple[Any, ...], client: Client) -> Fault:
        if name not in _WRITE_LEVELS or client.level < _WRITE_LEVELS[name]:
            return Fault.WRITE_ACCESS_DENIED
        match name:
            case "EIHstCola":
                dialect = Dialect.B if values[0] else Dialect.A
                if values[0] > 1 or (self._fixed_dialect and dialect is not self.dialect):
                    return Fault.LOCAL_CONDITION_FAILED
                self.dialect = client.dialect = dialect
            case "LMDscandatacfg":
                output = OutputContent.from_values(values)
                if output.to_values() != values or not _possible(output):
                    return Fault.LOCAL_CONDITION_FAILED
                self.output = output
            case "LMPoutputRange":
                sector = OutputRange.from_values(values)
                inside = FIRST_ANGLE_1E4DEG <= sector.start_1e4deg < sector.stop_1e4deg <= LAST_ANGLE_1E4DEG
                if values[0] != 1 or sector.step_1e4deg != WIRE_STEP_1E4DEG or not inside:
                    return Fault.LOCAL_CONDITION_FAILED
                self.sector = sector
            case "LocationName":
                if len(values[0]) > LONGEST_NAME:
                    return Fault.LOCAL_CONDITION_FAILED
                self.name = values[0]
            case _:
                self._network[name] = values
        return Fault.OK

    def _call(self, name: str, values: tuple[Any, ...], client: Client, now_s: float) -> tuple[int, ...]:
        match name:
            case "SetAccessMode":
                return (int(self._login(client, *values)),)
            case "Run":
                client.level = Level.RUN
                self.measuring = True
                self._laser_s = max(self._laser_s, now_s + SPIN_UP_S)
                return (1,)
            case "LMCstartmeas":
                self.measuring = True
                return (0,)
            case "LMCstopmeas":
                self.measuring = False
                return (0,)
            case "mEEwriteall":
                self._saved = _Stored(self.dialect, self.output, self.sector, self.name, dict(self._network))
                return (1,)
            case "mSCloadfacdef" | "mSCloadappdef":
                self._load_defaults(keep_network=name == "mSCloadappdef")
                return ()
        self.reboot_wanted = True
        return ()

    def _load_defaults(self, keep_network: bool) -> None:
        """As delivered, but in the dialect that is spoken, or nobody could save it."""
        delivered = _Stored(self.dialect, name=self.settings.name)
        self.output, self.sector, self.name = delivered.output, delivered.sector, delivered.name
        if not keep_network:
            self._network = delivered.network

    def _login(self, client: Client, level: int, hashed: int) -> bool:
        passwords = {int(known): password_hash(password) for known, password in PASSWORDS.items()}
        if not self.settings.user_levels_enabled or passwords.get(level) != hashed:
            return False
        client.level = Level(level)
        return True

    def _switch(self, dialect: Dialect, name: str, on: int, client: Client) -> Telegram:
        if on > 1:
            return commands.fault(dialect, Fault.LOCAL_CONDITION_FAILED)
        (client.events.add if on else client.events.discard)(name)
        return commands.event_answer(dialect, name, on)


def _possible(output: OutputContent) -> bool:
    """What a TiM571 can be told to send: one echo, digits, no encoder."""
    return (output.channels, output.unit, output.encoder) == (1, 0, 0) and 1 <= output.every <= MOST_EVERY
