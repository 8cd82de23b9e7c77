"""An SPS that tells decoders not to wait: `max_num_reorder_frames` = 0, for players that obey nothing else.

The camera never reorders pictures (fact sheet section 2.1), but a decoder that is not told so in the VUI may
hold back as many pictures as the level allows: a browser's does. Syntax: ITU-T H.264, 7.3.2.1.1 and E.1.1.
"""

from __future__ import annotations

from drivers.theta_v.codec import h264
from drivers.theta_v.codec.h264 import Bits
from drivers.theta_v.errors import ThetaMalformed

EXTENDED_SAR = 255
MAX_HRD_ENTRIES = 32
NO_LIMIT_BYTES, NO_LIMIT_BITS, MV_RANGE_LOG2 = 0, 0, 16  # "not said", and the widest range there is
LARGEST_UE = (1 << 32) - 2


class BitWriter:
    def __init__(self) -> None:
        self._value = 0
        self._count = 0

    def u(self, count: int, value: int) -> None:
        self._value = self._value << count | value
        self._count += count

    def ue(self, value: int) -> None:
        length = (value + 1).bit_length()
        self.u(2 * length - 1, value + 1)

    def nal(self) -> bytes:
        """With the stop bit, padding and emulation prevention (7.3.1, 7.4.1.1)."""
        self.u(1, 1)
        self.u(-self._count % 8, 0)
        out = bytearray()
        zeros = 0
        for octet in self._value.to_bytes(self._count // 8, "big"):
            if zeros == 2 and octet <= 3:
                out.append(3)
                zeros = 0
            out.append(octet)
            zeros = zeros + 1 if octet == 0 else 0
        return bytes(out)


def without_reordering(sps: bytes) -> bytes:
    """The same SPS (header byte included) with `max_num_reorder_frames` = 0; itself if it says so already.

    Raises ThetaMalformed for what is no SPS.
    """
    bits = h264.parameter_bits(sps, h264.SPS)
    _, references = h264.read_sps(bits)
    start = bits.at
    writer = BitWriter()
    if not bits.u(1):
        writer.u(start, bits.prefix(start))
        writer.u(1, 1)
        writer.u(8, 0)  # aspect ratio, overscan, signal, chroma place, timing, two HRDs, picture structure
    else:
        _skip_vui(bits)
        restricted_at = bits.at
        if bits.u(1):
            motion_over_edges, *rest = bits.u(1), *(_bounded(bits.ue()) for _ in range(4))
            if bits.ue() == 0:
                return sps
            buffering = bits.ue()
            writer.u(restricted_at, bits.prefix(restricted_at))
            _restrict(writer, motion_over_edges, rest, min(max(buffering, references), 16))
            return writer.nal()
        writer.u(restricted_at, bits.prefix(restricted_at))
    _restrict(writer, 1, [NO_LIMIT_BYTES, NO_LIMIT_BITS, MV_RANGE_LOG2, MV_RANGE_LOG2], references)
    return writer.nal()


def rewritten(data: bytes) -> bytes:
    """An access unit (Annex B) with each of its SPS told not to reorder; itself if there is nothing to change.

    For `AccessUnit.data`, of which only key pictures carry an SPS; anything else comes back as it is. Whatever
    else stands in the SPS stays, and all other NAL units stay byte for byte. Raises ThetaMalformed for an SPS
    that is none, which a picture called clean never carries.
    """
    pieces: list[bytes] = []
    done = 0
    for nal in h264.split(data):
        if nal.kind == h264.SPS:
            old = data[nal.start : nal.end]
            new = without_reordering(old)
            if new != old:
                pieces += [data[done : nal.start], new]
                done = nal.end
    return b"".join((*pieces, data[done:])) if pieces else data


def _restrict(writer: BitWriter, motion_over_edges: int, rest: list[int], buffering: int) -> None:
    writer.u(1, 1)
    writer.u(1, motion_over_edges)
    for value in (*rest, 0, buffering):
        writer.ue(value)


def _skip_vui(bits: Bits) -> None:
    """Up to bitstream_restriction_flag."""
    if bits.u(1) and bits.u(8) == EXTENDED_SAR:
        bits.u(32)
    if bits.u(1):
        bits.u(1)
    if bits.u(1):
        bits.u(4)
        if bits.u(1):
            bits.u(24)
    if bits.u(1):
        bits.ue()
        bits.ue()
    if bits.u(1):
        bits.u(65)
    nal_hrd = bits.u(1)
    if nal_hrd:
        _skip_hrd(bits)
    vcl_hrd = bits.u(1)
    if vcl_hrd:
        _skip_hrd(bits)
    if nal_hrd or vcl_hrd:
        bits.u(1)
    bits.u(1)


def _skip_hrd(bits: Bits) -> None:
    entries = bits.ue() + 1
    if entries > MAX_HRD_ENTRIES:
        raise ThetaMalformed(f"H.264 parameter set with {entries} buffer models")
    bits.u(8)
    for _ in range(entries):
        bits.ue()
        bits.ue()
        bits.u(1)
    bits.u(20)


def _bounded(value: int) -> int:
    if value > LARGEST_UE:
        raise ThetaMalformed("H.264 parameter set holds an impossible number")
    return value
