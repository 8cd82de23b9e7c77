"""Directions and pixels, checked against rotation matrices at every border."""

from __future__ import annotations

from math import asin, atan2, cos, pi, sin, tau

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ghal360_robot.angles import wrap
from ghal360_robot.perception.sphere import (
    PictureSize,
    PixelBox,
    SphereBox,
    angular_distance,
    direction_of_pixel,
    direction_of_vector,
    parts_of_box,
    pixel_box,
    pixel_of_direction,
    sphere_box,
    unit_vector,
    wrap_angle,
)

SIZES = (PictureSize(1920, 960), PictureSize(3840, 1920), PictureSize(1024, 512), PictureSize(7, 3))
sizes = st.sampled_from(SIZES)
yaws = st.floats(-4 * pi, 4 * pi)
camera_yaws = st.floats(-pi, pi)
fractions = st.floats(0, 1)


def turn_z(angle: float) -> np.ndarray:
    return np.array([[cos(angle), -sin(angle), 0], [sin(angle), cos(angle), 0], [0, 0, 1]])


def turn_y(angle: float) -> np.ndarray:
    return np.array([[cos(angle), 0, sin(angle)], [0, 1, 0], [-sin(angle), 0, cos(angle)]])


def looked_at(u: float, v: float, size: PictureSize, camera_yaw: float) -> np.ndarray:
    """Independent derivation: turn the forward axis up, then left, then by the mounting."""
    left_turn = tau * (0.5 - u / size.width)
    up_turn = pi * (0.5 - v / size.height)
    return turn_z(camera_yaw) @ turn_z(left_turn) @ turn_y(-up_turn) @ np.array([1.0, 0.0, 0.0])


@given(fractions, fractions, sizes, camera_yaws)
@example(0.0, 0.0, SIZES[0], 0.0)
@example(1.0, 1.0, SIZES[0], 0.0)
@example(0.0, 0.5, SIZES[0], pi)
@example(1.0, 0.5, SIZES[0], -pi)
@example(0.5, 0.5, SIZES[0], 0.0)
def test_a_pixel_looks_where_rotation_matrices_say(
    across: float, down: float, size: PictureSize, camera_yaw: float
) -> None:
    u, v = across * size.width, down * size.height
    yaw, pitch = direction_of_pixel(u, v, size, camera_yaw)
    assert -pi <= yaw < pi
    np.testing.assert_allclose(unit_vector(yaw, pitch), looked_at(u, v, size, camera_yaw), atol=1e-12)


@given(yaws, st.floats(-pi / 2, pi / 2), sizes, camera_yaws)
@example(pi, 0.0, SIZES[0], 0.0)
@example(-pi, 0.0, SIZES[0], 0.0)
@example(np.nextafter(pi, 0), 0.0, SIZES[0], 0.0)
@example(np.nextafter(-pi, -4), 0.0, SIZES[0], 0.0)
@example(0.0, pi / 2, SIZES[0], 0.0)
@example(0.0, -pi / 2, SIZES[0], 0.0)
@example(-1e-300, 0.0, SIZES[3], pi)
def test_a_direction_comes_back_from_its_pixel(yaw: float, pitch: float, size: PictureSize, camera_yaw: float) -> None:
    u, v = pixel_of_direction(yaw, pitch, size, camera_yaw)
    assert 0 <= u < size.width
    assert 0 <= v <= size.height
    back_yaw, back_pitch = direction_of_pixel(u, v, size, camera_yaw)
    assert angular_distance(yaw, pitch, back_yaw, back_pitch) < 1e-9
    assert back_pitch == pytest.approx(pitch, abs=1e-9)


def test_the_picture_is_the_right_way_round() -> None:
    size = PictureSize(1920, 960)
    quarter = {
        (960, 480): (0.0, 0.0),
        (480, 480): (pi / 2, 0.0),
        (1440, 480): (-pi / 2, 0.0),
        (960, 240): (0.0, pi / 4),
        (960, 720): (0.0, -pi / 4),
        (0, 480): (-pi, 0.0),
        (1920, 480): (-pi, 0.0),
    }
    for (u, v), expected in quarter.items():
        assert tuple(map(float, direction_of_pixel(u, v, size))) == pytest.approx(expected, abs=1e-12)


def test_a_camera_turned_left_sees_the_base_s_left_straight_ahead() -> None:
    yaw, _ = direction_of_pixel(960, 480, PictureSize(1920, 960), camera_yaw=pi / 2)
    assert yaw == pytest.approx(pi / 2)


@given(yaws)
@example(pi)
@example(-pi)
@example(3 * pi)
@example(-1e-17 - pi)
def test_wrapping_keeps_the_direction_and_stays_in_the_half_open_turn(angle: float) -> None:
    wrapped = wrap(angle)
    assert -pi <= wrapped < pi
    assert cos(wrapped) == pytest.approx(cos(angle), abs=1e-9)
    assert sin(wrapped) == pytest.approx(sin(angle), abs=1e-9)


@given(yaws, st.floats(-pi / 2, pi / 2), st.floats(1e-9, 1e9))
def test_a_vector_gives_its_direction_whatever_its_length(yaw: float, pitch: float, length: float) -> None:
    back = direction_of_vector(unit_vector(yaw, pitch) * length)
    assert angular_distance(yaw, pitch, *back) < 1e-9


@given(
    yaws,
    st.floats(-pi / 2, pi / 2),
    st.floats(-pi / 2, pi / 2),
    st.sampled_from((0.0, 1e-12, 1e-9, 1e-6, 0.3, pi - 1e-9, pi)),
)
def test_angular_distance_is_the_angle_of_the_rotation_between(
    yaw: float, pitch: float, axis: float, angle: float
) -> None:
    start = unit_vector(yaw, pitch)
    side = turn_z(yaw) @ np.array([0.0, 1.0, 0.0])
    up = np.cross(start, side)
    tangent = cos(axis) * side + sin(axis) * up
    other = direction_of_vector(cos(angle) * start + sin(angle) * tangent)
    assert angular_distance(yaw, pitch, *other) == pytest.approx(angle, abs=1e-9)


def test_angular_distance_agrees_with_the_spherical_law_of_cosines_away_from_its_weak_spots() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.uniform(-1.4, 1.4, (2, 200))
    turn = rng.uniform(0.5, 2.5, 200)
    law = np.arccos(np.sin(a) * np.sin(b) + np.cos(a) * np.cos(b) * np.cos(turn))
    np.testing.assert_allclose(angular_distance(0.0, a, turn, b), law, atol=1e-9)


@given(
    sizes,
    camera_yaws,
    st.floats(-pi, pi, exclude_max=True),
    st.floats(-1.0, 1.0),
    st.floats(0.001, tau - 0.001),
    st.floats(0.001, 1.0),
)
@example(SIZES[0], 0.0, -pi, 0.0, 0.2, 0.1)
@example(SIZES[0], 0.0, pi - 0.05, 0.0, 0.2, 0.1)
def test_a_box_comes_back_from_its_pixels_also_over_the_seam(
    size: PictureSize, camera_yaw: float, yaw: float, pitch: float, width: float, height: float
) -> None:
    box = SphereBox(yaw, pitch, width, height)
    pixels = pixel_box(box, size, camera_yaw)
    assert 0 <= pixels.left < size.width
    back = sphere_box(pixels, size, camera_yaw)
    assert angular_distance(yaw, pitch, back.yaw, back.pitch) < 1e-9
    assert (back.width, back.height) == pytest.approx((width, height), abs=1e-9)


def test_a_box_over_the_seam_is_centred_behind_the_camera() -> None:
    box = sphere_box(PixelBox(1900, 470, 40, 20), PictureSize(1920, 960))
    assert abs(box.yaw) == pytest.approx(pi)
    assert box.width == pytest.approx(tau * 40 / 1920)
    assert atan2(sin(box.pitch), cos(box.pitch)) == pytest.approx(asin(0.0), abs=1e-12)


@given(st.floats(0, 1920, exclude_max=True), st.floats(0.5, 2500))
def test_the_parts_of_a_box_lie_in_the_picture_and_add_up(left: float, width: float) -> None:
    size = PictureSize(1920, 960)
    parts = parts_of_box(PixelBox(left, 100, width, 50), size)
    assert sum(part.width for part in parts) == pytest.approx(min(width, 1920))
    for part in parts:
        assert 0 <= part.left <= part.left + part.width <= 1920 + 1e-6


def test_arrays_of_any_shape_broadcast() -> None:
    u, v = np.meshgrid(np.arange(8) + 0.5, np.arange(4) + 0.5)
    yaw, pitch = direction_of_pixel(u, v, PictureSize(8, 4))
    assert yaw.shape == pitch.shape == (4, 8)
    assert unit_vector(yaw, pitch).shape == (4, 8, 3)
    assert np.all(np.diff(wrap_angle(yaw), axis=1) < 0)


def test_a_picture_without_pixels_is_refused() -> None:
    with pytest.raises(ValueError, match="no directions"):
        PictureSize(0, 960)
