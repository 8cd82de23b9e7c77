"""The shell of a building as geometry: floors, walls with windows and door frames, ceilings with lamps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

from ghal360_robot.simulation.meshes import Colour, Frame, Mesh, Surface
from ghal360_robot.simulation.rooms import (
    CEILING_M,
    DOOR_HEIGHT_M,
    WALL_THICKNESS_M,
    Door,
    FloorPlan,
    Opening,
    Room,
    Side,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

SIDES: tuple[Side, ...] = ("n", "s", "e", "w")
STEP_M = 0.4
"""Walls, floors and ceilings are cut this fine, so that light can vary over them."""
LEVELS_M = (0.2, 0.5, 1.0, 1.5, 2.0, 2.2, 2.4)
"""Walls are cut at these heights everywhere, so that neighbouring pieces meet in the same light."""
TRIM = Surface("plain", (0.93, 0.93, 0.92))
CASING_M = 0.08
HEAD_M = 2.20
"""Upper edge of windows."""
REVEAL_M = 0.16
"""How deep the glass sits behind the wall's face."""


@dataclass(frozen=True, slots=True)
class Style:
    """How one room looks."""

    floor: Surface
    wall: Colour
    lamp: Literal["panel", "disc"]
    view: Literal["landscape", "skyline"]
    sill: float = 0.85
    curtain: Colour | None = None


CARPET = Surface("carpet", (0.47, 0.49, 0.52), 1.2)
OAK_FLOOR = Surface("planks", (0.86, 0.752, 0.638), 2.4)
WALNUT_FLOOR = Surface("planks", (0.69, 0.598, 0.510), 2.4)
TILES = Surface("tiles", (0.86, 0.85, 0.83), 1.6)

STYLES: dict[str, Style] = {
    "open plan": Style(CARPET, (0.93, 0.93, 0.91), "panel", "skyline"),
    "meeting room": Style(Surface("carpet", (0.42, 0.45, 0.43), 1.2), (0.86, 0.89, 0.87), "panel", "skyline"),
    "corridor": Style(Surface("tiles", (0.72, 0.72, 0.71), 2.4), (0.95, 0.94, 0.91), "panel", "skyline"),
    "lounge": Style(OAK_FLOOR, (0.88, 0.86, 0.80), "panel", "skyline", 0.6),
    "manager's office": Style(WALNUT_FLOOR, (0.84, 0.86, 0.89), "panel", "skyline"),
    "kitchenette": Style(TILES, (0.91, 0.93, 0.90), "panel", "skyline", 1.0),
    "living room": Style(OAK_FLOOR, (0.93, 0.90, 0.84), "disc", "landscape", 0.45, (0.74, 0.72, 0.66)),
    "kitchen": Style(TILES, (0.90, 0.92, 0.88), "disc", "landscape", 1.0),
    "hall": Style(WALNUT_FLOOR, (0.90, 0.90, 0.91), "disc", "landscape"),
    "bedroom": Style(OAK_FLOOR, (0.83, 0.85, 0.89), "disc", "landscape", 0.75, (0.60, 0.63, 0.70)),
    "study": Style(WALNUT_FLOOR, (0.82, 0.86, 0.81), "disc", "landscape", 0.75, (0.80, 0.78, 0.74)),
}


@dataclass(frozen=True, slots=True)
class Light:
    """A lamp (`facing` down) or a window (`facing` into the room), with its strength."""

    at: tuple[float, float, float]
    facing: tuple[float, float, float]
    strength: float


def add_room(mesh: Mesh, plan: FloorPlan, room: Room) -> list[Light]:
    """Floor, ceiling, lamps and the four walls of one room; returns what lights it."""
    style = STYLES[room.name]
    lights = _lamps(mesh, room, style)
    width, depth = room.x1 - room.x0, room.y1 - room.y0
    steps = (math.ceil(width / STEP_M), math.ceil(depth / STEP_M))
    base = mesh.at(room.x0, room.y0)
    base.sheet((0, 0, 0), (width, 0, 0), (0, depth, 0), style.floor, steps=steps)
    panelled = style.lamp == "panel"
    above = Surface("ceiling", (0.97, 0.97, 0.96), 1.2) if panelled else Surface("plaster", (0.97, 0.97, 0.95), 2.0)
    base.sheet((0, depth, CEILING_M), (width, 0, 0), (0, -depth, 0), above, steps=steps)
    for side in SIDES:
        lights += _wall(mesh, plan, room, side, style)
    return lights


def _lamps(mesh: Mesh, room: Room, style: Style) -> list[Light]:
    lights = []
    for x, y in _lamp_places(room, 2.4 if style.lamp == "panel" else 3.6):
        frame = mesh.at(x, y, CEILING_M)
        if style.lamp == "panel":
            frame.box(0, 0, -0.035, (1.24, 0.34, 0.03), TRIM, skip=("top", "bottom"))
            glow = Surface("plain", (1.0, 1.0, 0.985), glows=True)
            frame.sheet((-0.6, 0.15, -0.035), (1.2, 0, 0), (0, -0.3, 0), glow)
        else:
            frame.tube(0, 0, -0.06, [(0.24, 0.02), (0.25, 0.06)], TRIM, sides=20)
            frame.tube(0, 0, -0.10, [(0.001, 0.0), (0.16, 0.015), (0.23, 0.05), (0.24, 0.07)],
                       Surface("plain", (1.0, 0.985, 0.95), glows=True), sides=20)  # fmt: skip
        lights.append(Light((x, y, CEILING_M - 0.1), (0.0, 0.0, -1.0), 0.95))
    return lights


def _lamp_places(room: Room, apart: float) -> Iterator[tuple[float, float]]:
    columns = max(1, round((room.x1 - room.x0) / apart))
    rows = max(1, round((room.y1 - room.y0) / apart))
    for column in range(columns):
        for row in range(rows):
            x = room.x0 + (column + 0.5) * (room.x1 - room.x0) / columns
            yield x, room.y0 + (row + 0.5) * (room.y1 - room.y0) / rows


def side_frame(mesh: Mesh, room: Room, side: Side) -> tuple[Frame, float, tuple[float, float], float]:
    """The frame in the middle of a side (x along the wall, -y into the room), its length, centre and yaw."""
    cx, cy = room.centre
    x, y, yaw = room.against(side, cx if side in {"n", "s"} else cy, 0.0, 0.0)
    length = room.x1 - room.x0 if side in {"n", "s"} else room.y1 - room.y0
    return mesh.at(x, y, 0.0, yaw), length, (x, y), yaw


def _wall(mesh: Mesh, plan: FloorPlan, room: Room, side: Side, style: Style) -> list[Light]:
    frame, length, (x, y), yaw = side_frame(mesh, room, side)
    cos, sin = math.cos(yaw), math.sin(yaw)

    def along(px: float, py: float) -> float:
        return (px - x) * cos + (py - y) * sin

    holes: list[tuple[float, float, float, float]] = []
    lights = []
    for door in plan.doors:
        across = abs(-(door.x - x) * sin + (door.y - y) * cos)
        if across < WALL_THICKNESS_M and abs(along(door.x, door.y)) < length / 2:
            holes.append((along(door.x, door.y), door.width, 0.0, DOOR_HEIGHT_M))
    for opening in plan.openings:
        if opening.room != room.name or opening.side != side:
            continue
        px, py, _ = room.against(side, opening.along, 0.0, 0.0)
        middle = along(px, py)
        if opening.kind == "window":
            holes.append((middle, opening.width, style.sill, HEAD_M))
            _window(frame, middle, opening, style)
            inward = (math.sin(yaw), -math.cos(yaw), 0.0)
            area = opening.width * (HEAD_M - style.sill)
            lights.append(Light((px, py, (style.sill + HEAD_M) / 2), inward, 0.30 * area))
        else:
            _closed_door(frame, middle, opening.width)
    wall = Surface("plaster", style.wall, 2.0)
    doors = sorted((m - w / 2, m + w / 2) for m, w, low, _ in holes if low == 0.0)
    _wall_face(frame, length, holes, wall)
    for start, end in _between(-length / 2, length / 2, doors):
        if end - start > 0.02:
            frame.box((start + end) / 2, -0.007, 0.0, (end - start, 0.014, 0.085), TRIM, skip=("bottom", "back"))
    return lights


def _between(start: float, end: float, cuts: list[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    for low, high in cuts:
        yield start, low
        start = high
    yield start, end


def _wall_face(frame: Frame, length: float, holes: list[tuple[float, float, float, float]], surface: Surface) -> None:
    """The wall around its holes (middle, width, low, high), in cells for the light."""
    us = sorted({-length / 2, length / 2, *(e for m, w, _, _ in holes for e in (m - w / 2, m + w / 2))})
    for a, b in pairwise(us):
        middle = (a + b) / 2
        hole = next((h for h in holes if abs(middle - h[0]) < h[1] / 2), None)
        spans = [(0.0, CEILING_M)] if hole is None else [(0.0, hole[2]), (hole[3], CEILING_M)]
        steps = (math.ceil((b - a) / STEP_M), 1)
        for bottom, top in spans:
            levels = [bottom, *(level for level in LEVELS_M if bottom < level < top), top]
            for low, high in pairwise(levels):
                if high - low > 1e-6:
                    rise = (0.0, 0.0, high - low)
                    frame.sheet((a, 0, low), (b - a, 0, 0), rise, surface, steps=steps, start=(a, low))


def _window(frame: Frame, middle: float, opening: Opening, style: Style) -> None:
    width, low, high = opening.width, style.sill, HEAD_M
    at = frame.at(middle, 0.0, 0.0)
    half, tall = width / 2, high - low
    reveal = Surface("plain", (0.97, 0.97, 0.96))
    # Each window shows another part of the view, in proportion.
    part = min(1.0, width / 2.4)
    shift = (math.sin(opening.along * 7.3) * 0.5 + 0.5) * (1 - part)
    rise = min(1.0, tall / 1.8)
    view = Surface(style.view, (1.0, 1.0, 1.0), glows=True)
    corners = [(-half, REVEAL_M, low), (half, REVEAL_M, low), (half, REVEAL_M, high), (-half, REVEAL_M, high)]
    bottom = 0.55 - 0.55 * rise
    at.quad(
        corners, view, [(shift, bottom), (shift + part, bottom), (shift + part, bottom + rise), (shift, bottom + rise)]
    )
    at.sheet((-half, 0, low), (width, 0, 0), (0, REVEAL_M, 0), reveal)
    at.sheet((-half, REVEAL_M, high), (width, 0, 0), (0, -REVEAL_M, 0), reveal)
    at.sheet((-half, 0, low), (0, REVEAL_M, 0), (0, 0, tall), reveal)
    at.sheet((half, REVEAL_M, low), (0, -REVEAL_M, 0), (0, 0, tall), reveal)
    bar = 0.05
    panes = max(1, round(width / 0.9))
    for index in range(panes + 1):
        at.box(-half + bar / 2 + index * (width - bar) / panes, REVEAL_M - 0.025, low, (bar, 0.05, tall), TRIM)
    for z in (low, high - bar):
        at.box(0, REVEAL_M - 0.03, z, (width, 0.05, bar), TRIM, skip=())
    at.box(0, -0.03, low - 0.035, (width + 0.12, 0.16, 0.035), TRIM, skip=())
    if style.curtain is not None:
        for edge in (-1.0, 1.0):
            _curtain(at.at(edge * (half + 0.16), -0.07, 0.06), style.curtain)
        at.box(0, -0.07, 2.30, (width + 0.8, 0.03, 0.03), Surface("plain", (0.45, 0.44, 0.43)), skip=())


def _curtain(at: Frame, colour: Colour) -> None:
    """A hanging cloth in folds."""
    folds, width, tall = 10, 0.42, 2.24
    for index in range(folds):
        a, b = -width / 2 + width * index / folds, -width / 2 + width * (index + 1) / folds
        ya, yb = (0.03, -0.03) if index % 2 else (-0.03, 0.03)
        shade = 0.86 if index % 2 else 1.0
        cloth = Surface("fabric", (colour[0] * shade, colour[1] * shade, colour[2] * shade), 0.3)
        at.sheet((a, ya, 0), (b - a, yb - ya, 0), (0, 0, tall), cloth, steps=(1, 3))
    edge = Surface("fabric", colour, 0.3)
    at.sheet((-width / 2, 0.06, 0), (0, -0.09, 0), (0, 0, tall), edge)
    at.sheet((width / 2, -0.03, 0), (0, 0.09, 0), (0, 0, tall), edge)


def _closed_door(frame: Frame, middle: float, width: float) -> None:
    at = frame.at(middle, -0.012, 0.0)
    leaf = Surface("door", (0.80, 0.735, 0.65))
    at.sheet((-width / 2, 0, 0.01), (width, 0, 0), (0, 0, DOOR_HEIGHT_M - 0.02), leaf, whole=True, steps=(2, 5))
    _casing(at, width, 0.0)


def _casing(at: Frame, width: float, y: float) -> None:
    """Boards around an opening, on the -y side."""
    for edge in (-1.0, 1.0):
        at.box(edge * (width / 2 + CASING_M / 2), y - 0.008, 0.0, (CASING_M, 0.02, DOOR_HEIGHT_M), TRIM)
    at.box(0, y - 0.008, DOOR_HEIGHT_M, (width + 2 * CASING_M, 0.02, CASING_M), TRIM, skip=())


def add_doorway(mesh: Mesh, door: Door) -> None:
    """Threshold, lining and casings of an open doorway."""
    at = mesh.at(door.x, door.y, 0.0, 0.0 if door.along_x else math.pi / 2)
    half, thick = door.width / 2, WALL_THICKNESS_M
    lining = TRIM if door.framed else Surface("plaster", (0.93, 0.93, 0.91), 2.0)
    threshold = Surface("steel", (0.60, 0.59, 0.57), 0.5)
    at.sheet((-half, -thick / 2, 0.0), (door.width, 0, 0), (0, thick, 0), threshold)
    at.sheet((-half, thick / 2, DOOR_HEIGHT_M), (door.width, 0, 0), (0, -thick, 0), lining)
    at.sheet((-half, -thick / 2, 0), (0, thick, 0), (0, 0, DOOR_HEIGHT_M), lining, steps=(1, 4))
    at.sheet((half, thick / 2, 0), (0, -thick, 0), (0, 0, DOOR_HEIGHT_M), lining, steps=(1, 4))
    if door.framed:
        _casing(at, door.width, -thick / 2)
        _casing(at.at(yaw=math.pi), door.width, -thick / 2)


def illuminate(
    points: NDArray[np.float64], normals: NDArray[np.float64], lights: list[Light], room: Room | None
) -> NDArray[np.float64]:
    """Brightness (n,) of surface points: sky and bounce, lamps, windows, and the gloom of corners and floors."""
    brightness = 0.72 + 0.04 * normals[:, 0] + 0.025 * normals[:, 1]
    # A ceiling lives from what the floor throws back.
    brightness += np.where(normals[:, 2] < -0.7, 0.20, 0.0)
    for light in lights:
        away = np.array(light.at) - points
        distance = np.linalg.norm(away, axis=1)
        direction = away / np.maximum(distance, 1e-6)[:, None]
        facing = np.clip(-(direction @ np.array(light.facing)), 0.0, 1.0)
        # A wide lamp also lights what turns a little away from it.
        towards = np.clip(0.25 + 0.75 * np.einsum("ij,ij->i", direction, normals), 0.0, 1.0)
        brightness += light.strength * 0.34 * facing * towards / (1.0 + (distance / 1.7) ** 2)
    brightness = 1.10 * (1.0 - np.exp(-1.75 * brightness))
    height = points[:, 2]
    sideways = np.abs(normals[:, 2]) < 0.7
    brightness *= np.where(sideways, 0.80 + 0.20 * _smooth(height / 0.5), 1.0)
    brightness *= np.where(sideways, 0.90 + 0.10 * _smooth((CEILING_M - height) / 0.4), 1.0)
    if room is not None:
        inset_x = np.minimum(points[:, 0] - room.x0, room.x1 - points[:, 0])
        inset_y = np.minimum(points[:, 1] - room.y0, room.y1 - points[:, 1])
        level = (height < 0.01) | (height > CEILING_M - 0.01)
        edge = np.where(level, np.minimum(inset_x, inset_y), np.maximum(inset_x, inset_y))
        brightness *= np.where(level | (np.minimum(inset_x, inset_y) < 0.02), 0.82 + 0.18 * _smooth(edge / 0.6), 1.0)
    return np.asarray(brightness)


def _smooth(t: NDArray[np.float64]) -> NDArray[np.float64]:
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))
