"""H.264 as the camera sends it (Annex B): NAL units, parameter sets, slice headers.

Only what tells a whole picture from a broken one and a key picture from the rest; decoding is PyAV's.
Section numbers are those of ITU-T H.264.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drivers.theta_v.errors import ThetaMalformed

SLICE, IDR, SEI, SPS, PPS, AUD = 1, 5, 6, 7, 8, 9
START_CODE = b"\x00\x00\x00\x01"

SEARCHED_AT_ONCE = 256 << 10  # bytes; a picture of nothing but zeros must not need hundreds of megabytes of indices
MAX_NALS = 256  # per access unit; the camera sends one slice and at most a handful of others
MAX_PARAMETER_SET_BYTES = 1024  # an SPS with every list it may carry stays below
MAX_SIDE = 16384  # pixels; level 6.2 allows no more
HEADER_BYTES = 64  # of a slice: enough for the fields up to frame_num

CHROMA_PROFILES = frozenset({100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135})  # 7.3.2.1.1


@dataclass(frozen=True, slots=True)
class Nal:
    """One NAL unit: its bytes are `data[start:end]`, without start code and trailing zeros."""

    kind: int
    reference: int
    """nal_ref_idc: 0 where no later picture depends on it."""
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class SequenceParameters:
    """What this driver needs of an SPS."""

    sps_id: int
    profile: int
    level: int
    width: int
    height: int
    log2_max_frame_num: int
    gaps_allowed: bool
    separate_planes: bool


@dataclass(frozen=True, slots=True)
class PictureParameters:
    pps_id: int
    sps_id: int


@dataclass(frozen=True, slots=True)
class SliceStart:
    """The part of a slice header that does not need the SPS, and where the rest begins (in bits)."""

    first_macroblock: int
    pps_id: int
    bits: int


class Bits:
    """Reads a NAL unit's bits, emulation prevention removed. Past the end it raises ThetaMalformed."""

    def __init__(self, nal: bytes) -> None:
        payload = nal.replace(b"\x00\x00\x03", b"\x00\x00")
        self._value = int.from_bytes(payload, "big")
        self._length = 8 * len(payload)
        self.at = 0

    def u(self, count: int) -> int:
        """Unsigned integer of `count` bits."""
        self.at += count
        if self.at > self._length:
            raise ThetaMalformed("H.264 header ends too early")
        return self._value >> (self._length - self.at) & ((1 << count) - 1)

    def prefix(self, count: int) -> int:
        """The first `count` bits, wherever reading has got to."""
        return self._value >> (self._length - count)

    def ue(self) -> int:
        """Unsigned exp-Golomb (9.1)."""
        zeros = 0
        while not self.u(1):
            zeros += 1
            if zeros > 32:
                raise ThetaMalformed("H.264 header holds an impossible number")
        return (1 << zeros) - 1 + self.u(zeros)

    def se(self) -> int:
        """Signed exp-Golomb (9.1.1)."""
        code = self.ue()
        return (code + 1) // 2 if code & 1 else -(code // 2)


def split(data: bytes) -> list[Nal]:
    """Find the NAL units of one access unit. Raises ThetaMalformed beyond MAX_NALS."""
    codes: list[int] = []
    for at in range(0, len(data), SEARCHED_AT_ONCE):
        codes += _start_codes(data, at, at + SEARCHED_AT_ONCE)
        if len(codes) > MAX_NALS:
            raise ThetaMalformed(f"more than {MAX_NALS} NAL units in one picture")
    nals: list[Nal] = []
    for code, following in pairwise([*codes, len(data)]):
        start, end = code + 3, following
        if data[end - 1] == 0:
            end = start + len(data[start:end].rstrip(b"\0"))
        if end > start:
            nals.append(Nal(data[start] & 0x1F, data[start] >> 5 & 0x03, start, end))
    return nals


def _start_codes(data: bytes, begin: int, end: int) -> list[int]:
    """Where 00 00 01 begins in `data[begin:end]`: looked for as pairs of zeros, five times as fast as a search."""
    octets = np.frombuffer(data, np.uint8)[begin : end + 2]
    size = len(octets)
    if size < 3:
        return []
    even = 2 * np.flatnonzero(octets[: size & ~1].view(np.uint16) == 0)
    odd = 2 * np.flatnonzero(octets[1 : 1 + (size - 1 & ~1)].view(np.uint16) == 0) + 1
    zeros = np.concatenate((even, odd))
    zeros = zeros[zeros + 2 < size]
    codes: list[int] = (np.sort(zeros[octets[zeros + 2] == 1]) + begin).tolist()
    return codes


def starts_with_code(data: bytes | bytearray | memoryview) -> bool:
    """Whether the bytes begin at a NAL unit, as an access unit must."""
    head = bytes(data[:4])
    return head == START_CODE or head[:3] == START_CODE[1:]


def opens_stream(data: bytes | bytearray | memoryview) -> bool:
    """Whether a picture that can be decoded from nothing begins exactly here: an SPS, a delimiter before it.

    Emulation prevention keeps these bytes out of the inside of any other NAL unit.
    """
    head = bytes(data[:5])
    if head.startswith(START_CODE[1:]):
        head = b"\0" + head
    return head.startswith(START_CODE) and len(head) > 4 and head[4] & 0x1F in (SPS, AUD)


def parse_sps(nal: bytes) -> SequenceParameters:
    """Parse a sequence parameter set (7.3.2.1.1), NAL header byte included. Raises ThetaMalformed."""
    return read_sps(parameter_bits(nal, SPS))[0]


def read_sps(bits: Bits) -> tuple[SequenceParameters, int]:
    """Read an SPS up to its vui_parameters_present_flag; with it, how many reference frames it allows."""
    profile, _constraints, level = bits.u(8), bits.u(8), bits.u(8)
    sps_id = _bounded(bits.ue(), 31)
    chroma, separate = 1, False
    if profile in CHROMA_PROFILES:
        chroma = _bounded(bits.ue(), 3)
        separate = chroma == 3 and bool(bits.u(1))
        _bounded(bits.ue(), 6)
        _bounded(bits.ue(), 6)
        bits.u(1)
        if bits.u(1):
            for i in range(12 if chroma == 3 else 8):
                if bits.u(1):
                    _skip_scaling_list(bits, 16 if i < 6 else 64)
    log2_max_frame_num = _bounded(bits.ue(), 12) + 4
    order = _bounded(bits.ue(), 2)
    if order == 0:
        _bounded(bits.ue(), 12)
    elif order == 1:
        bits.u(1)
        bits.se()
        bits.se()
        for _ in range(_bounded(bits.ue(), 255)):
            bits.se()
    references = _bounded(bits.ue(), 16)
    gaps_allowed = bool(bits.u(1))
    columns = _bounded(bits.ue(), MAX_SIDE // 16) + 1
    rows = _bounded(bits.ue(), MAX_SIDE // 16) + 1
    frames_only = bits.u(1)
    if not frames_only:
        bits.u(1)
    bits.u(1)
    width, height = 16 * columns, 16 * rows * (2 - frames_only)
    if bits.u(1):
        unit_x = 2 if chroma in (1, 2) and not separate else 1
        unit_y = (2 if chroma == 1 and not separate else 1) * (2 - frames_only)
        left, right, top, bottom = (_bounded(bits.ue(), MAX_SIDE) for _ in range(4))
        width -= unit_x * (left + right)
        height -= unit_y * (top + bottom)
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise ThetaMalformed(f"H.264 picture of {width}x{height}")
    sps = SequenceParameters(sps_id, profile, level, width, height, log2_max_frame_num, gaps_allowed, separate)
    return sps, references


def parse_pps(nal: bytes) -> PictureParameters:
    """Parse the two ids of a picture parameter set (7.3.2.2). Raises ThetaMalformed."""
    bits = parameter_bits(nal, PPS)
    return PictureParameters(_bounded(bits.ue(), 255), _bounded(bits.ue(), 31))


def parse_slice_start(nal: bytes) -> SliceStart:
    """Parse the head of a slice (7.3.3) as far as it needs no SPS. Raises ThetaMalformed."""
    bits = Bits(nal[:HEADER_BYTES])
    bits.u(8)
    first = _bounded(bits.ue(), (MAX_SIDE // 16) ** 2)
    _bounded(bits.ue(), 9)
    return SliceStart(first, _bounded(bits.ue(), 255), bits.at)


def frame_num(nal: bytes, start: SliceStart, sps: SequenceParameters) -> int:
    """The slice's frame_num, modulo 2 ** log2_max_frame_num. Raises ThetaMalformed."""
    bits = Bits(nal[:HEADER_BYTES])
    bits.at = start.bits
    if sps.separate_planes:
        bits.u(2)
    return bits.u(sps.log2_max_frame_num)


def parameter_bits(nal: bytes, kind: int) -> Bits:
    """The bits of a parameter set, behind its NAL header. Raises ThetaMalformed when it is of another kind."""
    if not nal or len(nal) > MAX_PARAMETER_SET_BYTES or nal[0] & 0x1F != kind:
        raise ThetaMalformed("not an H.264 parameter set of the expected kind and size")
    bits = Bits(nal)
    bits.u(8)
    return bits


def _bounded(value: int, most: int) -> int:
    if value > most:
        raise ThetaMalformed(f"H.264 header says {value} where at most {most} is allowed")
    return value


def _skip_scaling_list(bits: Bits, size: int) -> None:
    last = following = 8
    for _ in range(size):
        if following:
            following = (last + bits.se()) % 256
        last = following or last
