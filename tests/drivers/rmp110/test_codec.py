"""The tables against the vendor's own masks, the last check before the wire, and the scaling."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.codec.commands import POLL, ZERO_MOTION, configure, motion, request_mode
from drivers.rmp110.codec.faults import fault_texts, mcu_fault_texts
from drivers.rmp110.codec.feedback import COMPACT, COMPACT_BITMAPS, FACTORY_BITMAPS, Layout, split_frames
from drivers.rmp110.codec.feedback_words import WORDS
from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame, unpack_words, word_to_float
from drivers.rmp110.codec.motion import MotionScale, normalise
from drivers.rmp110.codec.parameters import PARAMETERS, RMP110_STORED, Kind, ModeRequest, OperationalState, Stored
from drivers.rmp110.codec.whitelist import forbidden
from drivers.rmp110.errors import RmpBadCommand

words = st.integers(0, 0xFFFFFFFF)
frames = st.builds(
    Frame,
    st.one_of(st.sampled_from([MOTION_ID, CONFIG_ID, 0x502, 0x600]), st.integers(0, 0x7FF)),
    st.one_of(
        st.binary(max_size=8),
        st.builds(lambda a, b: struct.pack(">II", a, b), st.integers(0, 40), st.one_of(st.integers(0, 40), words)),
        st.builds(lambda a, b: struct.pack(">ff", a, b), st.floats(width=32), st.floats(width=32)),
    ),
)


def mask(bitmap: int, *kinds: Kind) -> int:
    return sum(1 << word.bit for word in WORDS if word.bitmap == bitmap and word.kind in kinds)


def test_word_types_are_the_vendors_masks() -> None:
    assert [mask(n, Kind.FLOAT) for n in (1, 2, 3)] == [0xFF7FF900, 0x3FFFFFFF, 0x007FFFF2]
    assert [mask(n, Kind.HEX) for n in (1, 2, 3)] == [0x008004FF, 0xC0000000, 0xF0800001]
    assert [mask(n, Kind.IP) for n in (1, 2, 3)] == [0, 0, 0x0D000000]


def test_names_are_unique_and_all_96_words_make_48_frames() -> None:
    everything = Layout.of(FACTORY_BITMAPS)
    assert len({word.name for word in WORDS}) == len(everything.words) == 96
    assert everything.frame_count == 48
    assert split_frames([0] * 96)[-1].can_id == 0x531


def test_the_compact_set_is_22_words_in_11_frames() -> None:
    assert (len(COMPACT.words), COMPACT.frame_count) == (22, 11)
    assert Layout.of((0, 0, 0, 0)).frame_count == 0


def test_an_odd_last_word_is_followed_by_zero() -> None:
    assert split_frames([1, 2, 3])[-1] == Frame(0x503, struct.pack(">II", 3, 0))


@given(st.tuples(words, words, words, words), st.data())
def test_encoding_and_decoding_any_layout_are_inverse(bitmaps: tuple[int, int, int, int], data: st.DataObject) -> None:
    layout = Layout.of(bitmaps)
    sent = data.draw(st.lists(words, min_size=len(layout.words), max_size=len(layout.words)))
    values = layout.decode(sent)
    assert len(values) == len(sent)
    if all(math.isfinite(value) for value in values.values()):
        assert layout.encode(values) == tuple(sent)


def test_parameter_table_follows_the_command_numbers() -> None:
    assert [parameter.number for parameter in PARAMETERS] == list(range(1, 21))
    assert all(p.accepts(p.word(p.factory)) for p in PARAMETERS)
    assert all(p.accepts(p.word(p.maximum)) for p in PARAMETERS)
    assert not PARAMETERS[0].accepts(PARAMETERS[0].word(8.1))
    assert not PARAMETERS[0].accepts(0x7FC00000), "NaN"


def test_differences_are_found_bit_by_bit() -> None:
    stored = Stored.of(RMP110_STORED)
    assert stored.differing(RMP110_STORED) == {}
    changed = list(stored.words)
    changed[0] += 1
    assert list(Stored(tuple(changed)).differing(RMP110_STORED)) == ["max_velocity"]


def test_unknown_states_are_unknown() -> None:
    assert OperationalState.of(4) is OperationalState.TRACTOR
    assert OperationalState.of(7) is OperationalState.UNKNOWN
    assert OperationalState.of(0xFFFFFFFF) is OperationalState.UNKNOWN


@given(frames)
def test_no_forbidden_frame_passes(frame: Frame) -> None:
    if forbidden(frame) is not None:
        return
    assert len(frame.data) == 8
    assert frame.can_id in (MOTION_ID, CONFIG_ID)
    high, low = unpack_words(frame.data)
    if frame.can_id == MOTION_ID:
        assert abs(word_to_float(high)) <= 1
        assert abs(word_to_float(low)) <= 1
        return
    assert high not in (13, 14, 15, 16, 35, 36), "network settings, reset, continuous data"
    assert high <= 34
    if high == 32:
        assert low in (ModeRequest.STANDBY, ModeRequest.TRACTOR)
    if 1 <= high <= 11:
        assert math.isfinite(word_to_float(low))
    if high == 17:
        assert low != 0


@pytest.mark.parametrize(
    "frame",
    [
        POLL,
        ZERO_MOTION,
        motion(1.0, -1.0),
        request_mode(ModeRequest.TRACTOR),
        request_mode(ModeRequest.STANDBY),
        *(configure(n, value) for n, value in ((1, 0.5), (4, 1.0), (10, 0.481224), (11, 24.2667), (12, 0x101))),
        *(configure(17 + n, word) for n, word in enumerate(COMPACT_BITMAPS)),
        configure(30, 1),
    ],
)
def test_routine_frames_pass(frame: Frame) -> None:
    assert forbidden(frame) is None


@pytest.mark.parametrize(
    "frame",
    [
        *(request_mode(m) for m in (ModeRequest.DISABLE, ModeRequest.POWERDOWN, ModeRequest.DTZ, ModeRequest.BALANCE)),
        *(configure(n, 1) for n in (13, 14, 15, 16, 31, 34, 35, 36, 99)),
        configure(1, 8.1),
        configure(1, math.nan),
        configure(12, 0x8),
        configure(17, 0),
        motion(1.0001, 0),
        motion(0, math.nan),
        motion(math.inf, 0),
        Frame(MOTION_ID, bytes(7)),
        Frame(0x600, bytes(8)),
        Frame(0x413, bytes(8)),
    ],
)
def test_dangerous_frames_do_not(frame: Frame) -> None:
    assert forbidden(frame)


limits = st.floats(0.01, 9)
scales = st.builds(MotionScale, limits, limits, limits, limits, st.floats(0.5, 2))


@given(st.floats(), st.floats(), scales)
def test_any_velocity_is_refused_or_within_every_limit(v: float, w: float, scale: MotionScale) -> None:
    if not (math.isfinite(v) and math.isfinite(w)):
        with pytest.raises(RmpBadCommand):
            normalise(v, w, scale)
        return
    command = normalise(v, w, scale)
    assert forbidden(motion(command.velocity, command.yaw_rate)) is None
    assert abs(command.v) <= min(scale.max_v_mps, scale.stored_v_mps) * (1 + 1e-9)
    assert abs(command.w) <= min(scale.max_w_rps, scale.stored_w_rps / scale.track_ratio) * (1 + 1e-9)
    assert command.v * v >= 0
    assert command.w * w >= 0
    assert command.yaw_rate * w <= 0, "clockwise-positive on the wire"


def test_standing_still_is_eight_zero_bytes() -> None:
    command = normalise(-0.0, 0.0, MotionScale(0.5, 1.0, 0.5, 1.0))
    assert motion(command.velocity, command.yaw_rate) == ZERO_MOTION


def test_a_base_with_another_stored_track_is_told_another_yaw_rate() -> None:
    command = normalise(0.0, 0.5, MotionScale(0.5, 1.0, 0.5, 1.0, track_ratio=0.481224 / 0.569976))
    assert command.yaw_rate == pytest.approx(-0.5 * 0.481224 / 0.569976)
    assert command.w == pytest.approx(0.5)


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan, math.inf])
def test_limits_that_are_none_are_refused(limit: float) -> None:
    with pytest.raises(RmpBadCommand):
        MotionScale(limit, 1.0, 0.5, 1.0)


@pytest.mark.parametrize(
    ("fault_words", "text"),
    [
        ((0x40, 0, 0, 0), "architecture: kill switch active"),
        ((0x80 << 12, 0, 0, 0), "critical: velocity control failed"),
        ((0, 0x10, 0, 0), "communication: bad motion command received"),
        ((0, 0x1 << 16, 0, 0), "internal: default condition hit"),
        ((0, 0, 0x200, 0), "sensors: 12 V monitor"),
        ((0, 0, 0x400 << 16, 0), "balance sensor: pitch estimates differ"),
        ((0, 0, 0, 0x20), "motor controllers: motor controller 1 failed"),
        ((0, 0, 0, 0x20000), "motor controllers: data of motor controller 1 missing"),
        ((0, 0x80000000, 0, 0), "internal: unknown bit 0x8000"),
    ],
)
def test_a_fault_bit_reads_as_words(fault_words: tuple[int, ...], text: str) -> None:
    assert fault_texts(fault_words) == (text,)


@given(st.tuples(words, words, words, words))
def test_every_fault_bit_is_told(fault_words: tuple[int, ...]) -> None:
    assert len(fault_texts(fault_words)) == sum(word.bit_count() for word in fault_words)


def test_motor_controller_words_name_their_unit() -> None:
    assert mcu_fault_texts(1, 0x80) == ("motor controller 1: empty battery",)
