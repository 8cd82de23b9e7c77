from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.telepresence.frames import HEADER, VERSION, Flags, Frame
from ghal360_robot.telepresence.video_queue import MAX_AGE_NS, MAX_BYTES, MAX_FRAMES, RETRY_NS, VideoQueue

MS = 1_000_000


def frame(sequence: int, stamp_ns: int, *, key: bool = False, size: int = 10) -> Frame:
    return Frame(b"\0" * size, stamp_ns, sequence, 64, 32, key)


def test_nothing_is_sent_before_a_key_picture() -> None:
    queue = VideoQueue()
    assert not queue.offer(frame(1, 0), 0)
    assert queue.take(0) is None
    assert queue.offer(frame(2, 0, key=True), 0)
    sent = queue.take(0)
    assert sent is not None
    assert sent == (frame(2, 0, key=True), Flags.GAP)


def test_a_slow_connection_loses_whole_groups() -> None:
    queue = VideoQueue()
    queue.offer(frame(0, 0, key=True), 0)
    for k in range(1, 30):
        queue.offer(frame(k, k * 33 * MS), k * 33 * MS)
    assert len(queue) == 0
    assert queue.dropped == 30
    now = 30 * 33 * MS
    assert queue.offer(frame(30, now, key=True), now)
    assert queue.take(now) == (frame(30, now, key=True), Flags.GAP)


def test_what_was_dropped_is_dropped_up_to_the_next_key_picture() -> None:
    queue = VideoQueue()
    queue.offer(frame(0, 0, key=True), 0)
    for k in range(1, MAX_FRAMES + 1):
        queue.offer(frame(k, 0), 0)
    assert not queue.offer(frame(MAX_FRAMES + 1, 0), 0)
    assert queue.take(0) is None


def test_bytes_are_bounded() -> None:
    queue = VideoQueue()
    queue.offer(frame(0, 0, key=True, size=MAX_BYTES - 5), 0)
    assert not queue.offer(frame(1, 0), 0)


def through(link_bytes_per_s: float, buffer_s: float, seconds: float) -> tuple[list[float], int]:
    """Delays (s) of the pictures shown, and how many, of 40 Mb/s at 30 Hz over a link with a big buffer."""
    queue, delays = VideoQueue(), []
    on_link: list[tuple[float, Frame]] = []
    free_at = 0.0
    for ms in range(round(1000 * seconds)):
        now = ms * MS
        while on_link and on_link[0][0] <= ms / 1000:
            at, shown = on_link.pop(0)
            delays.append(at - shown.stamp_ns / 1e9)
            queue.shown(shown.sequence, now)
        if ms % 33 == 0:
            sequence = ms // 33
            queue.offer(frame(sequence, now, key=sequence % 30 == 0, size=167_000), now)
        while taken := queue.take(now):
            free_at = max(free_at, ms / 1000) + len(taken[0].data) / link_bytes_per_s
            on_link.append((free_at + buffer_s, taken[0]))
    return delays, queue.dropped


def test_a_slow_link_with_big_buffers_does_not_get_later_and_later() -> None:
    delays, dropped = through(1e6, 0.02, 20.0)
    assert len(delays) >= 40
    assert max(delays) < 0.9
    assert dropped > 300


@pytest.mark.parametrize("delay_s", [0.02, 0.1, 0.25])
def test_a_fast_link_loses_nothing_however_long_it_is_once_it_is_known(delay_s: float) -> None:
    delays, dropped = through(2e7, delay_s, 20.0)
    assert dropped <= 240
    assert len(delays) > 360
    assert max(delays) < delay_s + 0.3


def test_nothing_more_is_sent_while_the_page_shows_nothing() -> None:
    queue = VideoQueue()
    sequence, sent = 0, []
    for now in range(0, 1500 * MS, 33 * MS):
        queue.offer(frame(sequence, now, key=sequence % 30 == 0), now)
        sequence += 1
        while taken := queue.take(now):
            sent.append((taken[0].sequence, now))
    assert max(now for _, now in sent) <= 700 * MS
    queue.shown(sent[-1][0], 1500 * MS)
    now = 2000 * MS
    assert queue.offer(frame(sequence, now, key=True), now)


def test_a_hidden_page_is_asked_again_with_one_key_picture() -> None:
    queue = VideoQueue()
    queue.offer(frame(0, 0, key=True), 0)
    queue.take(0)
    now = 1000 * MS
    assert not queue.offer(frame(1, now, key=True), now)
    now = RETRY_NS + MS
    assert queue.offer(frame(2, now, key=True), now)


def second(size: int) -> list[Frame]:
    """A group of 30 pictures, the last of them taken just before 1 s."""
    return [frame(k, k * 33 * MS, key=k == 0, size=size) for k in range(30)]


def test_who_joins_in_the_middle_of_a_group_is_sent_all_of_it_however_old() -> None:
    queue, now = VideoQueue(), 1000 * MS
    queue.begin(second(10), now)
    for k in range(30):
        assert queue.take(now) == (frame(k, k * 33 * MS, key=k == 0), Flags.BEHIND), k
    queue.offer(frame(30, now), now)
    assert queue.take(now) == (frame(30, now), Flags.NONE)
    assert queue.dropped == 0


def test_who_joins_over_a_slow_link_sees_the_group_begin_and_then_waits_for_the_next() -> None:
    queue, now = VideoQueue(), 1000 * MS
    queue.begin(second(170_000), now)
    sent = []
    for k in range(30, 50):
        now = (1000 + (k - 30) * 33) * MS
        queue.offer(frame(k, now, size=170_000), now)
        while taken := queue.take(now):
            sent.append(taken[0].sequence)
    assert sent == [0, 1, 2], "half a second's worth of 1 MB/s"
    assert len(queue) == 0
    queue.shown(2, now)
    assert queue.offer(frame(50, now, key=True), now)
    assert queue.take(now) == (frame(50, now, key=True), Flags.GAP)


def test_the_next_key_picture_makes_the_rest_of_the_group_superfluous() -> None:
    queue, now = VideoQueue(), 1000 * MS
    queue.begin(second(10), now)
    queue.take(now)
    queue.offer(frame(30, now, key=True), now)
    assert queue.take(now) == (frame(30, now, key=True), Flags.GAP)


def test_who_joins_where_there_is_no_group_waits_for_a_key_picture() -> None:
    queue = VideoQueue()
    queue.begin((), 0)
    assert not queue.offer(frame(5, 0), 0)


STEPS = st.lists(st.tuples(st.integers(0, 60), st.booleans(), st.integers(0, 3), st.booleans()), max_size=120)


@given(STEPS)
def test_every_picture_that_is_sent_has_all_its_predecessors(steps: list[tuple[int, bool, int, bool]]) -> None:
    """Whatever the pace of offering, sending and showing."""
    queue, now, sent = VideoQueue(), 0, None
    for sequence, (pause_ms, key, takes, shows) in enumerate(steps):
        now += pause_ms * MS
        queue.offer(frame(sequence, now, key=key), now)
        assert len(queue) <= MAX_FRAMES
        for _ in range(takes):
            taken = queue.take(now)
            if taken is None:
                break
            picture, flags = taken
            assert picture.key or picture.sequence == sent + 1
            assert flags & Flags.GAP or sent is None or picture.sequence == sent + 1
            assert picture.key or now - picture.stamp_ns <= MAX_AGE_NS
            sent = picture.sequence
        if shows and sent is not None:
            queue.shown(sent, now)


def test_the_header_says_what_the_page_needs() -> None:
    message = Frame(b"unit", 1_234_567_890_123, 2**32 + 5, 3840, 1920, True, tainted=True).message(Flags.GAP)
    version, flags, _, sequence, stamp_us, width, height, _ = HEADER.unpack(message[: HEADER.size])
    assert (version, sequence, stamp_us, width, height) == (VERSION, 5, 1_234_567_890, 3840, 1920)
    assert flags == Flags.KEY | Flags.GAP | Flags.TAINTED
    assert HEADER.size == 24
    assert message[24:] == b"unit"
