"""The picture decoder: exact stamps, taint, and calm under damaged and hostile streams."""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import TYPE_CHECKING

import av
import numpy as np
import pytest

from ghal360_robot.perception.decode import MAX_UNIT_BYTES, Picture, PictureDecoder
from ghal360_robot.perception.sphere import PictureSize

if TYPE_CHECKING:
    from collections.abc import Callable

WAIT_S = 10.0


class Gallery:
    """Collects pictures and lets a test wait for a condition on the decoder instead of sleeping."""

    def __init__(self) -> None:
        self.pictures: list[Picture] = []
        self.changed = threading.Condition()

    def __call__(self, picture: Picture) -> None:
        with self.changed:
            self.pictures.append(picture)
            self.changed.notify_all()

    def wait(self, count: int) -> list[Picture]:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.pictures) >= count, WAIT_S)
            return list(self.pictures)


def level(picture: Picture) -> int:
    """The number of the source picture, read from its grey."""
    return round((float(np.median(picture.rgb())) - 20) / 3)


def decode_all(units: list[bytes], taints: frozenset[int] = frozenset()) -> tuple[list[Picture], PictureDecoder]:
    """Decode in order; the last unit must be decodable."""
    gallery = Gallery()
    with PictureDecoder(gallery, queue_units=len(units)) as decoder:
        for i, data in enumerate(units):
            decoder.submit(data, stamp_ns=10**18 + 7 * i, tainted=i in taints)
        with gallery.changed:
            assert gallery.changed.wait_for(
                lambda: gallery.pictures and gallery.pictures[-1].number == len(units) - 1, WAIT_S
            )
    return gallery.pictures, decoder


def test_every_unit_becomes_the_right_picture_with_its_exact_stamp(stream: list[bytes]) -> None:
    pictures, decoder = decode_all(stream)
    assert [picture.number for picture in pictures] == list(range(20))
    assert [picture.stamp_ns for picture in pictures] == [10**18 + 7 * i for i in range(20)]
    assert [level(picture) for picture in pictures] == list(range(20))
    assert not any(picture.tainted for picture in pictures)
    stats = decoder.stats()
    assert (stats.received, stats.decoded, stats.undecodable, stats.dropped) == (20, 20, 0, 0)


def test_rgb_is_lazy_repeatable_and_scales(stream: list[bytes]) -> None:
    picture = decode_all(stream)[0][4]
    assert picture.size == PictureSize(128, 64)
    assert picture.rgb().shape == (64, 128, 3)
    assert picture.rgb().dtype == np.uint8
    np.testing.assert_array_equal(picture.rgb(), picture.rgb())
    assert picture.rgb(PictureSize(32, 16)).shape == (16, 32, 3)


def test_joining_in_the_middle_counts_refusals_until_the_first_idr(stream: list[bytes]) -> None:
    pictures, decoder = decode_all(stream[2:])
    clean = [picture for picture in pictures if not picture.tainted]
    assert [level(picture) for picture in clean] == list(range(5, 20))
    assert decoder.stats().undecodable + len(pictures) == 18


def test_taint_from_the_driver_lasts_until_the_next_idr(stream: list[bytes]) -> None:
    pictures, decoder = decode_all(stream, frozenset({7}))
    assert [picture.number for picture in pictures if picture.tainted] == [7, 8, 9]
    assert decoder.stats().tainted == 3


def test_a_tainted_idr_taints_its_whole_group(stream: list[bytes]) -> None:
    pictures, _ = decode_all(stream, frozenset({5}))
    assert [picture.number for picture in pictures if picture.tainted] == [5, 6, 7, 8, 9]


def test_a_truncated_unit_taints_until_the_next_idr(make_stream: Callable[..., list[bytes]]) -> None:
    rng = np.random.default_rng(1)
    units = make_stream(10)
    units[6] = units[6][: len(units[6]) // 2]
    units[7] = bytes(rng.integers(0, 256, 60, np.uint8))
    pictures, _ = decode_all(units)
    tainted = {picture.number for picture in pictures if picture.tainted}
    assert tainted
    assert tainted <= {6, 7, 8, 9}
    assert {picture.number for picture in pictures if not picture.tainted} >= {0, 1, 2, 3, 4, 5}
    assert 9 in tainted


@pytest.mark.parametrize("seed", range(20))
def test_hostile_bytes_end_nothing_and_the_next_idr_is_clean_again(stream: list[bytes], seed: int) -> None:
    rng = np.random.default_rng(seed)
    units = list(stream)
    for i in range(1, 15):
        damaged = bytearray(units[i])
        for _ in range(3):
            damaged[rng.integers(len(damaged))] = rng.integers(256)
        units[i] = bytes(damaged[: rng.integers(len(damaged) + 1)])
    pictures, decoder = decode_all(units)
    assert [(picture.number, picture.tainted) for picture in pictures[-5:]] == [(n, False) for n in range(15, 20)]
    assert decoder.stats().received == 20


def test_a_damaged_sps_that_announces_reordering_does_not_delay_the_stream_for_good(
    stream: list[bytes],
) -> None:
    rng = np.random.default_rng(9)
    units = list(stream)
    for i in range(1, 15):
        damaged = bytearray(units[i])
        for _ in range(3):
            damaged[rng.integers(len(damaged))] = rng.integers(256)
        units[i] = bytes(damaged[: rng.integers(len(damaged) + 1)])
    plain = av.VideoCodecContext.create("h264", "r")
    for data in units:
        with suppress(av.error.InvalidDataError):
            plain.decode(av.Packet(data))
    assert plain.has_b_frames
    pictures, _ = decode_all(units)
    assert [picture.number for picture in pictures[-5:]] == [15, 16, 17, 18, 19]


@pytest.mark.parametrize("junk", [b"", b"\0\0\1", b"no start code here"])
def test_units_without_a_nal_unit_are_counted_and_taint_what_follows(stream: list[bytes], junk: bytes) -> None:
    pictures, decoder = decode_all([*stream[:2], junk, *stream[2:]])
    assert [level(picture) for picture in pictures] == list(range(20))
    assert [level(picture) for picture in pictures if picture.tainted] == [2, 3, 4]
    assert decoder.stats().undecodable == 1


def test_an_absurdly_large_unit_is_dropped_and_counted(stream: list[bytes]) -> None:
    gallery = Gallery()
    with PictureDecoder(gallery) as decoder:
        decoder.submit(bytes(MAX_UNIT_BYTES + 1), 0)
        decoder.submit(stream[0], 1)
        (picture,) = gallery.wait(1)
    assert decoder.stats().dropped == 1
    assert (picture.number, picture.stamp_ns, picture.tainted) == (1, 1, False)


def test_a_picture_larger_than_the_camera_s_is_refused(make_stream: Callable[..., list[bytes]]) -> None:
    huge = make_stream(1, width=4096, height=2176)[0]
    small = make_stream(1)[0]
    gallery = Gallery()
    with PictureDecoder(gallery) as decoder:
        decoder.submit(huge, 0)
        decoder.submit(small, 1)
        (picture,) = gallery.wait(1)
    assert picture.size == PictureSize(128, 64)
    assert decoder.stats().undecodable == 1


def test_a_slow_consumer_costs_pictures_but_the_newest_still_comes_clean(stream: list[bytes]) -> None:
    entered, go_on = threading.Event(), threading.Event()
    gallery = Gallery()

    def slow(picture: Picture) -> None:
        entered.set()
        assert go_on.wait(WAIT_S)
        gallery(picture)

    with PictureDecoder(slow, queue_units=3) as decoder:
        decoder.submit(stream[0], 0)
        assert entered.wait(WAIT_S)
        for i in range(1, 20):
            decoder.submit(stream[i], i)
        assert decoder.stats().dropped > 0
        go_on.set()
        with gallery.changed:
            assert gallery.changed.wait_for(lambda: decoder.stats().dropped + len(gallery.pictures) == 20, WAIT_S)
    assert not any(picture.tainted for picture in gallery.pictures)
    assert [level(picture) for picture in gallery.pictures] == [p.number for p in gallery.pictures]


def test_after_a_gap_without_idr_pictures_are_tainted(make_stream: Callable[..., list[bytes]]) -> None:
    units = make_stream(120, gop=1000)
    entered, go_on = threading.Event(), threading.Event()
    gallery = Gallery()

    def slow(picture: Picture) -> None:
        entered.set()
        assert go_on.wait(WAIT_S)
        gallery(picture)

    with PictureDecoder(slow, queue_units=2) as decoder:
        decoder.submit(units[0], 0)
        assert entered.wait(WAIT_S)
        for i in range(1, 95):
            decoder.submit(units[i], i)
        go_on.set()
        gallery.wait(1)
        decoder.submit(units[95], 95)
        pictures = gallery.wait(2)
    assert not pictures[0].tainted
    assert pictures[1].number >= 94
    assert pictures[1].tainted


def test_a_failing_consumer_is_counted_and_the_video_goes_on(
    stream: list[bytes], caplog: pytest.LogCaptureFixture
) -> None:
    gallery = Gallery()

    def failing(picture: Picture) -> None:
        gallery(picture)
        if picture.number < 3:
            raise KeyError("consumer bug")

    with PictureDecoder(failing) as decoder:
        for i in range(5):
            decoder.submit(stream[i], i)
        gallery.wait(5)
    assert decoder.stats().consumer_failures == 3
    assert len([r for r in caplog.records if "only counted" in r.message]) == 1


def test_closing_ends_the_thread_and_is_repeatable(stream: list[bytes]) -> None:
    before = threading.active_count()
    with PictureDecoder(Gallery()) as decoder:
        decoder.submit(stream[0], 0)
    decoder.close()
    assert threading.active_count() == before
