"""Tiles: what they cut out, and that their geometry agrees with one derived in another way to 1e-6."""

from __future__ import annotations

from math import pi, radians, remainder, tau

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ghal360_robot.angles import wrap
from ghal360_robot.perception.sphere import PictureSize, unit_vector
from ghal360_robot.perception.tiles import PLANS, EquirectTile, PerspectiveTile, settled_yaw

SIZE = PictureSize(1920, 960)


def rotated(axis: str, angle: float) -> np.ndarray:
    """Right-handed rotation about an axis, written out by Rodrigues' formula."""
    k = {"x": (1.0, 0, 0), "y": (0, 1.0, 0), "z": (0, 0, 1.0)}[axis]
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def seen_through_pinhole(tile: PerspectiveTile, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Unit vectors of pixels by the textbook: inverse camera matrix, then camera to robot axes, pitch, yaw."""
    focal = tile.side / 2 / np.tan(tile.fov / 2)
    camera = np.array([[focal, 0, tile.side / 2], [0, focal, tile.side / 2], [0, 0, 1]])
    rays = np.linalg.inv(camera) @ np.stack((x, y, np.ones_like(x)))
    optical_to_robot = np.array([[0, 0, 1.0], [-1.0, 0, 0], [0, -1.0, 0]])
    # A positive pitch looks up, which about the y axis (to the left) is a negative turn.
    robot = rotated("z", tile.yaw) @ rotated("y", -tile.pitch) @ optical_to_robot @ rays
    return (robot / np.linalg.norm(robot, axis=0)).T


@given(
    st.floats(-pi, pi), st.floats(-1.4, 1.4), st.floats(0.3, 2.4), st.lists(st.floats(0, 512), min_size=2, max_size=9)
)
def test_perspective_directions_are_those_of_a_pinhole_camera(
    yaw: float, pitch: float, fov: float, pixels: list[float]
) -> None:
    tile = PerspectiveTile(yaw, pitch, fov)
    x, y = np.array(pixels), np.array(pixels[::-1])
    assert np.abs(unit_vector(*tile.directions(x, y)) - seen_through_pinhole(tile, x, y)).max() < 1e-9


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-pi, pi),
    st.floats(-1.3, 1.3),
    st.floats(0.5, 2.2),
    st.tuples(st.floats(0, 500), st.floats(0, 500), st.floats(8, 300), st.floats(8, 300)),
)
def test_perspective_boxes_pass_through_the_middles_of_their_sides(
    yaw: float, pitch: float, fov: float, place: tuple[float, float, float, float]
) -> None:
    tile = PerspectiveTile(yaw, pitch, fov)
    left, top, width, height = place
    right, bottom = min(512.0, left + width), min(512.0, top + height)
    (box,) = tile.boxes([(left, top, right, bottom)], SIZE)
    x, y = (left + right) / 2, (top + bottom) / 2
    sides = seen_through_pinhole(tile, np.array((left, right, x, x)), np.array((y, y, top, bottom)))
    lat = np.arcsin(np.clip(sides[:, 2], -1, 1))
    if box.width == tau:
        down = seen_through_pinhole(
            tile, np.linspace(left, right, 99).repeat(99), np.tile(np.linspace(top, bottom, 99), 99)
        )
        assert abs(down[:, 2]).max() > 0.99, "only a box with a pole in it goes all around"
        return
    lon = np.angle(np.exp(1j * (np.arctan2(sides[:, 1], sides[:, 0]) - box.yaw)))
    assert lon[:2] == pytest.approx((box.width / 2, -box.width / 2), abs=1e-6)
    assert lat[2:] == pytest.approx((box.pitch + box.height / 2, box.pitch - box.height / 2), abs=1e-6)


def test_a_view_onto_the_floor_that_shows_the_nadir_covers_the_whole_circle() -> None:
    (box,) = PerspectiveTile(0.3, -pi / 2 + 0.1, pi / 2).boxes([(100, 100, 400, 400)], SIZE)
    assert box.width == tau
    assert box.pitch - box.height / 2 == pytest.approx(-pi / 2)


def test_perspective_pixels_are_those_of_the_panorama_in_that_direction() -> None:
    u, v = np.meshgrid(np.arange(1920) + 0.5, np.arange(960) + 0.5)
    vectors = unit_vector(pi - u * tau / 1920, pi / 2 - v * pi / 960)
    panorama = np.round((vectors + 1) * 120).astype(np.uint8)
    for tile in (PerspectiveTile(0.4, -0.3, pi / 2, 128), PerspectiveTile(pi, 0.0, pi / 2, 128)):
        middle = np.arange(128) + 0.5
        x, y = (each.ravel() for each in np.meshgrid(middle, middle))
        expected = (seen_through_pinhole(tile, x, y) + 1) * 120
        assert np.abs(tile.cut(panorama).reshape(-1, 3) - expected).max() < 1.6


@pytest.mark.parametrize("plan", ["default", "fine", "full"])
def test_equirect_tiles_show_pixels_of_the_panorama_as_they_are(plan: str) -> None:
    columns = np.arange(1920, dtype=np.uint16)
    panorama = np.zeros((960, 1920, 3), np.uint8)
    panorama[:, :, 0], panorama[:, :, 1] = columns & 255, columns >> 8
    panorama[:, :, 2] = (np.arange(960) // 4)[:, None]
    for tile in PLANS[plan].tiles:
        assert isinstance(tile, EquirectTile)
        cut = tile.cut(panorama).astype(int)
        shown = cut[0, :, 0] + 256 * cut[0, :, 1]
        assert ((np.diff(shown) == 1) | (np.diff(shown) == -1919)).all()
        (box,) = tile.boxes([(0, 0, 1, 1)], SIZE)
        yaw = pi - (shown[0] + 0.5) * tau / 1920
        assert abs(wrap(box.yaw - yaw)) < 1e-9
        assert box.width == pytest.approx(tau / 1920)


def test_a_box_over_the_seam_is_one_box_behind_the_camera() -> None:
    tile = EquirectTile(pi, 0.0, radians(120), radians(120))
    (box,) = tile.boxes([(300, 300, 340, 340)], SIZE)
    assert abs(abs(box.yaw) - pi) < 1e-9
    assert box.pitch == pytest.approx(0.0)
    assert box.width == pytest.approx(40 * tau / 1920)


@pytest.mark.parametrize("plan", PLANS)
def test_every_plan_sees_all_around_and_neighbours_overlap(plan: str) -> None:
    chosen = PLANS[plan]
    for yaw in np.linspace(-pi, pi, 721):
        shown = 0
        for tile in chosen.tiles:
            half = (tile.width if isinstance(tile, EquirectTile) else tile.fov) / 2
            shown += abs(wrap(yaw - tile.yaw)) <= half + 1e-9
        assert shown >= 1
    assert chosen.overlap == pytest.approx({"default": pi / 6, "round-robin": pi / 6, "full": 0.0}.get(plan, pi / 6))


@given(st.integers(1, 5000), st.integers(1, 3000), st.sampled_from(sorted(PLANS)))
@settings(max_examples=40, deadline=None)
def test_panoramas_of_any_size_can_be_cut(width: int, height: int, plan: str) -> None:
    panorama = np.zeros((height, width, 3), np.uint8)
    for tile in PLANS[plan].tiles[:2]:
        cut = tile.cut(panorama)
        assert cut.size > 0
        (box,) = tile.boxes([(0, 0, cut.shape[1], cut.shape[0])], PictureSize(width, height))
        assert box.height <= pi + 1e-9


def test_only_tiles_with_neighbours_cut() -> None:
    assert all(tile.cuts() == (plan.name != "full") for plan in PLANS.values() for tile in plan.tiles)


@pytest.mark.parametrize("period", [pi / 2, pi / 3, tau])
def test_the_ring_of_tiles_stands_still_in_the_world_while_the_picture_turns(period: float) -> None:
    rng = np.random.default_rng(3)
    panorama = np.repeat(np.repeat(rng.integers(0, 255, (12, 24, 3), np.uint8), 40, 0), 40, 1)
    still = settled_yaw(panorama, period)
    for columns in (1, 80, 333, 700):
        turned = settled_yaw(np.roll(panorama, columns, axis=1), period)
        turn = still - turned - columns * tau / panorama.shape[1]
        assert abs(remainder(turn, period)) < 1e-9


def test_tiles_have_in_their_middle_what_stands_out() -> None:
    panorama = np.full((480, 960, 3), 90, np.uint8)
    panorama[200:280, 300:340] = 250
    assert settled_yaw(panorama, pi / 2) == pytest.approx(remainder(pi - 320 * tau / 960, pi / 2))
    assert settled_yaw(np.full((480, 960, 3), 90, np.uint8), pi / 2) == 0.0
