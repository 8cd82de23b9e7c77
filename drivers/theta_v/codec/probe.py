"""UVC stream negotiation: the probe/commit block and the order in which it is exchanged.

Sizes and order are those of the drivers known to stream from a THETA (fact sheet section 2.2).
"""

from __future__ import annotations

import struct
from collections.abc import Generator
from dataclasses import dataclass, replace

from drivers.theta_v.errors import ThetaMalformed, ThetaRefused

SET_CUR, GET_CUR, GET_MIN, GET_MAX, GET_LEN, GET_INFO, GET_DEF = 0x01, 0x81, 0x82, 0x83, 0x85, 0x86, 0x87
VS_PROBE, VS_COMMIT = 0x0100, 0x0200
TO_INTERFACE, FROM_INTERFACE = 0x21, 0xA1
HINT_INTERVAL = 0x0001

UVC_1_0_BYTES, UVC_1_1_BYTES, UVC_1_5_BYTES = 26, 34, 48
BLOCK_BYTES = (UVC_1_5_BYTES, UVC_1_1_BYTES, UVC_1_0_BYTES)

_HEAD = struct.Struct("<HBBIHHHHHII")
_MIDDLE = struct.Struct("<IBBBB")
_TAIL = struct.Struct("<BBBBHQ")


@dataclass(frozen=True, slots=True)
class Probe:
    """One probe/commit block. Fields that a shorter block lacks are zero."""

    hint: int = 0
    format_index: int = 0
    frame_index: int = 0
    interval_100ns: int = 0
    key_frame_rate: int = 0
    p_frame_rate: int = 0
    quality: int = 0
    window: int = 0
    delay: int = 0
    max_frame_bytes: int = 0
    max_payload_bytes: int = 0
    clock_hz: int = 0
    framing: int = 0
    preferred_version: int = 0
    min_version: int = 0
    max_version: int = 0
    usage: int = 0
    bit_depth: int = 0
    settings: int = 0
    max_references_plus_1: int = 0
    rate_control: int = 0
    layout: int = 0

    def encode(self, length: int) -> bytes:
        """The block in `length` bytes: 26, 34 or 48. Raises ThetaMalformed for any other length."""
        if length not in BLOCK_BYTES:
            raise ThetaMalformed(f"a probe block has 26, 34 or 48 bytes, not {length}")
        head = _HEAD.pack(
            self.hint, self.format_index, self.frame_index, self.interval_100ns, self.key_frame_rate,
            self.p_frame_rate, self.quality, self.window, self.delay, self.max_frame_bytes,
            self.max_payload_bytes,
        )  # fmt: skip
        middle = _MIDDLE.pack(self.clock_hz, self.framing, self.preferred_version, self.min_version, self.max_version)
        tail = _TAIL.pack(
            self.usage, self.bit_depth, self.settings, self.max_references_plus_1, self.rate_control,
            self.layout,
        )  # fmt: skip
        return (head + middle + tail)[:length]

    @classmethod
    def decode(cls, raw: bytes) -> Probe:
        """Decode 26 to 48 bytes; an answer between two sizes counts as the smaller. Raises ThetaMalformed."""
        length = next((n for n in BLOCK_BYTES if len(raw) >= n), None)
        if length is None:
            raise ThetaMalformed(f"probe block of {len(raw)} bytes, at least 26 expected")
        whole = bytes(raw[:length]).ljust(UVC_1_5_BYTES, b"\0")
        return cls(*_HEAD.unpack_from(whole), *_MIDDLE.unpack_from(whole, 26), *_TAIL.unpack_from(whole, 34))


@dataclass(frozen=True, slots=True)
class ControlRequest:
    """One control transfer to make; `data` goes out, or `length` bytes are expected in."""

    request_type: int
    request: int
    value: int
    index: int
    data: bytes = b""
    length: int = 0


def negotiate(
    interface: int, format_index: int, frame_index: int, interval_100ns: int
) -> Generator[ControlRequest, bytes | None, Probe]:
    """Agree on a stream: yields requests, is sent each answer (None where the camera stalled).

    GET_LEN, GET_MAX, PROBE SET_CUR, PROBE GET_CUR, COMMIT SET_CUR. A camera that knows neither GET_LEN nor
    GET_MAX is met with zeros, in 48 bytes and then in fewer. Returns the committed block; raises
    ThetaRefused when the camera will not give what was asked for, ThetaMalformed for nonsense.
    """
    answer = yield ControlRequest(FROM_INTERFACE, GET_LEN, VS_PROBE, interface, length=2)
    said = int.from_bytes(answer[:2], "little") if answer is not None else 0
    lengths = (said, *BLOCK_BYTES) if said in BLOCK_BYTES else BLOCK_BYTES

    answer = yield ControlRequest(FROM_INTERFACE, GET_MAX, VS_PROBE, interface, length=lengths[0])
    best = Probe.decode(answer) if answer is not None and len(answer) >= UVC_1_0_BYTES else Probe()
    wish = replace(
        best,
        hint=HINT_INTERVAL,
        format_index=format_index,
        frame_index=frame_index,
        interval_100ns=interval_100ns,
    )
    for length in dict.fromkeys(lengths):
        answer = yield ControlRequest(TO_INTERFACE, SET_CUR, VS_PROBE, interface, data=wish.encode(length))
        if answer is not None:
            break
    else:
        raise ThetaRefused("the camera refuses to negotiate a video stream; switch it off and on again")

    answer = yield ControlRequest(FROM_INTERFACE, GET_CUR, VS_PROBE, interface, length=length)
    offer = Probe.decode(answer) if answer is not None else wish
    if (offer.format_index, offer.frame_index) != (format_index, frame_index):
        raise ThetaRefused(
            f"the camera offers format {offer.format_index}, size {offer.frame_index} instead of format"
            f" {format_index}, size {frame_index}; choose the other video mode"
        )
    answer = yield ControlRequest(TO_INTERFACE, SET_CUR, VS_COMMIT, interface, data=offer.encode(length))
    if answer is None:
        raise ThetaRefused("the camera takes back the video stream it offered; switch it off and on again")
    return offer
