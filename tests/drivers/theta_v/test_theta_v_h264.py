"""Pictures: parameter sets, gaps, and damage that must follow a stream until the next key picture."""

from __future__ import annotations

import contextlib

import av
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.theta_v.codec import h264
from drivers.theta_v.codec.access_units import NOT_STARTED, AccessUnit, AccessUnitTracker
from drivers.theta_v.codec.payload import Assembler, Flaw, Packet, Unit
from drivers.theta_v.errors import ThetaMalformed
from drivers.theta_v.simulator.packetiser import packetise
from tests.drivers.theta_v.pictures import KEY_INTERVAL, stream

PICTURES = stream(31)


def unit(data: bytes, flaws: Flaw = Flaw.NONE, *, follows_loss: bool = False) -> Unit:
    return Unit(data, flaws, 1, 2, follows_loss)


def track(units: list[Unit]) -> list[AccessUnit]:
    tracker = AccessUnitTracker()
    return [a for a in map(tracker.feed, units) if a is not None]


def without(data: bytes, *kinds: int) -> bytes:
    return b"".join(h264.START_CODE + data[n.start : n.end] for n in h264.split(data) if n.kind not in kinds)


def only(data: bytes, *kinds: int) -> bytes:
    return b"".join(h264.START_CODE + data[n.start : n.end] for n in h264.split(data) if n.kind in kinds)


@pytest.mark.parametrize(("width", "height"), [(64, 32), (1920, 960), (98, 50)])
def test_size_and_profile_are_read_from_the_encoders_parameter_sets(width: int, height: int) -> None:
    data = stream(1, width, height)[0]
    sps = next(n for n in h264.split(data) if n.kind == h264.SPS)
    found = h264.parse_sps(data[sps.start : sps.end])
    assert (found.width, found.height, found.profile) == (width, height, 66)


def test_a_clean_stream_passes_unchanged_and_clean() -> None:
    units = track([unit(p) for p in PICTURES])
    assert [u.data for u in units] == list(PICTURES)
    assert [u.raw for u in units] == list(PICTURES)
    assert not any(u.tainted or u.damaged for u in units)
    assert [u.keyframe for u in units] == [i % KEY_INTERVAL == 0 for i in range(31)]
    assert [u.sequence for u in units] == list(range(1, 32))
    assert {(u.width, u.height) for u in units} == {(64, 32)}


def test_a_key_picture_without_parameter_sets_gets_them_from_the_cache() -> None:
    bare = without(PICTURES[10], h264.SPS, h264.PPS)
    units = track([unit(PICTURES[0]), unit(bare)])
    assert units[1].raw == bare
    assert [n.kind for n in h264.split(units[1].data)][:2] == [h264.SPS, h264.PPS]
    assert units[1].data.endswith(bare)
    decoder = av.CodecContext.create("h264", "r")
    assert len(decoder.decode(av.Packet(units[1].data))) == 1


def test_parameter_sets_in_a_unit_of_their_own_join_the_picture_that_follows() -> None:
    sets, rest = only(PICTURES[0], h264.SPS, h264.PPS), without(PICTURES[0], h264.SPS, h264.PPS)
    units = track([unit(sets), unit(rest)])
    assert [u.raw for u in units] == [sets + rest]
    assert units[0].data == sets + rest
    assert not units[0].tainted


def test_joining_in_the_middle_yields_nothing_decodable_before_the_key_picture() -> None:
    units = track([unit(p) for p in PICTURES[5:15]])
    assert [u.decodable for u in units] == [False] * 5 + [True] * 5
    assert [u.taint for u in units] == [NOT_STARTED] * 5 + [""] * 5


@pytest.mark.parametrize("flaw", list(Flaw))
def test_damage_taints_everything_until_a_whole_key_picture(flaw: Flaw) -> None:
    flaws = {3: flaw, 10: flaw}
    units = track([unit(p, flaws.get(i, Flaw.NONE)) for i, p in enumerate(PICTURES)])
    assert [u.tainted for u in units] == [3 <= i < 20 for i in range(31)]
    assert [i for i, u in enumerate(units) if u.damaged] == [3, 10]
    assert str(flaw) in units[4].taint


@pytest.mark.parametrize("missing", [1, 4, 9, 12])
def test_a_missing_picture_is_noticed_by_its_frame_number(missing: int) -> None:
    tracker = AccessUnitTracker()
    units = [tracker.feed(unit(p)) for i, p in enumerate(PICTURES) if i != missing]
    following = units[missing]
    assert following is not None
    end_of_group = missing % KEY_INTERVAL == KEY_INTERVAL - 1
    assert following.tainted is not end_of_group
    assert tracker.lost == (0 if end_of_group else 1)


def test_a_picture_after_vanished_frames_is_tainted_and_a_key_picture_is_not() -> None:
    tracker = AccessUnitTracker()
    assert tracker.feed(unit(PICTURES[0])) is not None
    later = tracker.feed(unit(PICTURES[1], follows_loss=True))
    assert later is not None
    assert later.taint == "1 picture lost before it"
    key = tracker.feed(unit(PICTURES[10], follows_loss=True))
    assert key is not None
    assert not key.tainted
    assert tracker.lost == 2


def test_a_unit_that_lacks_its_beginning_or_holds_two_pictures_is_damaged() -> None:
    units = track([unit(PICTURES[0]), unit(PICTURES[1][7:])])
    assert units[1].taint == "a picture is damaged: its beginning is missing"
    units = track([unit(PICTURES[0]), unit(PICTURES[1] + PICTURES[3])])
    assert units[1].taint == "a picture is damaged: two pictures run into one another"


def test_slices_of_two_pictures_in_one_unit_are_damage() -> None:
    first = PICTURES[1]
    other = bytearray(PICTURES[3])
    at = h264.split(PICTURES[3])[0].start
    other[at + 1] = 0b01001100 | other[at + 1] & 0b00000011  # first_mb_in_slice = 1: not the first slice
    units = track([unit(PICTURES[0]), unit(first + bytes(other))])
    assert units[1].damaged


def test_frames_that_vanished_before_parameter_sets_of_their_own_unit_are_counted() -> None:
    sets, rest = only(PICTURES[10], h264.SPS, h264.PPS), without(PICTURES[10], h264.SPS, h264.PPS)
    tracker = AccessUnitTracker()
    for part in (unit(PICTURES[0]), unit(sets, follows_loss=True), unit(rest)):
        tracker.feed(part)
    assert tracker.lost == 1


@given(st.lists(st.sampled_from([b"\0", b"\1", b"\0\0\1", b"\0\0\0\1\x67", b"abc"]), max_size=60))
@settings(deadline=None)
def test_nal_units_are_found_wherever_the_search_is_cut(pieces: list[bytes]) -> None:
    data = b"".join(pieces)
    whole = h264.split(data)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(h264, "SEARCHED_AT_ONCE", 7)
        assert h264.split(data) == whole
    heads = [at + 3 for at in range(len(data) - 2) if data[at : at + 3] == b"\0\0\1"]
    assert [nal.start for nal in whole] == [at for at in heads if data[at:].split(b"\0\0\1")[0].rstrip(b"\0")]


def test_after_an_interruption_nothing_is_trusted_before_a_key_picture() -> None:
    tracker = AccessUnitTracker()
    tracker.feed(unit(PICTURES[0]))
    tracker.restart()
    later, key = tracker.feed(unit(PICTURES[1])), tracker.feed(unit(PICTURES[10]))
    assert later is not None
    assert key is not None
    assert (later.tainted, key.tainted) == (True, False)


def test_opens_stream_knows_the_head_of_a_key_picture_and_nothing_else() -> None:
    assert h264.opens_stream(PICTURES[0])
    assert h264.opens_stream(PICTURES[0][1:])
    assert not h264.opens_stream(PICTURES[1])
    assert not h264.opens_stream(PICTURES[0][2:])
    assert not h264.opens_stream(b"\0\0\0\1")


@given(st.data())
@settings(max_examples=60, deadline=None)
def test_a_picture_called_clean_is_whole_and_so_is_all_it_depends_on(data: st.DataObject) -> None:
    """Whatever packets are lost, with a status the host sees: clean means as the encoder made it."""
    packets: list[tuple[int, Packet]] = []
    for i, picture in enumerate(PICTURES):
        packets += [(i, (0, p)) for p in packetise(picture, i & 1, packet_bytes=400)]
    lost = data.draw(st.sets(st.integers(0, len(packets) - 1), max_size=12))
    assembler, tracker = Assembler(opens=h264.opens_stream), AccessUnitTracker()
    fed = [(-18, b"") if at in lost else packet for at, (_, packet) in enumerate(packets)]
    broken = {packets[at][0] for at in lost}
    for done in assembler.feed(0, fed):
        found = tracker.feed(done)
        if found is None or found.tainted:
            continue
        index = PICTURES.index(found.raw)
        group = index - index % KEY_INTERVAL
        assert not broken & set(range(group, index + 1))


@given(st.binary(max_size=200), st.sampled_from([b"", b"\0\0\1\x67", b"\0\0\1\x68", b"\0\0\1\x65", b"\0\0\1\x41"]))
@settings(deadline=None)
def test_garbage_pictures_raise_only_the_codecs_own_error_and_are_never_clean(raw: bytes, head: bytes) -> None:
    for parse in (h264.parse_sps, h264.parse_pps, h264.parse_slice_start, h264.split):
        with contextlib.suppress(ThetaMalformed):
            parse((head + raw)[3:] if head else raw)
    tracker = AccessUnitTracker()
    found = tracker.feed(unit(head + raw)) if head + raw else None
    assert found is None or found.tainted


@given(st.integers(0, len(PICTURES[0]) - 1), st.integers(0, 255))
@settings(deadline=None)
def test_a_key_picture_with_one_wrong_byte_never_raises(at: int, value: int) -> None:
    tracker = AccessUnitTracker()
    tracker.feed(unit(PICTURES[0][:at] + bytes([value]) + PICTURES[0][at + 1 :]))
    tracker.feed(unit(PICTURES[1]))
