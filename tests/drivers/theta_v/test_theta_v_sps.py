"""SPS told not to reorder: checked by the decoder, for encoders that say much, little or the contrary."""

from __future__ import annotations

import contextlib
from fractions import Fraction

import av
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.theta_v.codec import h264
from drivers.theta_v.codec.access_units import AccessUnitTracker
from drivers.theta_v.codec.payload import Flaw, Unit
from drivers.theta_v.codec.sps_rewrite import BitWriter, rewritten, without_reordering
from drivers.theta_v.errors import ThetaMalformed
from tests.drivers.theta_v.pictures import stream


def encoded(extra: str, profile: str = "high", pix_fmt: str = "yuv420p") -> list[bytes]:
    context = av.CodecContext.create("libx264", "w")
    context.width, context.height, context.pix_fmt = 64, 32, pix_fmt
    context.time_base, context.framerate = Fraction(1, 30), Fraction(30)
    context.options = {"profile": profile, "x264-params": f"repeat-headers=1:annexb=1:log-level=error:{extra}"}
    units: list[bytes] = []
    rng = np.random.default_rng(0)
    for index in range(12):
        frame = av.VideoFrame.from_ndarray(rng.integers(0, 255, (32, 64, 3), np.uint8), format="rgb24")
        frame = frame.reformat(format=pix_fmt)
        frame.pts = index
        units += map(bytes, context.encode(frame))
    return units + [bytes(packet) for packet in context.encode(None)]


@pytest.mark.parametrize("extra", ["bframes=3:b-pyramid=none", "bframes=3:b-pyramid=normal", "bframes=0:slices=3"])
def test_pictures_out_of_order_and_in_slices_are_taken_for_neither_loss_nor_damage(extra: str) -> None:
    tracker = AccessUnitTracker()
    units = [tracker.feed(Unit(data, Flaw.NONE, 1, 1)) for data in encoded(extra)]
    assert [unit.taint for unit in units if unit is not None] == [""] * len(units)
    assert tracker.lost == 0


def test_of_pictures_out_of_order_only_one_that_others_build_upon_is_missed() -> None:
    pictures = encoded("bframes=1:b-pyramid=none:keyint=60:b-adapt=0")
    for missing, picture in enumerate(pictures[1:-1], 1):
        nal = next(n for n in h264.split(picture) if n.kind == h264.SLICE)
        tracker = AccessUnitTracker()
        units = [tracker.feed(Unit(data, Flaw.NONE, 1, 1)) for at, data in enumerate(pictures) if at != missing]
        tainted = any(unit.tainted for unit in units if unit is not None)
        assert tainted == bool(nal.reference)


def sps_of(data: bytes) -> bytes:
    nal = next(n for n in h264.split(data) if n.kind == h264.SPS)
    return data[nal.start : nal.end]


def without_vui(sps: bytes) -> bytes:
    bits = h264.parameter_bits(sps, h264.SPS)
    h264.read_sps(bits)
    writer = BitWriter()
    writer.u(bits.at, bits.prefix(bits.at))
    writer.u(1, 0)
    return writer.nal()


ENCODERS = [
    ("bframes=0", "baseline", "yuv420p"),
    ("bframes=3", "high", "yuv420p"),
    ("bframes=0:nal-hrd=cbr:vbv-maxrate=500:vbv-bufsize=500:bitrate=500", "high", "yuv420p"),
    ("bframes=0:sar=7/5:overscan=show:videoformat=pal:colorprim=bt709:chromaloc=1", "high", "yuv420p"),
    ("bframes=0", "high444", "yuv444p"),
]


@pytest.mark.parametrize(("extra", "profile", "pix_fmt"), ENCODERS)
@pytest.mark.parametrize("bare", [False, True])
def test_a_rewritten_sps_means_the_same_but_for_reordering(extra: str, profile: str, pix_fmt: str, bare: bool) -> None:
    sps = sps_of(encoded(extra, profile, pix_fmt)[0])
    if bare:
        sps = without_vui(sps)
    new = without_reordering(sps)
    assert h264.parse_sps(new) == h264.parse_sps(sps)
    assert without_reordering(new) == new, "nothing is left to change"
    if bare:
        assert new != sps


def test_pictures_come_out_of_a_decoder_at_once_with_the_rewritten_sps() -> None:
    """Without the rewrite this stream is held back: its SPS is silent about reordering."""
    units = list(stream(8))
    old = sps_of(units[0])
    silent = units[0].replace(old, without_vui(old))
    for data, expected in ((rewritten(silent), 1), (rewritten(units[0]), 1)):
        decoder = av.CodecContext.create("h264", "r")
        decoder.thread_type = "NONE"
        counts = [len(decoder.decode(av.Packet(unit))) for unit in [data, *units[1:]]]
        assert counts == [expected] * 8


def test_an_access_unit_without_sps_is_left_alone() -> None:
    units = stream(2)
    assert rewritten(units[1]) is units[1]


@given(st.binary(max_size=80), st.booleans())
@settings(deadline=None)
def test_garbage_raises_only_the_codecs_own_error(raw: bytes, looks_real: bool) -> None:
    with contextlib.suppress(ThetaMalformed):
        without_reordering((b"\x67\x42\x40\x33" if looks_real else b"\x67") + raw)
    with contextlib.suppress(ThetaMalformed):
        rewritten(b"\0\0\1\x67" + raw)


@given(st.integers(0, 27), st.integers(0, 255))
@settings(deadline=None)
def test_an_sps_with_one_wrong_byte_raises_only_the_codecs_own_error(at: int, value: int) -> None:
    sps = bytearray(sps_of(stream(1)[0]))
    sps[at % len(sps)] = value
    with contextlib.suppress(ThetaMalformed):
        without_reordering(bytes(sps))


@given(st.lists(st.tuples(st.integers(1, 32), st.integers(0, 2**32 - 1)), max_size=30))
@settings(deadline=None)
def test_what_the_writer_wrote_the_reader_reads(fields: list[tuple[int, int]]) -> None:
    writer = BitWriter()
    writer.u(8, 0x67)
    for count, value in fields:
        writer.u(count, value & ((1 << count) - 1))
        writer.ue(value)
    raw = writer.nal()
    assert b"\0\0\1" not in raw
    assert b"\0\0\0" not in raw
    bits = h264.Bits(raw)
    assert bits.u(8) == 0x67
    for count, value in fields:
        assert bits.u(count) == value & ((1 << count) - 1)
        assert bits.ue() == value
