"""A camera that leans, and a robot that sees itself."""

from __future__ import annotations

from math import pi, radians, tau

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ghal360_robot.assembly import camera_view
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.perception.detectors.base import PixelDetection
from ghal360_robot.perception.panorama import CameraView, around_robot, in_picture
from ghal360_robot.perception.sphere import (
    PictureSize,
    PixelBox,
    SphereBox,
    camera_rotation,
    pixel_box,
    turned_box,
    unit_vector,
)

SIZE = PictureSize(1920, 960)
angles = st.floats(-0.7, 0.7)


def about(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    rows = {
        "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
        "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    }
    return np.array(rows[axis])


@given(st.floats(-pi, pi), angles, angles)
def test_the_camera_is_rolled_then_pitched_then_turned(yaw: float, pitch: float, roll: float) -> None:
    assert np.allclose(camera_rotation(yaw, pitch, roll), about("z", yaw) @ about("y", pitch) @ about("x", roll))


def test_positive_pitch_leans_the_zenith_forward_and_positive_roll_to_the_right() -> None:
    assert camera_rotation(0.0, 0.1, 0.0)[:, 2] == pytest.approx((np.sin(0.1), 0, np.cos(0.1)))
    assert camera_rotation(0.0, 0.0, 0.1)[:, 2] == pytest.approx((0, -np.sin(0.1), np.cos(0.1)))


@settings(max_examples=60, deadline=None)
@given(
    st.builds(SphereBox, st.floats(-pi, pi), st.floats(-0.9, 0.9), st.floats(0.02, 1.2), st.floats(0.02, 0.6)),
    st.floats(-pi, pi),
    angles,
    angles,
)
@example(SphereBox(-0.9765625, 0.0, 0.625, 0.5), 0.0, 0.1875, 0.7)  # lowest just beside a corner
@example(SphereBox(2.0, 0.75, 1.0, 0.25), 0.0, 0.0, 0.625)  # close to a pole
def test_a_turned_box_is_the_smallest_around_its_turned_border(
    box: SphereBox, yaw: float, pitch: float, roll: float
) -> None:
    rotation = about("z", yaw) @ about("y", pitch) @ about("x", roll)
    found = turned_box(box, rotation)
    t = np.linspace(-0.5, 0.5, 8001)
    across, up = box.yaw + t * box.width, box.pitch + t * box.height
    sides = [box.yaw + s * box.width / 2 for s in (1, -1)], [box.pitch + s * box.height / 2 for s in (1, -1)]
    lon = np.concatenate([across, across, *(np.full_like(t, side) for side in sides[0])])
    lat = np.concatenate([*(np.full_like(t, side) for side in sides[1]), up, up])
    vectors = unit_vector(lon, lat) @ rotation.T
    pitches = np.arcsin(np.clip(vectors[:, 2], -1, 1))
    if found.width == tau:
        assert abs(found.pitch) + found.height / 2 == pytest.approx(pi / 2)
        return
    yaws = np.angle(np.exp(1j * (np.arctan2(vectors[:, 1], vectors[:, 0]) - found.yaw)))
    # Within a degree of a pole yaw runs too fast for any sampling.
    tolerance = 1e-6 if abs(pitches).max() < 1.4 else 1e-2
    assert yaws.max() == pytest.approx(found.width / 2, abs=tolerance)
    assert yaws.min() == pytest.approx(-found.width / 2, abs=tolerance)
    assert pitches.max() == pytest.approx(found.pitch + found.height / 2, abs=1e-6)
    assert pitches.min() == pytest.approx(found.pitch - found.height / 2, abs=1e-6)


def test_a_leaning_camera_s_boxes_are_those_of_an_upright_base() -> None:
    truth = SphereBox(0.4, 0.1, 0.02, 0.02)
    rotation = camera_rotation(1.0, 0.08, -0.05)
    seen = turned_box(truth, rotation.T)
    found = [PixelDetection("vase", 0.9, pixel_box(seen, SIZE))]
    (item,) = around_robot(found, SIZE, CameraView(1.0, 0.08, -0.05), stamp_ns=1, picture=2, detector="x").objects
    assert (item.yaw, item.pitch) == pytest.approx((0.4, 0.1), abs=1e-4)
    assert item.width == pytest.approx(0.02, rel=0.3)


def test_nothing_is_found_on_the_robot_itself() -> None:
    view = camera_view(RobotConfig())
    low = PixelBox(100, 880, 60, 60)  # from -75 to -86 degrees
    floor = PixelBox(100, 700, 60, 60)
    found = [PixelDetection("cup", 0.9, box) for box in (low, floor)]
    kept = around_robot(found, SIZE, view, stamp_ns=0, picture=0, detector="x").objects
    assert [round(item.pitch, 3) for item in kept] == [round(pi / 2 - 730 * pi / 960, 3)]


def test_the_mounting_and_the_body_come_from_the_settings() -> None:
    config = with_overrides(
        RobotConfig(),
        {
            "mounting": {"camera_yaw_deg": 90.0, "camera_pitch_deg": 2.0, "camera_roll_deg": -1.0},
            "perception": {"body": [[180.0, -30.0, 40.0, 20.0]]},
        },
    )
    view = camera_view(config)
    assert (view.yaw, view.pitch, view.roll) == pytest.approx((pi / 2, radians(2), radians(-1)))
    assert view.body == (SphereBox(pi, radians(-30), radians(40), radians(20)),)
    assert view.shows_body(SphereBox(-pi + 0.05, radians(-30), 0.2, 0.1))
    assert not view.shows_body(SphereBox(0.0, radians(-30), 0.2, 0.1))


@given(angles, angles)
def test_a_box_is_drawn_where_a_leaning_camera_saw_it(pitch: float, roll: float) -> None:
    view = CameraView(0.4, pitch, roll)
    seen = PixelBox(900.0, 500.0, 60.0, 40.0)
    (found,) = around_robot([PixelDetection("cup", 0.9, seen)], SIZE, view, stamp_ns=0, picture=0, detector="x").objects
    drawn = in_picture(SphereBox(found.yaw, found.pitch, found.width, found.height), SIZE, view)
    assert drawn.left + drawn.width / 2 == pytest.approx(seen.left + seen.width / 2, abs=6.0)
    assert drawn.top + drawn.height / 2 == pytest.approx(seen.top + seen.height / 2, abs=6.0)
    assert drawn.width >= seen.width - 0.01
    assert drawn.height >= seen.height - 0.01
