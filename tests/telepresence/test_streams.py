from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import av
import cv2
import numpy as np
import pytest

from drivers.theta_v.codec import h264
from ghal360_robot.simulation.encoder import ThetaEncoder
from ghal360_robot.telepresence.frames import Frame
from ghal360_robot.telepresence.settings import PageSettings
from ghal360_robot.telepresence.streams import (
    MAX_GROUP_AGE_NS,
    MAX_GROUP_BYTES,
    MAX_GROUP_FRAMES,
    Stream,
    Streams,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

SETTINGS = PageSettings(small_codec="libx264", small_width=160, small_hz=10.0, small_kbps=300)


@pytest.fixture(scope="module")
def film() -> list[Frame]:
    """Two seconds at 30 Hz of a square that moves."""
    frames = []
    with ThetaEncoder(320, 160, 30.0) as encoder:
        for k in range(60):
            picture = np.full((160, 320, 3), 40, np.uint8)
            picture[60:100, 4 * k : 4 * k + 40] = (200, 60, 30)
            frames.append(Frame(encoder.encode(picture), k * 33_333_333, k, 320, 160, k % 30 == 0))
    return frames


async def watched(name: str, film: Sequence[Frame], count: int) -> list[Frame]:
    got: list[Frame] = []
    streams = Streams(SETTINGS)
    stream = streams.get(name)
    assert stream is not None
    with streams, stream.watched_by(got.append):
        for frame in film:
            streams.feed(frame)
            await asyncio.sleep(0.002)
        async with asyncio.timeout(10):
            while len(got) < count:
                await asyncio.sleep(0.01)
    return got


def decode(frames: Sequence[Frame]) -> list[av.VideoFrame]:
    decoder = av.CodecContext.create("h264", "r")
    return [picture for frame in frames for picture in decoder.decode(av.Packet(frame.data))]  # type: ignore[attr-defined]


async def test_the_cameras_stream_is_the_cameras_but_for_the_reordering(film: list[Frame]) -> None:
    got = await watched("camera", film, 60)
    for before, after in zip(film, got, strict=True):
        kinds = [[nal.kind for nal in h264.split(frame.data)] for frame in (before, after)]
        assert kinds[0] == kinds[1]
        assert after.data[-200:] == before.data[-200:]
    assert got[1] is film[1]


async def test_the_small_stream_decodes_and_is_smaller(film: list[Frame]) -> None:
    got = await watched("small", film, 15)
    pictures = decode(got)
    assert got[0].key
    assert {(picture.width, picture.height) for picture in pictures} == {(160, 80)}
    assert 8 <= 15 / ((got[14].stamp_ns - got[0].stamp_ns) / 1e9) <= 12
    assert all(frame.sequence == film[frame.sequence].sequence for frame in got)


async def test_stills_are_key_pictures_as_jpeg(film: list[Frame]) -> None:
    got = await watched("stills", film, 2)
    assert [frame.sequence for frame in got] == [0, 30]
    picture = cv2.imdecode(np.frombuffer(got[1].data, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (160, 320, 3)
    assert got[1].jpeg
    assert picture[80, 140].tolist() == pytest.approx([30, 60, 200], abs=40)


async def test_damaged_units_end_no_stream(film: list[Frame]) -> None:
    broken = [
        Frame(bytes(frame.data[:40]) + b"\xff" * 60, frame.stamp_ns, frame.sequence, 320, 160, frame.key)
        if frame.sequence in range(5, 12)
        else frame
        for frame in film
    ]
    got = await watched("small", [*broken, *film], 10)
    assert len(got) >= 10


async def test_what_nobody_watches_is_not_made(film: list[Frame]) -> None:
    streams = Streams(SETTINGS)
    with streams:
        for frame in film:
            streams.feed(frame)
        assert all(not maker._waiting for maker in streams._makers.values())


async def test_a_key_picture_with_nonsense_for_parameters_is_left_out_with_what_follows_from_it(
    film: list[Frame], caplog: pytest.LogCaptureFixture
) -> None:
    streams = Streams(SETTINGS)
    got: list[Frame] = []
    stream = streams.get("camera")
    assert stream is not None
    with stream.watched_by(got.append):
        streams.feed(Frame(b"\0\0\0\1\x67\x42", 0, 1, 64, 32, True))
        for frame in film[1:31]:
            streams.feed(frame)
    assert [frame.sequence for frame in got] == [30]
    assert "damaged" in caplog.text


def test_a_stream_keeps_its_newest_group_for_who_comes(film: list[Frame]) -> None:
    stream = Stream()
    for frame in film[:45]:
        stream.give(frame)
    now_ns = film[44].stamp_ns
    assert stream.group(now_ns) == tuple(film[30:45])
    assert stream.group(now_ns + MAX_GROUP_AGE_NS + 1) == (), "of a camera that fell silent"


@pytest.mark.parametrize("size", [10, MAX_GROUP_BYTES // 10])
def test_a_group_without_an_end_is_let_go(size: int) -> None:
    stream = Stream()
    stream.give(Frame(b"", 0, 0, 64, 32, True))
    for k in range(1, 2 * MAX_GROUP_FRAMES):
        stream.give(Frame(b"\0" * size, 0, k, 64, 32, False))
        assert len(stream.group(0)) <= MAX_GROUP_FRAMES
        assert sum(len(frame.data) for frame in stream.group(0)) <= MAX_GROUP_BYTES
    assert stream.group(0) == ()
