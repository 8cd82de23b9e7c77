"""Packets from frames that get lost, repeated, reordered, cut short, or were never ours."""

from __future__ import annotations

import struct

from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.codec.assembler import PACKET_TIMEOUT_NS, Assembler, Packet, ReplyCollector
from drivers.rmp110.codec.frames import FEEDBACK_ID, Frame

COUNT = 5
SPACING_NS = 130_000
"""One frame on the bus."""


def packet(number: int, count: int = COUNT) -> list[Frame]:
    """Frames whose every word says which packet it belongs to."""
    return [Frame(FEEDBACK_ID + k, struct.pack(">II", number, number)) for k in range(count)]


@st.composite
def damaged_streams(draw: st.DrawFn) -> list[tuple[int, Frame]]:
    """Packets 20 ms apart or more; within each, frames lost, doubled, swapped and cut at will."""
    stream: list[tuple[int, Frame]] = []
    now_ns = 0
    for number in range(draw(st.integers(1, 8))):
        chosen = draw(st.lists(st.sampled_from(packet(number)), max_size=COUNT * 2) | st.permutations(packet(number)))
        if draw(st.booleans()):
            chosen = packet(number)
        for k, frame in enumerate(chosen):
            cut = Frame(frame.can_id, frame.data[: draw(st.sampled_from([8, 8, 8, 8, 3]))])
            stream.append((now_ns + k * SPACING_NS, cut))
        now_ns += draw(st.integers(PACKET_TIMEOUT_NS, 3 * PACKET_TIMEOUT_NS))
    return stream


@given(damaged_streams())
def test_a_packet_is_whole_and_never_mixed(stream: list[tuple[int, Frame]]) -> None:
    assembler = Assembler(COUNT)
    for stamp_ns, frame in stream:
        done = assembler.feed(stamp_ns, frame)
        if done:
            assert len(done.words) == 2 * COUNT
            assert len(set(done.words)) == 1
            assert done.last_ns - done.first_ns < PACKET_TIMEOUT_NS


@given(
    st.lists(st.tuples(st.integers(-(2**63), 2**63), st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8))))
)
def test_garbage_is_counted_and_never_raises(stream: list[tuple[int, Frame]]) -> None:
    assembler = Assembler(COUNT)
    collector = ReplyCollector()
    for stamp_ns, frame in stream:
        assembler.feed(stamp_ns, frame)
        collector.feed(stamp_ns, frame)
    unusable = [f for _, f in stream if not 0 <= f.can_id - FEEDBACK_ID < COUNT or len(f.data) != 8]
    assert assembler.damaged == len(unusable)
    collector.finish()


@given(st.integers(0, COUNT - 1), st.integers(0, 3))
def test_after_a_lost_frame_the_next_packet_is_whole_again(lost: int, extra: int) -> None:
    assembler = Assembler(COUNT)
    broken = packet(1)
    del broken[lost]
    stream = broken + [broken[-1]] * extra + packet(2)
    done = [assembler.feed(k * SPACING_NS, frame) for k, frame in enumerate(stream)]
    whole = [p for p in done if p]
    assert [p.words for p in whole] == [(2,) * (2 * COUNT)]


def test_a_packet_that_takes_too_long_is_dropped() -> None:
    assembler = Assembler(COUNT)
    frames = packet(1)
    assert assembler.feed(0, frames[0]) is None
    assert [assembler.feed(PACKET_TIMEOUT_NS + k, frame) for k, frame in enumerate(frames[1:])] == [None] * 4
    assert assembler.torn == 1


def test_halves_of_two_packets_do_not_make_one() -> None:
    assembler = Assembler(COUNT)
    for k, frame in enumerate(packet(1)[:3]):
        assert assembler.feed(k, frame) is None
    for k, frame in enumerate(packet(2)[3:]):
        assert assembler.feed(PACKET_TIMEOUT_NS + k, frame) is None


def test_the_end_of_a_late_packet_does_not_complete_the_beginning_of_another() -> None:
    assembler = Assembler(COUNT)
    late_ns = 10_000_000
    for k, frame in enumerate(packet(1)[:3]):
        assert assembler.feed(k * SPACING_NS, frame) is None
    for k, frame in enumerate(packet(2)[3:]):
        assert assembler.feed(late_ns + k * SPACING_NS, frame) is None
    assert assembler.torn == 1


def test_a_reply_of_unknown_length_ends_with_quiet() -> None:
    collector = ReplyCollector()
    for k, frame in enumerate(packet(1, 11)):
        collector.feed(k * SPACING_NS, frame)
    last_ns = 10 * SPACING_NS
    assert not collector.quiet(last_ns + collector.QUIET_NS - 1)
    assert collector.quiet(last_ns + collector.QUIET_NS)
    assert collector.finish() == Packet(0, last_ns, (1,) * 22)


def test_a_reply_with_a_gap_tells_nothing() -> None:
    collector = ReplyCollector()
    for frame in packet(1, 11)[:4] + packet(1, 11)[5:]:
        collector.feed(0, frame)
    assert collector.started
    assert collector.finish() is None
