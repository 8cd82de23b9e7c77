"""The encoder's bitstream is what the THETA V's descriptors promise."""

from __future__ import annotations

import re

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from ghal360_robot.simulation.encoder import ThetaEncoder

SLICE, IDR, SEI, SPS, PPS = 1, 5, 6, 7, 8


def units(access_unit: bytes) -> list[bytes]:
    """The NAL units of an Annex B access unit, without start codes."""
    assert access_unit.startswith((b"\0\0\1", b"\0\0\0\1"))
    return [part for part in re.split(rb"\x00{2,3}\x01", access_unit) if part]


def kinds(access_unit: bytes) -> list[int]:
    return [unit[0] & 31 for unit in units(access_unit)]


def moving(index: int, width: int = 192, height: int = 96) -> NDArray[np.uint8]:
    picture = np.full((height, width, 3), (200, 190, 170), np.uint8)
    cv2.circle(picture, (20 + 5 * index, 48), 15, (230, 100, 20), -1)
    return cv2.GaussianBlur(picture, (0, 0), 1.5)


def test_each_picture_becomes_one_access_unit_that_decodes_at_once() -> None:
    decoder = av.CodecContext.create("h264", "r")
    with ThetaEncoder(192, 96, fps=10, bitrate=1_000_000) as encoder:
        for index in range(25):
            frames = decoder.decode(av.Packet(encoder.encode(moving(index))))
            assert len(frames) == 1
            assert cv2.PSNR(frames[0].to_ndarray(format="rgb24"), moving(index)) > 30


def test_every_second_starts_with_parameter_sets_and_an_idr_and_each_picture_is_one_slice() -> None:
    with ThetaEncoder(192, 96, fps=10, bitrate=1_000_000) as encoder:
        for index in range(31):
            found = [kind for kind in kinds(encoder.encode(moving(index))) if kind != SEI]
            assert found == ([SPS, PPS, IDR] if index % 10 == 0 else [SLICE])


@pytest.mark.parametrize(("size", "level"), [((1920, 960), 40), ((3840, 1920), 51)])
def test_the_parameter_sets_say_constrained_baseline_cavlc(size: tuple[int, int], level: int) -> None:
    with ThetaEncoder(*size, fps=30) as encoder:
        sps, pps = units(encoder.encode(np.zeros((size[1], size[0], 3), np.uint8)))[:2]
    profile, constraints = sps[1], sps[2]
    assert profile == 66
    assert constraints & 0x40, "constraint_set1: constrained baseline"
    assert sps[3] == level
    # pps_id 0 and sps_id 0 take a bit each; the third bit is entropy_coding_mode.
    assert pps[1] >> 5 == 0b110


def test_the_rate_stays_near_what_was_ordered() -> None:
    rng = np.random.default_rng(1)
    fps, bitrate = 10, 800_000
    with ThetaEncoder(320, 160, fps, bitrate) as encoder:
        sizes = [len(encoder.encode(rng.integers(0, 255, (160, 320, 3), np.uint8))) for _ in range(40)]
    assert 0.5 * bitrate < sum(sizes[10:]) * 8 / (30 / fps) < 1.4 * bitrate


@pytest.mark.parametrize("shape", [(95, 192, 3), (96, 192), (96, 192, 4)])
def test_a_picture_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with ThetaEncoder(192, 96) as encoder, pytest.raises(ValueError, match="RGB"):
        encoder.encode(np.zeros(shape, np.uint8))


@pytest.mark.parametrize("arguments", [(191, 96), (0, 0), (192, 96, 0.0), (192, 96, 10.0, 0)])
def test_impossible_orders_are_refused(arguments: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="encode"):
        ThetaEncoder(*arguments)
