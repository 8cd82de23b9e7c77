"""The rendered panorama: things appear where they are, in their paint, and nothing else wears it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from ghal360_robot.simulation.encoder import ThetaEncoder
from ghal360_robot.simulation.objects import CATALOGUE
from ghal360_robot.simulation.paint import BAND_DEG, MAX_OTHER_SATURATION, MIN_PAINT_SATURATION, PAINT
from ghal360_robot.simulation.panorama import ATLAS, FACES, CubeMap, directions, face_fov_deg
from ghal360_robot.simulation.renderer import PanoramaRenderer
from ghal360_robot.simulation.textures import MAKERS, make_texture
from ghal360_robot.simulation.things import BUILDERS
from ghal360_robot.simulation.world import CAMERA_HEIGHT_M, Room, World, WorldObject, build_world

WIDTH, HEIGHT = 1920, 960
DARK = 0.2
"""Below this brightness 8-bit pictures have no meaningful hue."""


@pytest.fixture(scope="module", params=["office", "home"])
def renderer(request: pytest.FixtureRequest) -> Iterator[PanoramaRenderer]:
    drawn = PanoramaRenderer(build_world(request.param, 2, "television"), painted=True)
    yield drawn
    drawn.close()


def roomiest(world: World, room: Room) -> tuple[float, float]:
    xs, ys = np.arange(room.x0 + 0.4, room.x1 - 0.4, 0.3), np.arange(room.y0 + 0.4, room.y1 - 0.4, 0.3)
    return max(((float(x), float(y)) for x in xs for y in ys), key=lambda place: world.clearance(*place))


def through_the_camera(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    unit = ThetaEncoder(WIDTH, HEIGHT, fps=12, bitrate=6_000_000).encode(picture)
    frames = av.CodecContext.create("h264", "r").decode(av.Packet(unit))
    return frames[0].to_ndarray(format="rgb24")


def hsv(picture: NDArray[np.uint8]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    converted = cv2.cvtColor(picture.astype(np.float32) / 255, cv2.COLOR_RGB2HSV)
    return converted[..., 0], converted[..., 1], converted[..., 2]


def in_band(hue: np.ndarray, name: str) -> np.ndarray:
    return np.abs((hue - PAINT[name] + 180) % 360 - 180) <= BAND_DEG


def outline(item: WorldObject, x: float, y: float, yaw: float) -> tuple[np.ndarray, slice]:
    """Columns and rows that a thing can cover in the panorama, with leaves and straps beyond its footprint."""
    reach = math.hypot(item.size[0], item.size[1]) / 2 + (0.30 if item.name == "potted plant" else 0.03)
    away = math.hypot(item.x - x, item.y - y)
    middle = math.atan2(item.y - y, item.x - x) - yaw
    half = math.asin(min(1.0, reach / away))
    first, last = (0.5 - (middle + half) / math.tau) * WIDTH - 5, (0.5 - (middle - half) / math.tau) * WIDTH + 5
    near = max(0.1, away - reach)
    heights = [math.atan2(z - CAMERA_HEIGHT_M, d) for z in (item.z, item.top + 0.15) for d in (near, away + reach)]
    low, high = ((0.5 - pitch / math.pi) * HEIGHT for pitch in (max(heights), min(heights)))
    return np.arange(int(first), int(last) + 1) % WIDTH, slice(max(0, int(low) - 5), int(high) + 6)


def painted(world: World, x: float, y: float) -> list[WorldObject]:
    return [
        item
        for item in world.objects
        if item.name in PAINT
        and math.hypot(item.x - x, item.y - y) < 3.5
        and world.visible(x, y, CAMERA_HEIGHT_M, item)
    ]


def test_things_appear_at_their_bearing_and_height(renderer: PanoramaRenderer) -> None:
    world, checked = renderer.world, 0
    for index, room in enumerate(world.rooms):
        x, y = roomiest(world, room)
        yaw = index * 1.3 - 2.0
        hue, saturation, value = hsv(renderer.render(x, y, yaw, CAMERA_HEIGHT_M))
        for item in painted(world, x, y):
            if sum(other.name == item.name for other in world.objects) > 1:
                continue
            mask = in_band(hue, item.name) & (saturation > MIN_PAINT_SATURATION) & (value > DARK)
            rows, columns = np.nonzero(mask)
            bearings = (0.5 - (columns + 0.5) / WIDTH) * math.tau
            seen = math.atan2(np.sin(bearings).sum(), np.cos(bearings).sum())
            pitch = (0.5 - (rows.mean() + 0.5) / HEIGHT) * math.pi
            away = math.hypot(item.x - x, item.y - y)
            right = math.atan2(item.y - y, item.x - x) - yaw
            assert abs(math.remainder(seen - right, math.tau)) < 0.12 * max(item.size[:2]) + 0.03, item
            assert abs(pitch - math.atan2(item.z + item.size[2] / 2 - CAMERA_HEIGHT_M, away)) < 0.08, item
            checked += 1
    assert checked >= 3


def test_painted_things_keep_their_hue_through_the_encoder_and_nothing_else_has_it(
    renderer: PanoramaRenderer,
) -> None:
    world, checked = renderer.world, 0
    for room in world.rooms:
        x, y = roomiest(world, room)
        hue, saturation, value = hsv(through_the_camera(renderer.render(x, y, 0.0, CAMERA_HEIGHT_M)))
        elsewhere = value > DARK
        for item in world.objects:
            if item.name in PAINT:
                columns, rows = outline(item, x, y, 0.0)
                band = elsewhere[rows]
                band[:, columns] = False
        for item in painted(world, x, y):
            columns, rows = outline(item, x, y, 0.0)
            colours = np.array([part[rows][:, columns].ravel() for part in (hue, saturation, value)])
            coloured = colours[:, (colours[1] > 0.5) & (colours[2] > DARK)]
            own = in_band(coloured[0], item.name) & (coloured[1] >= MIN_PAINT_SATURATION)
            assert own.sum() >= 60, item
            assert own.mean() > 0.5, item
            checked += 1
        for name in PAINT:
            alike = in_band(hue, name) & elsewhere
            # A little ringing of the encoder around wood and books; never anything that looks like paint.
            assert (alike & (saturation > MAX_OTHER_SATURATION + 0.1)).mean() < 5e-4, (room.name, name)
            spots = (alike & (saturation > MIN_PAINT_SATURATION)).astype(np.uint8)
            sizes = cv2.connectedComponentsWithStats(spots)[2][1:, cv2.CC_STAT_AREA]
            assert sizes.max(initial=0) < 25, (room.name, name)
    assert checked >= 4


def test_the_left_of_the_robot_is_left_of_the_centre(renderer: PanoramaRenderer) -> None:
    x, y = roomiest(renderer.world, renderer.world.rooms[0])
    ahead = renderer.render(x, y, 0.4, CAMERA_HEIGHT_M)
    turned_left = renderer.render(x, y, 0.4 + math.radians(45), CAMERA_HEIGHT_M)
    # Turning left moves what is seen to the right. The robot's own body, below, turns along.
    moved = np.roll(ahead, WIDTH // 8, axis=1)
    same = np.abs(moved[:600].astype(int) - turned_left[:600]).mean()
    other = np.abs(ahead[:600].astype(int) - turned_left[:600]).mean()
    assert same < 4.0 < other


def test_the_same_place_gives_the_same_picture_and_the_ends_meet(renderer: PanoramaRenderer) -> None:
    x, y = roomiest(renderer.world, renderer.world.rooms[0])
    first = renderer.render(x, y, 1.0, CAMERA_HEIGHT_M)
    assert first.shape == (HEIGHT, WIDTH, 3)
    assert first.dtype == np.uint8
    assert (renderer.render(x, y, 1.0, CAMERA_HEIGHT_M) == first).all()
    across = np.abs(first[:, 0].astype(int) - first[:, -1])
    within = np.abs(first[:, 1:].astype(int) - first[:, :-1]).mean()
    assert across.mean() < 3 * within + 1


def test_two_renderers_do_not_disturb_each_other() -> None:
    world = build_world("home", 5)
    one, other = PanoramaRenderer(world, 480, 240, face=128), PanoramaRenderer(world, 480, 240, face=128)
    place = (world.start.x, world.start.y, 0.0, CAMERA_HEIGHT_M)
    before = one.render(*place)
    other.render(world.start.x, world.start.y, 2.0, 1.0)
    assert (one.render(*place) == before).all()
    assert (other.render(*place) == before).all()
    one.close()
    other.close()


def test_the_cube_map_looks_where_each_pixel_points() -> None:
    side, width, height = 128, 480, 240
    atlas = np.zeros((round(ATLAS[1] * side), round(ATLAS[0] * side), 3), np.float32)
    for face in FACES:
        size = round(face.size * side)
        reach = math.tan(math.radians(face_fov_deg(size)) / 2)
        right, up = np.meshgrid(*(2 * [(np.arange(size) + 0.5) / size * 2 * reach - reach]))
        pitch, heading = math.radians(face.pitch_deg), math.radians(face.heading_deg)
        level = math.cos(pitch) - up * math.sin(pitch)
        ray = np.dstack(
            (
                level * math.cos(heading) + right * math.sin(heading),
                level * math.sin(heading) - right * math.cos(heading),
                math.sin(pitch) + up * math.cos(pitch),
            )
        )
        row, column = round(face.row * side), round(face.column * side)
        atlas[row : row + size, column : column + size] = ray / np.linalg.norm(ray, axis=2, keepdims=True)
    seen = CubeMap.build(width, height, side).panorama(np.round(atlas * 100 + 128).astype(np.uint8))
    assert np.abs(seen - (directions(width, height) * 100 + 128)).max() < 4.0


@pytest.mark.parametrize("name", MAKERS)
def test_textures_are_powers_of_two_and_repeat_for_a_seed(name: str) -> None:
    texture = make_texture(name, 1)
    assert all(side & (side - 1) == 0 for side in texture.shape[:2])
    assert (texture == make_texture(name, 1)).all()


def test_every_kind_of_thing_has_a_model() -> None:
    assert set(CATALOGUE) == set(BUILDERS)
