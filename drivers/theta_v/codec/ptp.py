"""PTP over USB: containers, data sets and the part of Ricoh's API this driver uses.

Layouts and values: PIMA 15740 and Ricoh's USB API as gathered in fact sheet section 4.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

from drivers.theta_v.errors import ThetaMalformed

HEADER = struct.Struct("<IHHI")
COMMAND, DATA, RESPONSE, EVENT = 1, 2, 3, 4
MAX_PARAMETERS = 5
MAX_CONTAINER_BYTES = 1 << 20  # data sets and properties are below 1 kB; pictures are not fetched here
MAX_ARRAY = 4096  # entries of a list in a data set


class Operation(IntEnum):
    GET_DEVICE_INFO = 0x1001
    OPEN_SESSION = 0x1002
    CLOSE_SESSION = 0x1003
    POWER_DOWN = 0x1013
    GET_PROPERTY_DESCRIPTION = 0x1014
    GET_PROPERTY = 0x1015
    SET_PROPERTY = 0x1016
    RESET_PROPERTY = 0x1017


class Response(IntEnum):
    OK = 0x2001
    GENERAL_ERROR = 0x2002
    SESSION_NOT_OPEN = 0x2003
    INVALID_TRANSACTION = 0x2004
    OPERATION_NOT_SUPPORTED = 0x2005
    PARAMETER_NOT_SUPPORTED = 0x2006
    INCOMPLETE_TRANSFER = 0x2007
    PROPERTY_NOT_SUPPORTED = 0x200A
    ACCESS_DENIED = 0x200F
    DEVICE_BUSY = 0x2019
    INVALID_FORMAT = 0x201B
    INVALID_VALUE = 0x201C
    INVALID_PARAMETER = 0x201D
    SESSION_ALREADY_OPEN = 0x201E


class Property(IntEnum):
    BATTERY_LEVEL = 0x5001
    FUNCTIONAL_MODE = 0x5002
    CAPTURE_MODE = 0x5013
    AUDIO_VOLUME = 0x502C
    ERROR_INFO = 0xD006
    SLEEP_DELAY_S = 0xD803
    BATTERY_STATUS = 0xD80C
    SLEEP_MODE = 0xD80E
    AUTO_POWER_OFF_S = 0xD81B


class CaptureMode(IntEnum):
    STILL = 0x0001
    VIDEO = 0x8002
    LIVE = 0x8005


class Kind(IntEnum):
    """Data types of properties, by their PTP code."""

    U8 = 0x0002
    I16 = 0x0003
    U16 = 0x0004
    U32 = 0x0006
    U64 = 0x0008
    STRING = 0xFFFF


_NUMBERS = {Kind.U8: "<B", Kind.I16: "<h", Kind.U16: "<H", Kind.U32: "<I", Kind.U64: "<Q"}

KINDS: dict[int, Kind] = {
    Property.BATTERY_LEVEL: Kind.U8,
    Property.FUNCTIONAL_MODE: Kind.U16,
    Property.CAPTURE_MODE: Kind.U16,
    Property.AUDIO_VOLUME: Kind.U32,
    Property.ERROR_INFO: Kind.U32,
    Property.SLEEP_DELAY_S: Kind.U16,
    Property.BATTERY_STATUS: Kind.U8,
    Property.SLEEP_MODE: Kind.U8,
    Property.AUTO_POWER_OFF_S: Kind.U32,
}
"""Types of the properties this driver reads and writes (fact sheet section 4.3)."""

Value = int | str


@dataclass(frozen=True, slots=True)
class Container:
    """One PTP container; `body` is the parameters of a command, response or event, or the data."""

    kind: int
    code: int
    transaction: int
    body: bytes = b""

    def encode(self) -> bytes:
        return HEADER.pack(HEADER.size + len(self.body), self.kind, self.code, self.transaction) + self.body

    @property
    def parameters(self) -> tuple[int, ...]:
        """The body as u32 parameters. Raises ThetaMalformed when it is not."""
        if len(self.body) % 4 or len(self.body) > 4 * MAX_PARAMETERS:
            raise ThetaMalformed(f"PTP container {self.code:#06x} has {len(self.body)} bytes of parameters")
        return struct.unpack(f"<{len(self.body) // 4}I", self.body)


def command(operation: int, transaction: int, *parameters: int) -> Container:
    """A command container. Raises ThetaMalformed for more than five parameters or one beyond 32 bits."""
    if len(parameters) > MAX_PARAMETERS:
        raise ThetaMalformed(f"a PTP command has at most {MAX_PARAMETERS} parameters")
    try:
        return Container(COMMAND, operation, transaction, struct.pack(f"<{len(parameters)}I", *parameters))
    except struct.error as error:
        raise ThetaMalformed(f"PTP parameter out of range: {error}") from None


class ContainerReader:
    """Fed bytes in any fragmentation, returns whole containers; holds at most one of the largest size."""

    def __init__(self, max_bytes: int = MAX_CONTAINER_BYTES) -> None:
        self._max_bytes = max_bytes
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Container]:
        """Take bytes; return the containers they complete.

        Raises ThetaMalformed on an impossible length or type; what was held is dropped then, since a
        container stream without lengths cannot be found again.
        """
        self._buffer += data
        containers: list[Container] = []
        while len(self._buffer) >= HEADER.size:
            length, kind, code, transaction = HEADER.unpack_from(self._buffer)
            if not HEADER.size <= length <= self._max_bytes or kind not in (COMMAND, DATA, RESPONSE, EVENT):
                self._buffer.clear()
                raise ThetaMalformed(f"PTP container of type {kind} and {length} bytes")
            if len(self._buffer) < length:
                break
            body = bytes(self._buffer[HEADER.size : length])
            del self._buffer[:length]
            containers.append(Container(kind, code, transaction, body))
        return containers

    @property
    def wanted(self) -> int:
        """Bytes still missing from the container in progress; 0 between two."""
        if not self._buffer:
            return 0
        if len(self._buffer) < HEADER.size:
            return HEADER.size - len(self._buffer)
        length: int = HEADER.unpack_from(self._buffer)[0]
        return length - len(self._buffer)


class Fields:
    """Reads the fields of a data set in order; past the end it raises ThetaMalformed."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def take(self, count: int) -> bytes:
        piece = self._data[self._at : self._at + count]
        if len(piece) != count:
            raise ThetaMalformed("PTP data set ends too early")
        self._at += count
        return piece

    def number(self, layout: str) -> int:
        value: int = struct.unpack(layout, self.take(struct.calcsize(layout)))[0]
        return value

    def string(self) -> str:
        count = self.take(1)[0]
        try:
            return self.take(2 * count).decode("utf-16-le").rstrip("\0")
        except UnicodeDecodeError as error:
            raise ThetaMalformed(f"PTP string is not UTF-16: {error.reason}") from None

    def array(self) -> tuple[int, ...]:
        count = self.number("<I")
        if count > MAX_ARRAY:
            raise ThetaMalformed(f"PTP list of {count} entries")
        return struct.unpack(f"<{count}H", self.take(2 * count))

    def value(self, kind: Kind) -> Value:
        return self.string() if kind is Kind.STRING else self.number(_NUMBERS[kind])


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """The answer to GetDeviceInfo."""

    manufacturer: str
    model: str
    version: str
    serial: str
    operations: tuple[int, ...]
    events: tuple[int, ...]
    properties: tuple[int, ...]
    capture_formats: tuple[int, ...] = ()
    playback_formats: tuple[int, ...] = ()
    standard_version: int = 100
    vendor_extension: int = 6
    vendor_version: int = 110
    vendor_text: str = ""
    functional_mode: int = 0

    @classmethod
    def decode(cls, data: bytes) -> DeviceInfo:
        """Raises ThetaMalformed."""
        f = Fields(data)
        head = (f.number("<H"), f.number("<I"), f.number("<H"), f.string(), f.number("<H"))
        operations, events, properties, capture, playback = (f.array() for _ in range(5))
        manufacturer, model, version, serial = (f.string() for _ in range(4))
        return cls(manufacturer, model, version, serial, operations, events, properties, capture, playback, *head)

    def encode(self) -> bytes:
        lists = (
            self.operations, self.events, self.properties, self.capture_formats, self.playback_formats,
        )  # fmt: skip
        return b"".join(
            [
                struct.pack("<HIH", self.standard_version, self.vendor_extension, self.vendor_version),
                encode_string(self.vendor_text),
                struct.pack("<H", self.functional_mode),
                *(struct.pack(f"<I{len(codes)}H", len(codes), *codes) for codes in lists),
                *(encode_string(s) for s in (self.manufacturer, self.model, self.version, self.serial)),
            ]
        )


@dataclass(frozen=True, slots=True)
class PropertyDescription:
    """The answer to GetDevicePropDesc; `span` is (min, max, step), `choices` the allowed values."""

    code: int
    kind: Kind
    writable: bool
    default: Value
    current: Value
    span: tuple[Value, Value, Value] | None = None
    choices: tuple[Value, ...] | None = None

    @classmethod
    def decode(cls, data: bytes) -> PropertyDescription:
        """Raises ThetaMalformed."""
        f = Fields(data)
        code, raw_kind, access = f.number("<H"), f.number("<H"), f.number("<B")
        try:
            kind = Kind(raw_kind)
        except ValueError:
            raise ThetaMalformed(f"PTP property {code:#06x} has unknown type {raw_kind:#06x}") from None
        default, current, form = f.value(kind), f.value(kind), f.number("<B")
        span = (f.value(kind), f.value(kind), f.value(kind)) if form == 1 else None
        choices = tuple(f.value(kind) for _ in range(f.number("<H"))) if form == 2 else None
        return cls(code, kind, bool(access), default, current, span, choices)

    def encode(self) -> bytes:
        form: tuple[bytes, ...] = (b"\0",)
        if self.span is not None:
            form = (b"\1", *(encode_value(self.kind, v) for v in self.span))
        elif self.choices is not None:
            count = struct.pack("<H", len(self.choices))
            form = (b"\2", count, *(encode_value(self.kind, v) for v in self.choices))
        values = (encode_value(self.kind, self.default), encode_value(self.kind, self.current))
        return b"".join([struct.pack("<HHB", self.code, self.kind, self.writable), *values, *form])

    def allows(self, value: Value) -> bool:
        if self.choices is not None:
            return value in self.choices
        if self.span is not None and isinstance(value, int):
            low, high, _step = (int(v) for v in self.span)
            return low <= value <= high
        return True


def encode_string(text: str) -> bytes:
    """u8 count of UTF-16 units with the closing zero, then the units; one zero byte when empty."""
    if not text:
        return b"\0"
    units = (text + "\0").encode("utf-16-le")
    if len(units) > 2 * 255:
        raise ThetaMalformed("a PTP string has at most 254 characters")
    return bytes([len(units) // 2]) + units


def encode_value(kind: Kind, value: Value) -> bytes:
    """Raises ThetaMalformed when the value does not fit its type."""
    if kind is Kind.STRING:
        return encode_string(str(value))
    try:
        return struct.pack(_NUMBERS[kind], value)
    except struct.error as error:
        raise ThetaMalformed(f"PTP value {value!r} does not fit {kind.name}: {error}") from None


def decode_value(kind: Kind, data: bytes) -> Value:
    """Raises ThetaMalformed when the bytes are too few."""
    return Fields(data).value(kind)
