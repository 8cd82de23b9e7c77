"""A small H.264 stream like the camera's: constrained baseline, one slice, SPS and PPS with each IDR."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import av
import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

GOP = 5


def encode(count: int, width: int = 128, height: int = 64, gop: int = GOP) -> list[bytes]:
    """`count` access units; picture i is grey of level 20 + 3 i, so that a decoded picture tells its number."""
    encoder = av.VideoCodecContext.create("libx264", "w")
    encoder.width, encoder.height = width, height
    encoder.pix_fmt = "yuv420p"
    encoder.time_base = Fraction(1, 30)
    encoder.options = {
        "profile": "baseline",
        "preset": "ultrafast",
        "tune": "zerolatency",
        "crf": "18",
        "x264-params": f"keyint={gop}:min-keyint={gop}:scenecut=0:sliced-threads=0:repeat-headers=1",
    }
    encoder.thread_count = 1
    units = []
    for i in range(count):
        frame = av.VideoFrame.from_ndarray(np.full((height, width, 3), 20 + 3 * i % 200, np.uint8), format="rgb24")
        frame.pts = i
        units += [bytes(packet) for packet in encoder.encode(frame)]
    units += [bytes(packet) for packet in encoder.encode(None)]
    assert len(units) == count
    return units


@pytest.fixture(scope="session")
def stream() -> list[bytes]:
    """Twenty access units of 128 x 64 pixels, an IDR every five."""
    return encode(20)


@pytest.fixture(scope="session")
def make_stream() -> Callable[..., list[bytes]]:
    return encode
