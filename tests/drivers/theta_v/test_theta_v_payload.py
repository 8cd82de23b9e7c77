"""The payload assembler against the simulator's packetiser, and against everything a bus can do to it."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.theta_v.codec.payload import (
    EOF,
    EOH,
    ERR,
    HABIT_UNITS,
    MAX_UNIT_BYTES,
    USES_EOF,
    USES_FID,
    Assembler,
    Flaw,
    Packet,
    Quality,
    Unit,
)
from drivers.theta_v.simulator.packetiser import packetise
from drivers.theta_v.transport.microframes import NOTHING

SIZES = (1, 3069, 3070, 3071, 6140, 2 << 20)
PREAMBLE = packetise(b"swallowed while joining", 1)


def assemble(packets: list[bytes] | list[Packet], max_bytes: int = MAX_UNIT_BYTES) -> list[Unit]:
    """Feed a stream that was joined properly: the unit before it is discarded by the start rule."""
    assembler = Assembler(max_bytes)
    assert assembler.feed(0, [(0, p) for p in PREAMBLE]) == []
    tagged = [p if isinstance(p, tuple) else (0, p) for p in packets]
    return assembler.feed(1, tagged)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("header", [2, 6, 8, 12, 20])
@pytest.mark.parametrize("end_in_data", [True, False])
def test_what_was_cut_into_packets_comes_back_byte_for_byte(size: int, header: int, end_in_data: bool) -> None:
    unit = bytes(i * 31 % 251 for i in range(min(size, 4096))) * (size // min(size, 4096) + 1)
    unit = unit[:size]
    packets = packetise(unit, 0, header=bytes(header - 2), end_in_data=end_in_data)
    assert all(len(p) <= 3072 for p in packets)
    units = assemble(packets)
    assert [u.data for u in units] == [unit]
    assert units[0].quality is Quality.CLEAN


def test_the_packetiser_writes_what_the_gadget_kernel_writes() -> None:
    packets = packetise(bytes(3071), 1)
    assert packets == [b"\x02\x81" + bytes(3070), b"\x02\x83\x00"]


def test_a_frame_without_end_is_published_as_suspect_when_the_next_begins() -> None:
    first = packetise(b"a" * 4000, 0)
    first[-1] = bytes([2, first[-1][1] & ~EOF]) + first[-1][2:]
    units = assemble(first + packetise(b"b", 1))
    assert [(u.data, u.quality) for u in units] == [(b"a" * 4000, Quality.SUSPECT), (b"b", Quality.CLEAN)]


def test_empty_and_header_only_packets_change_nothing() -> None:
    packets = packetise(b"a" * 4000, 0)
    idle = [b"", b"\x02\x80", b"\x02\x81", b""]
    units = assemble([*packets, *idle, *packetise(b"b", 1)])
    assert [(u.data, u.quality, u.follows_loss) for u in units] == [
        (b"a" * 4000, Quality.CLEAN, False),
        (b"b", Quality.CLEAN, False),
    ]


@pytest.mark.parametrize("status", [-18, -71, 3])
def test_a_lost_packet_damages_its_frame(status: int) -> None:
    packets: list[Packet] = [(0, p) for p in packetise(b"a" * 9000, 0)]
    packets[1] = (status, b"")
    (unit,) = assemble(packets)
    assert unit.quality is Quality.DAMAGED
    assert unit.flaws == Flaw.LOST_PACKET


def test_a_packet_lost_just_before_an_empty_end_of_frame_damages_its_frame() -> None:
    packets: list[Packet] = [(0, p) for p in packetise(b"a" * 6000, 0, end_in_data=False)]
    packets[-2] = (-18, b"")
    (unit,) = assemble(packets)
    assert unit.quality is Quality.DAMAGED


@pytest.mark.parametrize("bad", [b"\x02", b"\x00\x80abc", b"\x01\x80abc", b"\x09\x80abc"])
def test_a_packet_with_an_impossible_header_damages_its_frame(bad: bytes) -> None:
    packets = packetise(b"a" * 6000, 0)
    (unit,) = assemble([packets[0], bad, *packets[1:]])
    assert unit.flaws == Flaw.BAD_HEADER


def test_the_cameras_own_error_bit_damages_its_frame() -> None:
    packets = packetise(b"a" * 6000, 0)
    packets[0] = bytes([2, packets[0][1] | ERR]) + packets[0][2:]
    (unit,) = assemble(packets)
    assert unit.flaws == Flaw.DEVICE_ERROR
    assert str(unit.flaws) == "camera reports an error"


def test_a_gap_across_a_frame_boundary_damages_both_frames() -> None:
    first: list[Packet] = [(0, p) for p in packetise(b"a" * 6000, 0)]
    second: list[Packet] = [(0, p) for p in packetise(b"b" * 6000, 1)]
    units = assemble([*first[:-1], (-18, b""), (-18, b""), *second[1:]])
    assert [u.quality for u in units] == [Quality.DAMAGED, Quality.DAMAGED]


def test_the_same_frame_bit_after_an_end_tells_of_vanished_frames() -> None:
    units = assemble([*packetise(b"a", 0), *packetise(b"c", 0), *packetise(b"d", 1)])
    assert [u.follows_loss for u in units] == [False, True, False]


def test_a_unit_is_cut_at_the_limit_and_memory_stays_bounded() -> None:
    endless: list[bytes] = [bytes([2, EOH]) + bytes(3070)] * 100
    units = assemble([*endless, *packetise(b"b", 1)], max_bytes=10_000)
    assert [len(u.data) for u in units] == [10_000, 1]
    assert Flaw.OVERFLOW in units[0].flaws


def test_at_the_start_everything_is_discarded_until_a_frame_boundary() -> None:
    late = [(0, p) for p in packetise(b"x" * 9000, 0)][1:]
    by_end = Assembler()
    assert by_end.feed(0, late) == []
    assert [u.data for u in by_end.feed(1, [(0, p) for p in packetise(b"a", 1)])] == [b"a"]
    by_toggle = Assembler()
    assert by_toggle.feed(0, late[:1]) == []
    assert [u.data for u in by_toggle.feed(1, [(0, p) for p in packetise(b"a", 1)])] == [b"a"]
    assert by_toggle.discarded_packets == 1


def test_a_first_payload_that_visibly_opens_a_frame_is_kept() -> None:
    packets: list[Packet] = [(-18, b""), *((0, p) for p in packetise(b"head" + bytes(4000), 0))]
    (unit,) = Assembler(opens=lambda data: bytes(data[:4]) == b"head").feed(7, packets)
    assert unit.quality is Quality.CLEAN
    assert Assembler(opens=lambda _: False).feed(7, packets) == []


def test_stamps_are_those_of_the_batches_with_the_first_and_the_last_byte() -> None:
    assembler = Assembler()
    assembler.feed(1, [(0, p) for p in PREAMBLE])
    packets = packetise(b"a" * 9000, 0)
    assembler.feed(10, [(0, packets[0])])
    assembler.feed(20, [(0, packets[1])])
    (unit,) = assembler.feed(30, [(0, packets[2])])
    assert (unit.first_ns, unit.stamp_ns) == (10, 30)


def test_an_empty_microframe_inside_a_frame_tells_of_a_vanished_packet() -> None:
    packets: list[Packet] = [(0, p) for p in packetise(b"a" * 9000, 0)]
    (unit,) = assemble([*packets[:1], NOTHING, *packets[2:]])
    assert unit.flaws == Flaw.PAUSE
    split_end: list[Packet] = [(0, p) for p in packetise(b"a" * 3070, 0, end_in_data=False)]
    (unit,) = assemble([split_end[0], NOTHING, split_end[1]])
    assert unit.flaws == Flaw.PAUSE


def test_empty_microframes_between_frames_tell_nothing() -> None:
    a, b = ([(0, p) for p in packetise(x * 9000, i)] for i, x in enumerate((b"a", b"b")))
    assert [u.flaws for u in assemble([NOTHING, *a, NOTHING, *b, NOTHING])] == [Flaw.NONE, Flaw.NONE]


def test_a_camera_that_always_pauses_is_not_judged_by_it() -> None:
    frames = [[(0, p) for p in packetise(b"a" * 9000, i & 1)] for i in range(200)]
    paused = [[f[0], NOTHING, *f[1:]] for f in frames]
    units = assemble([packet for frame in paused for packet in frame])
    assert [bool(u.flaws) for u in units] == [True] * (HABIT_UNITS - 1) + [False] * (201 - HABIT_UNITS)
    calm = assemble([packet for at, f in enumerate(frames) for packet in (f if at % 10 else paused[at])])
    assert sum(bool(u.flaws) for u in calm) == 20, "one that pauses now and then is"


def test_a_camera_that_announces_no_end_of_frame_is_judged_by_the_toggle_alone() -> None:
    frames = [packetise(bytes([i]) * 4000, i & 1) for i in range(4)]
    endless: list[Packet] = [(0, bytes([p[0], p[1] & ~EOF]) + p[2:]) for frame in frames for p in frame]
    held_to_its_word = Assembler(framing=USES_FID | USES_EOF).feed(0, endless)
    assert [u.quality for u in held_to_its_word] == [Quality.SUSPECT] * 2
    assert [u.quality for u in Assembler(framing=USES_FID).feed(0, endless)] == [Quality.CLEAN] * 2


def test_a_camera_that_toggles_no_frame_bit_is_judged_by_the_end_alone() -> None:
    still: list[Packet] = [(0, p) for i in range(4) for p in packetise(bytes([i]) * 4000, 0)]
    assert [u.follows_loss for u in Assembler(framing=USES_FID | USES_EOF).feed(0, still)] == [True] * 3
    units = Assembler(framing=USES_EOF).feed(0, still)
    assert [(u.data[0], u.quality, u.follows_loss) for u in units] == [(i, Quality.CLEAN, False) for i in (1, 2, 3)]


units_lists = st.lists(st.binary(min_size=1, max_size=60), min_size=1, max_size=12)


@given(units_lists, st.booleans(), st.data())
@settings(deadline=None)
def test_any_loss_with_status_yields_only_identical_or_marked_units(
    sent: list[bytes], end_in_data: bool, data: st.DataObject
) -> None:
    packets: list[Packet] = []
    for i, unit in enumerate(sent):
        packets += [(0, p) for p in packetise(unit, i & 1, packet_bytes=12, end_in_data=end_in_data)]
    lost = data.draw(st.lists(st.booleans(), min_size=len(packets), max_size=len(packets)))
    packets = [(-18, b"") if gone else p for gone, p in zip(lost, packets, strict=True)]
    for got in assemble(packets):
        assert got.quality is not Quality.CLEAN or got.data in sent


@given(st.lists(st.tuples(st.sampled_from([0, 0, 0, -18]), st.binary(max_size=40)), max_size=60))
@settings(deadline=None)
def test_garbage_neither_raises_nor_grows(packets: list[Packet]) -> None:
    assembler = Assembler(max_bytes=100)
    for unit in assembler.feed(0, packets):
        assert 0 < len(unit.data) <= 100
