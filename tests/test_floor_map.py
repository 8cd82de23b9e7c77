from __future__ import annotations

import base64
import math

import cv2
import numpy as np
import pytest

from ghal360_robot.floor_map import (
    CELLS,
    FREE_GREY,
    MAX_PATH,
    OCCUPIED_GREY,
    RESOLUTION_M,
    UNKNOWN_GREY,
    FloorMap,
)

YAWS = np.radians(np.arange(-135, 136, 1.5))


def grey(floor: FloorMap, x: float, y: float) -> int:
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(floor.png()), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    column, row = (
        math.floor((value - corner) / RESOLUTION_M) for value, corner in zip((x, y), floor.corner, strict=True)
    )
    return int(picture[CELLS - 1 - row, column])


def look(floor: FloorMap, pose: tuple[float, float, float], ranges_m: float = 3.0, times: int = 5) -> None:
    for _ in range(times):
        floor.add(pose, YAWS, np.full(len(YAWS), ranges_m))


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, -2.0])
def test_the_floor_up_to_what_is_seen_is_free_and_what_is_behind_unknown(yaw: float) -> None:
    floor = FloorMap()
    look(floor, (1.0, -2.0, yaw))

    def ahead(distance: float, turn: float = 0.0) -> int:
        return grey(floor, 1.0 + distance * math.cos(yaw + turn), -2.0 + distance * math.sin(yaw + turn))

    assert ahead(2.0) == FREE_GREY
    assert ahead(3.0) == OCCUPIED_GREY
    assert ahead(4.0) == UNKNOWN_GREY
    assert ahead(2.0, math.pi) == UNKNOWN_GREY


def test_what_has_gone_is_forgotten() -> None:
    floor = FloorMap()
    look(floor, (0.0, 0.0, 0.0), 2.0)
    look(floor, (0.0, 0.0, 0.0), 5.0, times=40)
    assert grey(floor, 2.0, 0.0) == FREE_GREY


def test_a_beam_that_saw_nothing_says_nothing() -> None:
    floor = FloorMap()
    look(floor, (0.0, 0.0, 0.0), 0.0)
    assert grey(floor, 2.0, 0.0) == UNKNOWN_GREY


def test_odometry_that_begins_anew_begins_a_new_map() -> None:
    floor = FloorMap()
    look(floor, (5.0, 0.0, 0.0))
    look(floor, (0.0, 0.0, math.pi))
    assert grey(floor, 7.0, 0.0) == UNKNOWN_GREY
    assert grey(floor, -2.0, 0.0) == FREE_GREY
    assert floor.path == [(0.0, 0.0)]


def test_the_map_goes_along_with_the_robot() -> None:
    floor = FloorMap()
    for x in np.arange(0.0, 60.0, 0.5):
        look(floor, (float(x), 0.0, 0.0), times=1)
    assert grey(floor, 58.0, 0.0) == FREE_GREY
    assert floor.corner[0] > 20.0
    assert len(floor.path) <= MAX_PATH


@pytest.mark.parametrize("pose", [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (1e9, -1e9, 1.0)])
def test_a_wild_pose_breaks_nothing(pose: tuple[float, float, float]) -> None:
    floor = FloorMap()
    look(floor, (0.0, 0.0, 0.0))
    look(floor, pose)
    assert floor.png()
