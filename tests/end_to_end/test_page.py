"""The page in a real browser on a simulated robot: what it shows, and how it lets go."""

from __future__ import annotations

import asyncio
import math
import time
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from ghal360_robot.bench.browser import chromium
from ghal360_robot.perception.sphere import PictureSize, direction_of_pixel
from tests.end_to_end.page_robot import WHY_NOT, opened, page_robot, turning

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from ghal360_robot.bench.browser import Tab

pytestmark = [pytest.mark.alone, pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)]

SIZE = PictureSize(1920, 960)
WALLS = {0.0: "red", 90.0: "green", 180.0: "blue", -90.0: "yellow"}
COLORS = {"red": (40, 40, 200), "green": (60, 160, 40), "blue": (200, 90, 30), "yellow": (40, 200, 220)}
WHITE, BLACK = (250, 250, 250), (10, 10, 10)
TO_ZERO_MS = 300.0


def wall_at(yaw_deg: float) -> str:
    return min(WALLS.items(), key=lambda wall: abs((wall[0] - yaw_deg + 180) % 360 - 180))[1]


def coloured_room(folder: Path) -> None:
    """A panorama of four walls 90 degrees wide, white above and black below."""
    picture = np.zeros((SIZE.height, SIZE.width, 3), np.uint8)
    yaws, _ = direction_of_pixel(np.arange(SIZE.width) + 0.5, SIZE.height / 2, SIZE)
    for column, yaw in enumerate(yaws):
        picture[:, column] = COLORS[wall_at(math.degrees(yaw))]
    picture[: SIZE.height // 4] = WHITE
    picture[-SIZE.height // 4 :] = BLACK
    cv2.imwrite(str(folder / "room.png"), picture)


def name_of(pixel: NDArray[np.uint8]) -> str:
    known = {**COLORS, "white": WHITE, "black": BLACK}
    return min(known, key=lambda name: math.dist(known[name], pixel.astype(float)))


async def look(tab: Tab) -> dict[str, Any]:
    """The view once it has come to rest."""
    await tab.until("telepresence.settled")
    await tab.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    now = await tab.evaluate("(({yaw, pitch, fovV, fovH}) => ({yaw, pitch, fovV, fovH}))(telepresence)")
    return {name: math.degrees(value) for name, value in now.items()}


async def test_the_picture_is_around_the_operator_the_right_way_round(tmp_path: Path) -> None:
    """By its pixels, in four directions, up and down; and drag, keys and slider move it by the right angle."""
    images = tmp_path / "images"
    images.mkdir()
    coloured_room(images)
    async with chromium() as browser, page_robot(tmp_path, "--camera-images", str(images)) as robot:
        tab = await opened(await browser.tab(), robot.url)
        for _ in range(4):
            view = await look(tab)
            seen = name_of((await tab.picture())[360, 640])
            assert seen == wall_at(view["yaw"]), f"{seen} at {view}"
            for _ in range(6):
                await tab.press("ArrowLeft")
        assert (await look(tab))["yaw"] == pytest.approx(0, abs=0.5)

        before = await look(tab)
        await tab.drag((500, 400), (200, -48))
        after = await look(tab)
        per_pixel = before["fovV"] / 720
        assert after["yaw"] - before["yaw"] == pytest.approx(200 * per_pixel, abs=0.3)
        assert after["pitch"] - before["pitch"] == pytest.approx(-48 * per_pixel, abs=0.3)
        await tab.press("Home")
        for key, expected in (("ArrowUp", "white"), ("ArrowDown", "black")):
            for _ in range(5):
                await tab.press(key)
            view = await look(tab)
            assert abs(view["pitch"]) == pytest.approx(75, abs=0.5)
            assert name_of((await tab.picture())[360, 640]) == expected
            await tab.press("Home")
            await look(tab)

        for fov in (40, 90):
            await tab.evaluate(
                f"(slider => {{ slider.value = {fov}; slider.dispatchEvent(new Event('input')); }})"
                "(document.querySelector('#fov'))"
            )
            await tab.press("Home")
            for _ in range(2):
                await tab.press("ArrowLeft")
            view = await look(tab)
            assert view["fovV"] == pytest.approx(fov)
            assert view["yaw"] == pytest.approx(30, abs=0.5)
            row = [name_of(pixel) for pixel in (await tab.picture())[300]]
            edge = next(x for x in range(640, 0, -1) if row[x] == "green")
            expected_x = 640 * (1 - math.tan(math.radians(15)) / math.tan(math.radians(view["fovH"] / 2)))
            assert edge == pytest.approx(expected_x, abs=8)
        assert tab.console == []


async def key_up(tab: Tab) -> None:
    await tab.key("up", "a")


async def window_left(tab: Tab) -> None:
    await tab.evaluate("dispatchEvent(new Event('blur'))")


async def tab_hidden(tab: Tab) -> None:
    other = await tab.browser.tab()
    await other.show()


async def page_closed(tab: Tab) -> None:
    await tab.close()


RELEASES: dict[str, Callable[[Tab], Awaitable[None]]] = {
    "key up": key_up,
    "window left": window_left,
    "tab hidden": tab_hidden,
    "page closed": page_closed,
}


async def test_however_the_driver_lets_go_the_base_is_told_zero_within_300_ms(tmp_path: Path) -> None:
    """Measured on the bus; a key that is still down drives no further."""
    released: dict[str, int] = {}
    async with chromium() as browser, page_robot(tmp_path) as robot:
        tab = await opened(await browser.tab(size=(640, 360)), robot.url)
        for name, release in RELEASES.items():
            await turning(tab)
            released[name] = time.monotonic_ns()
            await release(tab)
            await asyncio.sleep(1.0)
            if name != "page closed":
                await tab.show()
                await tab.key("up", "a")
    motion = robot.motion()
    late = {}
    for name, instant in released.items():
        moving = [stamp for stamp, pair in motion if instant <= stamp < instant + 900_000_000 and any(pair)]
        late[name] = (max(moving, default=instant) - instant) / 1e6
    assert all(ms <= TO_ZERO_MS for ms in late.values()), late
    assert any(pair[1] for _, pair in motion)
