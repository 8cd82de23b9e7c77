"""The shell of a building: rooms, walls with their door openings, windows. All of it axis-aligned."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

WALL_THICKNESS_M = 0.12
CEILING_M = 2.60
DOOR_HEIGHT_M = 2.08

Side = Literal["n", "s", "e", "w"]

FACING: dict[Side, float] = {"n": 0.0, "s": math.pi, "w": math.pi / 2, "e": -math.pi / 2}
"""Yaw of a thing that stands with its back to that side of a room."""


@dataclass(frozen=True, slots=True)
class Room:
    """A room by its inner rectangle, m."""

    name: str
    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def centre(self) -> tuple[float, float]:
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    def contains(self, x: float, y: float) -> bool:
        return self.x0 <= x <= self.x1 and self.y0 <= y <= self.y1

    def against(self, side: Side, along: float, depth: float, gap: float = 0.02) -> tuple[float, float, float]:
        """x, y, yaw of a thing of that depth with its back to a side, centred at `along` on it."""
        offset = depth / 2 + gap
        x, y = {
            "n": (along, self.y1 - offset),
            "s": (along, self.y0 + offset),
            "e": (self.x1 - offset, along),
            "w": (self.x0 + offset, along),
        }[side]
        return x, y, FACING[side]


@dataclass(frozen=True, slots=True)
class Wall:
    """A straight wall by the ends of its centre line, along x or along y."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def along_x(self) -> bool:
        return self.y0 == self.y1


@dataclass(frozen=True, slots=True)
class Door:
    """An opening in a wall, centred at (x, y); always open. `framed` False is a plain passage."""

    x: float
    y: float
    width: float
    along_x: bool
    framed: bool = True


@dataclass(frozen=True, slots=True)
class Opening:
    """Something in a room's wall that nothing passes: a window or a closed door, centred at `along`."""

    kind: Literal["window", "closed door"]
    room: str
    side: Side
    along: float
    width: float


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """A building of `width` x `depth` m with its lower left corner at the origin."""

    width: float
    depth: float
    rooms: tuple[Room, ...]
    walls: tuple[Wall, ...]
    doors: tuple[Door, ...]
    openings: tuple[Opening, ...]

    def room(self, name: str) -> Room:
        return next(room for room in self.rooms if room.name == name)

    def mirrored(self, *, left_right: bool, front_back: bool) -> FloorPlan:
        """The same building seen in a mirror, along x, along y, or both."""

        def x(value: float) -> float:
            return self.width - value if left_right else value

        def y(value: float) -> float:
            return self.depth - value if front_back else value

        sides: dict[Side, Side] = {}
        sides |= {"e": "w", "w": "e"} if left_right else {}
        sides |= {"n": "s", "s": "n"} if front_back else {}

        def room(one: Room) -> Room:
            (x0, x1), (y0, y1) = sorted((x(one.x0), x(one.x1))), sorted((y(one.y0), y(one.y1)))
            return Room(one.name, x0, y0, x1, y1)

        def wall(one: Wall) -> Wall:
            (x0, x1), (y0, y1) = sorted((x(one.x0), x(one.x1))), sorted((y(one.y0), y(one.y1)))
            return Wall(x0, y0, x1, y1)

        def opening(one: Opening) -> Opening:
            along = x(one.along) if one.side in {"n", "s"} else y(one.along)
            return replace(one, side=sides.get(one.side, one.side), along=along)

        return replace(
            self,
            rooms=tuple(map(room, self.rooms)),
            walls=tuple(map(wall, self.walls)),
            doors=tuple(replace(door, x=x(door.x), y=y(door.y)) for door in self.doors),
            openings=tuple(map(opening, self.openings)),
        )

    def wall_boxes(self) -> tuple[tuple[float, float, float, float], ...]:
        """The solid pieces between the doors, each x0, y0, x1, y1."""
        half = WALL_THICKNESS_M / 2
        boxes = []
        for wall in self.walls:
            start, end = (wall.x0, wall.x1) if wall.along_x else (wall.y0, wall.y1)
            cut = start - half
            for low, high in sorted(_gaps(wall, self.doors)):
                boxes.append(_piece(wall, cut, low, half))
                cut = high
            boxes.append(_piece(wall, cut, end + half, half))
        return tuple(boxes)


def room_from_centre_lines(name: str, x0: float, y0: float, x1: float, y1: float) -> Room:
    """The room between four wall centre lines."""
    half = WALL_THICKNESS_M / 2
    return Room(name, x0 + half, y0 + half, x1 - half, y1 - half)


def _gaps(wall: Wall, doors: tuple[Door, ...]) -> list[tuple[float, float]]:
    gaps = []
    for door in doors:
        if door.along_x != wall.along_x:
            continue
        across, along = (door.y, door.x) if wall.along_x else (door.x, door.y)
        line, start, end = (wall.y0, wall.x0, wall.x1) if wall.along_x else (wall.x0, wall.y0, wall.y1)
        if abs(across - line) < WALL_THICKNESS_M and start < along < end:
            gaps.append((along - door.width / 2, along + door.width / 2))
    return gaps


def _piece(wall: Wall, low: float, high: float, half: float) -> tuple[float, float, float, float]:
    if wall.along_x:
        return low, wall.y0 - half, high, wall.y0 + half
    return wall.x0 - half, low, wall.x0 + half, high
