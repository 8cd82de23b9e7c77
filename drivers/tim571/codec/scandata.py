"""The scan telegram `LMDscandata`, whole, in both dialects and both directions (fact sheet section 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from drivers.tim571.codec import fields
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.readers import Reader, Samples
from drivers.tim571.codec.telegram import Telegram
from drivers.tim571.codec.writers import Writer
from drivers.tim571.errors import TimMalformedError

TICKS = 1 << 32
"""The device's microseconds wrap here, every 71.6 minutes."""
COUNTS = 1 << 16
"""Scan and telegram counters wrap here."""
SCAN_NAMES = ("LMDscandata", "LMDscandatamon")
_MOST_CHANNELS = 8  # DIST1..5, RSSI1, ANGL1, VANG1: more is damage
_TAG = 5
_HEAD = "HHIBBHHIIBBBBHIIH"


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """One row of samples; distance in millimetres is `samples * scale + offset`."""

    tag: str
    """`DIST1`, `RSSI1`, ..."""
    scale: float
    offset: float
    start_1e4deg: int
    """Device angle of the first sample in 1/10000 degree."""
    step_1e4deg: int
    samples: Samples


class Encoder(NamedTuple):
    """An incremental encoder's reading (a TiM571 has none)."""

    position: int
    speed: int


class Position(NamedTuple):
    """The mounting position stored in the device: x y z, rotations, kind of rotation."""

    x: float
    y: float
    z: float
    rx: float
    ry: float
    rz: float
    rotation: int


class Clock(NamedTuple):
    """The device's wall clock (1970 at power-on unless set)."""

    year: int
    month: int
    day: int
    hour: int
    minute: int
    second: int
    microsecond: int


class Event(NamedTuple):
    """A digital input event."""

    tag: str
    encoder: int
    time_us: int
    angle_1e4deg: int


@dataclass(frozen=True, slots=True, eq=False)
class ScanData:
    """A scan telegram, field by field as on the wire; ticks are microseconds since start-up, modulo 2**32."""

    version: int
    device: int
    serial: int
    status: tuple[int, int]
    """Both zero when the device is well."""
    telegram_counter: int
    scan_counter: int
    scan_tick_us: int
    transmit_tick_us: int
    inputs: tuple[int, int]
    outputs: tuple[int, int]
    layer: int
    scan_frequency_chz: int
    """1/100 Hz."""
    measuring_frequency_100hz: int
    encoders: tuple[Encoder, ...] = ()
    channels16: tuple[Channel, ...] = ()
    channels8: tuple[Channel, ...] = ()
    position: Position | None = None
    name: str | None = None
    comment: str | None = None
    clock: Clock | None = None
    event: Event | None = None
    trailing: bytes = b""
    """What followed that this description does not know."""
    canonical: bool = True
    """Whether the samples were spelt as a device spells them; in CoLa-B there is one way only."""

    def channel(self, tag: str) -> Channel | None:
        """The first channel of that name."""
        return next((row for row in (*self.channels16, *self.channels8) if row.tag == tag), None)


def is_scan(telegram: Telegram) -> bool:
    """Whether the telegram carries a scan, polled or streamed."""
    return telegram.kind in ("sRA", "sSN") and telegram.name in SCAN_NAMES


def decode(telegram: Telegram) -> ScanData:
    """The scan in a telegram; raises TimMalformedError if it contradicts itself or ends too early."""
    source = fields.reader(telegram.dialect, telegram.body)
    head = source.take(_HEAD)
    # fmt: off
    (version, device, serial, status0, status1, telegrams, scans, scan_tick, transmit_tick,
     in0, in1, out0, out1, layer, scan_frequency, measuring_frequency, encoder_count) = head
    # fmt: on
    if encoder_count > _MOST_CHANNELS:
        raise TimMalformedError(f"{encoder_count} encoders")
    return ScanData(
        version=version,
        device=device,
        serial=serial,
        status=(status0, status1),
        telegram_counter=telegrams,
        scan_counter=scans,
        scan_tick_us=scan_tick,
        transmit_tick_us=transmit_tick,
        inputs=(in0, in1),
        outputs=(out0, out1),
        layer=layer,
        scan_frequency_chz=scan_frequency,
        measuring_frequency_100hz=measuring_frequency,
        encoders=tuple(Encoder(*source.take("IH")) for _ in range(encoder_count)),
        channels16=_channels(source, "H"),
        channels8=_channels(source, "B"),
        position=Position(*source.take("ffffffB")) if _flag(source) else None,
        name=source.string() if _flag(source) else None,
        comment=source.string() if _flag(source) else None,
        clock=Clock(*source.take("HBBBBBI")) if _flag(source) else None,
        event=Event(source.tag(4), *source.take("IIi")) if _flag(source) else None,
        trailing=source.rest,
        canonical=source.canonical,
    )


def encode(scan: ScanData, dialect: Dialect, kind: str = "sSN", name: str = "LMDscandata") -> Telegram:
    """The scan as a telegram; the inverse of `decode`, byte for byte."""
    return put_together(scan, encode_samples(scan, dialect), dialect, kind, name)


def put_together(scan: ScanData, samples: bytes, dialect: Dialect, kind: str, name: str) -> Telegram:
    """A telegram of the scan's counters and ticks, and of what `encode_samples` made of the rest in good time."""
    sink = fields.writer(dialect)
    sink.put(
        _HEAD,
        scan.version,
        scan.device,
        scan.serial,
        *scan.status,
        scan.telegram_counter,
        scan.scan_counter,
        scan.scan_tick_us,
        scan.transmit_tick_us,
        *scan.inputs,
        *scan.outputs,
        scan.layer,
        scan.scan_frequency_chz,
        scan.measuring_frequency_100hz,
        len(scan.encoders),
    )
    sink.raw(samples)
    return Telegram(dialect, kind, name, sink.body())


def encode_samples(scan: ScanData, dialect: Dialect) -> bytes:
    """All that follows the head of a telegram: encoders, channels and blocks."""
    sink = fields.writer(dialect)
    for encoder in scan.encoders:
        sink.put("IH", *encoder)
    for channels, letter in ((scan.channels16, "H"), (scan.channels8, "B")):
        sink.put("H", len(channels))
        for row in channels:
            sink.tag(row.tag)
            sink.put("ffiHH", row.scale, row.offset, row.start_1e4deg, row.step_1e4deg, len(row.samples))
            sink.samples(row.samples, letter)
    _put_tail(sink, scan)
    return sink.body()


def _put_tail(sink: Writer, scan: ScanData) -> None:
    sink.put("H", int(scan.position is not None))
    if scan.position is not None:
        sink.put("ffffffB", *scan.position)
    for text in (scan.name, scan.comment):
        sink.put("H", int(text is not None))
        if text is not None:
            sink.string(text)
    sink.put("H", int(scan.clock is not None))
    if scan.clock is not None:
        sink.put("HBBBBBI", *scan.clock)
    sink.put("H", int(scan.event is not None))
    if scan.event is not None:
        sink.tag(scan.event.tag)
        sink.put("IIi", *scan.event[1:])
    sink.raw(scan.trailing)


def _channels(source: Reader, letter: str) -> tuple[Channel, ...]:
    (count,) = source.take("H")
    if count > _MOST_CHANNELS:
        raise TimMalformedError(f"{count} channels")
    return tuple(_channel(source, letter) for _ in range(count))


def _channel(source: Reader, letter: str) -> Channel:
    tag = source.tag(_TAG)
    scale, offset, start, step, count = source.take("ffiHH")
    return Channel(tag, scale, offset, start, step, source.samples(count, letter))


def _flag(source: Reader) -> bool:
    (flag,) = source.take("H")
    if flag > 1:
        raise TimMalformedError(f"a block flag of {flag}")
    return bool(flag)
