"""USB configuration descriptors: where the video and the PTP interfaces are, and what they offer.

The driver takes interface numbers, endpoints, sizes and rates from here and from nowhere else: no public
dump of a THETA V in live mode exists (fact sheet, preface and section 1.4). Layouts: USB 2.0 chapter 9.6,
UVC 1.5 class descriptors as decoded in fact sheet section 2.1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from drivers.theta_v.errors import ThetaMalformed

CONFIGURATION, INTERFACE, ENDPOINT, CS_INTERFACE, SS_COMPANION = 0x02, 0x04, 0x05, 0x24, 0x30
ISOCHRONOUS, BULK, INTERRUPT = 1, 2, 3

VC_HEADER = 0x01
VS_FORMAT_H264, VS_FRAME_H264 = 0x13, 0x14
FRAME_H264_BYTES = 44  # before the list of intervals

MAX_SETTINGS = 256  # interfaces times alternate settings; a THETA has 8
MAX_ENDPOINTS = 30  # per alternate setting: all a device can have


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One endpoint; `max_packet_bytes` is what it may carry per (micro)frame, high-bandwidth included."""

    address: int
    kind: int
    max_packet_bytes: int
    interval: int

    @property
    def is_in(self) -> bool:
        return bool(self.address & 0x80)


@dataclass(frozen=True, slots=True)
class Setting:
    """One alternate setting of one interface, with its class descriptors as they stand."""

    interface: int
    alternate: int
    triple: tuple[int, int, int]
    """Class, subclass, protocol."""
    endpoints: tuple[Endpoint, ...] = ()
    extra: tuple[bytes, ...] = ()


@dataclass(frozen=True, slots=True)
class Configuration:
    value: int
    settings: tuple[Setting, ...]


@dataclass(frozen=True, slots=True)
class H264Frame:
    """One picture size the camera offers; intervals in units of 100 ns, as UVC counts them."""

    index: int
    width: int
    height: int
    profile: int
    level: int
    max_bit_rate: int
    default_interval_100ns: int
    intervals_100ns: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class H264Format:
    index: int
    default_frame: int
    frames: tuple[H264Frame, ...]

    def frame(self, width: int, height: int) -> H264Frame | None:
        return next((f for f in self.frames if (f.width, f.height) == (width, height)), None)


@dataclass(frozen=True, slots=True)
class Pipe:
    """An alternate setting of the VideoStreaming interface and the endpoint that carries video in it."""

    alternate: int
    endpoint: Endpoint


@dataclass(frozen=True, slots=True)
class VideoFunction:
    """The live stream: what to claim, what to ask for, where the packets come from."""

    interface: int
    bcd_uvc: int
    formats: tuple[H264Format, ...]
    pipes: tuple[Pipe, ...]

    def pipe(self, payload_bytes: int) -> Pipe:
        """The narrowest pipe that carries `payload_bytes` a packet; the widest for more, or for 0: not said.

        Raises ThetaMalformed if the interface has no endpoint for video at all.
        """
        if not self.pipes:
            raise ThetaMalformed("the camera's video interface has no endpoint; unplug and replug the camera")
        wide = [p for p in self.pipes if p.endpoint.max_packet_bytes >= payload_bytes > 0]
        if wide:
            return min(wide, key=lambda p: p.endpoint.max_packet_bytes)
        return max(self.pipes, key=lambda p: p.endpoint.max_packet_bytes)


@dataclass(frozen=True, slots=True)
class StillFunction:
    """The PTP interface: two bulk endpoints and one for events."""

    interface: int
    bulk_in: Endpoint
    bulk_out: Endpoint
    events: Endpoint | None


def descriptors(raw: bytes) -> Iterator[bytes]:
    """Split a configuration into its descriptors. Raises ThetaMalformed when a length makes no sense."""
    at = 0
    while at < len(raw):
        length = raw[at]
        if length < 2 or at + length > len(raw):
            raise ThetaMalformed(f"descriptor at byte {at} claims {length} bytes of {len(raw) - at}")
        yield raw[at : at + length]
        at += length


def parse_configuration(raw: bytes) -> Configuration:
    """Parse one whole configuration (wTotalLength bytes; what follows is ignored). Raises ThetaMalformed."""
    if len(raw) < 9 or raw[0] < 9 or raw[1] != CONFIGURATION:
        raise ThetaMalformed("not a USB configuration descriptor")
    total = int.from_bytes(raw[2:4], "little")
    if total < 9 or total > len(raw):
        raise ThetaMalformed(f"configuration claims {total} bytes, {len(raw)} were read")
    settings: list[Setting] = []
    for descriptor in descriptors(raw[:total]):
        match descriptor[1]:
            case 0x04:
                if len(settings) >= MAX_SETTINGS:
                    raise ThetaMalformed(f"more than {MAX_SETTINGS} interface settings")
                settings.append(_setting(descriptor))
            case 0x05 if settings:
                if len(settings[-1].endpoints) >= MAX_ENDPOINTS:
                    raise ThetaMalformed(f"more than {MAX_ENDPOINTS} endpoints in one setting")
                endpoints = (*settings[-1].endpoints, _endpoint(descriptor))
                settings[-1] = replace(settings[-1], endpoints=endpoints)
            case 0x24 if settings:
                settings[-1] = replace(settings[-1], extra=(*settings[-1].extra, descriptor))
            case 0x30 if settings and settings[-1].endpoints:
                *others, last = settings[-1].endpoints
                settings[-1] = replace(settings[-1], endpoints=(*others, _widened(last, descriptor)))
            case _:
                pass
    return Configuration(value=raw[5], settings=tuple(settings))


def find_video(configuration: Configuration) -> VideoFunction | None:
    """The H.264 VideoStreaming function, or None (the camera is not in live mode). Raises ThetaMalformed."""
    bcd_uvc = 0x0100
    interface: int | None = None
    formats: tuple[H264Format, ...] = ()
    for setting in configuration.settings:
        if setting.triple[:2] == (0x0E, 0x01):
            bcd_uvc = next(
                (int.from_bytes(x[3:5], "little") for x in setting.extra if len(x) >= 5 and x[2] == VC_HEADER),
                bcd_uvc,
            )
        elif setting.triple[:2] == (0x0E, 0x02) and interface is None:
            found = _formats(setting.extra)
            if found:
                interface, formats = setting.interface, found
    if interface is None:
        return None
    pipes = tuple(
        Pipe(setting.alternate, endpoint)
        for setting in configuration.settings
        if setting.interface == interface
        for endpoint in setting.endpoints
        if endpoint.is_in and endpoint.kind in (ISOCHRONOUS, BULK)
    )
    return VideoFunction(interface, bcd_uvc, formats, pipes)


def find_still(configuration: Configuration) -> StillFunction | None:
    """The PTP interface, by class 06/01/01 or else by its shape: two bulk, one interrupt (section 1.4)."""
    shaped = [s for s in configuration.settings if s.triple == (0x06, 0x01, 0x01)]
    shaped += [s for s in configuration.settings if s.triple[0] == 0xFF]
    for setting in shaped:
        bulk_in = next((e for e in setting.endpoints if e.kind == BULK and e.is_in), None)
        bulk_out = next((e for e in setting.endpoints if e.kind == BULK and not e.is_in), None)
        events = next((e for e in setting.endpoints if e.kind == INTERRUPT and e.is_in), None)
        if bulk_in is not None and bulk_out is not None:
            return StillFunction(setting.interface, bulk_in, bulk_out, events)
    return None


def _setting(raw: bytes) -> Setting:
    if len(raw) < 9:
        raise ThetaMalformed("interface descriptor is too short")
    return Setting(interface=raw[2], alternate=raw[3], triple=(raw[5], raw[6], raw[7]))


def _endpoint(raw: bytes) -> Endpoint:
    if len(raw) < 7:
        raise ThetaMalformed("endpoint descriptor is too short")
    size = int.from_bytes(raw[4:6], "little")
    kind = raw[3] & 0x03
    per_microframe = 1 + (size >> 11 & 0x03) if kind in (ISOCHRONOUS, INTERRUPT) else 1
    return Endpoint(raw[2], kind, (size & 0x7FF) * per_microframe, raw[6])


def _widened(endpoint: Endpoint, companion: bytes) -> Endpoint:
    """At SuperSpeed a periodic endpoint carries wBytesPerInterval, said by its companion."""
    if len(companion) < 6 or endpoint.kind not in (ISOCHRONOUS, INTERRUPT):
        return endpoint
    per_interval = int.from_bytes(companion[4:6], "little")
    return replace(endpoint, max_packet_bytes=max(endpoint.max_packet_bytes, per_interval))


def _formats(extra: tuple[bytes, ...]) -> tuple[H264Format, ...]:
    formats: list[H264Format] = []
    for raw in extra:
        if len(raw) < 3:
            continue
        if raw[2] == VS_FORMAT_H264:
            if len(raw) < 6:
                raise ThetaMalformed("H.264 format descriptor is too short")
            formats.append(H264Format(raw[3], raw[5], ()))
        elif raw[2] == VS_FRAME_H264 and formats:
            formats[-1] = replace(formats[-1], frames=(*formats[-1].frames, _frame(raw)))
    return tuple(f for f in formats if f.frames)


def _frame(raw: bytes) -> H264Frame:
    if len(raw) < FRAME_H264_BYTES or len(raw) < FRAME_H264_BYTES + 4 * raw[43]:
        raise ThetaMalformed("H.264 frame descriptor is too short")

    def number(at: int, size: int) -> int:
        return int.from_bytes(raw[at : at + size], "little")

    default = number(39, 4)
    intervals = tuple(number(FRAME_H264_BYTES + 4 * i, 4) for i in range(raw[43]))
    return H264Frame(
        index=raw[3],
        width=number(4, 2),
        height=number(6, 2),
        profile=number(12, 2),
        level=raw[14],
        max_bit_rate=number(35, 4),
        default_interval_100ns=default,
        intervals_100ns=intervals or (default,),
    )
