"""Triangles with texture, colour and normal, built from boxes, tubes and sheets in an object's own frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

Colour = tuple[float, float, float]
Point = tuple[float, float, float]
WHITE: Colour = (1.0, 1.0, 1.0)
PLAIN = "plain"
"""Name of the all-white texture."""
FACES = ("front", "back", "left", "right", "top", "bottom")


@dataclass(frozen=True, slots=True)
class Surface:
    """What a part is made of: texture, tint, and how many metres one texture repeat covers."""

    texture: str = PLAIN
    colour: Colour = WHITE
    metres: float = 1.0
    glows: bool = False
    """Shown at its own brightness, whatever the light (lamps, screens, windows)."""
    alpha: float = 1.0


@dataclass(frozen=True, slots=True)
class Section:
    """One outline of a `loft`: an ellipse for power 1, nearer to a rectangle below it; metres."""

    z: float
    half_width: float
    half_depth: float
    y: float = 0.0
    power: float = 0.6


@dataclass(slots=True)
class Batch:
    """All triangles of one texture: `points`, `normals` (n, 3), `uv` (n, 2), `colours` (n, 4), `glow` (n,)."""

    points: list[Floats] = field(default_factory=list)
    normals: list[Floats] = field(default_factory=list)
    uv: list[Floats] = field(default_factory=list)
    colours: list[Floats] = field(default_factory=list)
    glow: list[NDArray[np.bool_]] = field(default_factory=list)
    triangles: list[NDArray[np.int64]] = field(default_factory=list)
    count: int = 0


class Mesh:
    """Collects geometry in world coordinates, by texture."""

    def __init__(self) -> None:
        self.batches: dict[str, Batch] = {}

    def at(self, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Frame:
        """A local frame to build in."""
        cos, sin = math.cos(yaw), math.sin(yaw)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return Frame(self, turn, np.array([x, y, z], float))

    def add(self, points: Floats, normals: Floats, uv: Floats, triangles: NDArray[np.int64], surface: Surface) -> None:
        """Append triangles (m, 3) that index `points` (n, 3), counter-clockwise seen from outside."""
        batch = self.batches.setdefault(surface.texture, Batch())
        n = len(points)
        batch.points.append(points)
        batch.normals.append(normals)
        batch.uv.append(uv)
        batch.colours.append(np.tile(np.array([*surface.colour, surface.alpha]), (n, 1)))
        batch.glow.append(np.full(n, surface.glows))
        batch.triangles.append(triangles + batch.count)
        batch.count += n


@dataclass(frozen=True, slots=True)
class Frame:
    """A place in the world with its own axes: x right, y back (the front looks along -y), z up."""

    mesh: Mesh
    turn: Floats
    origin: Floats

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0, *, yaw: float = 0.0, pitch: float = 0.0) -> Frame:
        """A frame inside this one; positive pitch leans its top backwards (towards its +y)."""
        cos, sin, c, s = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
        about_z = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
        return Frame(self.mesh, self.turn @ about_z @ about_x, self.origin + self.turn @ np.array([x, y, z]))

    def quad(self, corners: Sequence[Point], surface: Surface, uv: Sequence[tuple[float, float]] | None = None) -> None:
        """Four corners, counter-clockwise seen from the front; `uv` spans the whole texture unless given."""
        points = np.array(corners, float)
        normal = np.cross(points[1] - points[0], points[3] - points[0])
        length = float(np.linalg.norm(normal))
        normals = np.tile(normal / length if length else normal, (4, 1))
        texture_at = np.array(uv if uv is not None else [(0, 0), (1, 0), (1, 1), (0, 1)], float)
        self._emit(points, normals, texture_at, np.array([[0, 1, 2], [0, 2, 3]]), surface)

    def sheet(
        self,
        corner: Point,
        right: Point,
        up: Point,
        surface: Surface,
        *,
        steps: tuple[int, int] = (1, 1),
        whole: bool = False,
        start: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """A subdivided rectangle from its lower left corner, seen from `right` x `up`.

        The texture repeats by metres along both edges from `start`, or covers the sheet once if `whole`.
        """
        a, b = np.linspace(0.0, 1.0, steps[0] + 1), np.linspace(0.0, 1.0, steps[1] + 1)
        aa, bb = (part.ravel() for part in np.meshgrid(a, b))
        edge_r, edge_u = np.array(right, float), np.array(up, float)
        points = np.array(corner, float) + aa[:, None] * edge_r + bb[:, None] * edge_u
        normal = np.cross(edge_r, edge_u)
        normals = np.tile(normal / np.linalg.norm(normal), (len(points), 1))
        scale = (
            (1.0, 1.0) if whole else (np.linalg.norm(edge_r) / surface.metres, np.linalg.norm(edge_u) / surface.metres)
        )
        shift = (start[0] / surface.metres, start[1] / surface.metres)
        uv = np.column_stack((aa * scale[0] + shift[0], bb * scale[1] + shift[1]))
        self._emit(points, normals, uv, _grid_triangles(steps[0], steps[1]), surface)

    def box(
        self,
        x: float,
        y: float,
        z: float,
        size: Point,
        surface: Surface,
        *,
        front: Surface | None = None,
        top: Surface | None = None,
        skip: Sequence[str] = ("bottom",),
    ) -> None:
        """An upright box centred at (x, y) with its bottom at z; `front` and `top` may differ and show whole."""
        w, d, h = size[0] / 2, size[1] / 2, size[2]
        sides: dict[str, tuple[Point, Point, Point]] = {
            "front": ((-w, -d, 0), (2 * w, 0, 0), (0, 0, h)),
            "back": ((w, d, 0), (-2 * w, 0, 0), (0, 0, h)),
            "left": ((-w, d, 0), (0, -2 * d, 0), (0, 0, h)),
            "right": ((w, -d, 0), (0, 2 * d, 0), (0, 0, h)),
            "top": ((-w, -d, h), (2 * w, 0, 0), (0, 2 * d, 0)),
            "bottom": ((-w, d, 0), (2 * w, 0, 0), (0, -2 * d, 0)),
        }
        special = {"front": front, "top": top}
        for name in FACES:
            if name in skip:
                continue
            corner, right, up = sides[name]
            own = special.get(name)
            shifted = (corner[0] + x, corner[1] + y, corner[2] + z)
            rise = 2 if name not in {"top", "bottom"} and h > 0.3 else 1
            self.sheet(shifted, right, up, own or surface, whole=own is not None, steps=(1, rise))

    def tube(
        self,
        x: float,
        y: float,
        z: float,
        profile: Sequence[tuple[float, float]],
        surface: Surface,
        *,
        sides: int = 12,
        squash: float = 1.0,
    ) -> None:
        """A turned body: `profile` lists (radius, height above z) from bottom to top, outside seen."""
        angles = np.linspace(0.0, math.tau, sides + 1)
        ring = np.column_stack((np.cos(angles), squash * np.sin(angles)))
        radii, heights = np.array(profile, float).T
        points = np.concatenate(
            [np.column_stack((ring * radius, np.full(sides + 1, height))) for radius, height in profile]
        )
        slope = np.gradient(radii, np.arange(len(radii))), np.gradient(heights, np.arange(len(heights)))
        lift = -slope[0] / np.maximum(np.hypot(*slope), 1e-9)
        normals = np.concatenate(
            [np.column_stack((ring * math.sqrt(max(0.0, 1 - up * up)), np.full(sides + 1, up))) for up in lift]
        )
        v = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(radii), np.diff(heights)))))
        uv = np.column_stack((np.tile(angles / math.tau, len(radii)), np.repeat(v / surface.metres, sides + 1)))
        self._emit(points + np.array([x, y, z]), normals, uv, _grid_triangles(sides, len(radii) - 1), surface)

    def blob(self, x: float, y: float, z: float, radii: Point, surface: Surface, *, power: float = 1.0) -> None:
        """A soft body, bottom at z: an ellipsoid for power 1, more like a pillow below it."""
        rings, sides = 6, 12
        latitude = np.linspace(-math.pi / 2, math.pi / 2, rings + 1)
        angles = np.linspace(0.0, math.tau, sides + 1)
        lat, lon = (part.ravel() for part in np.meshgrid(latitude, angles, indexing="ij"))
        unit = np.column_stack((np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)))
        shaped = np.sign(unit) * np.abs(unit) ** power
        points = shaped * radii + (x, y, z + radii[2])
        normals = unit / np.linalg.norm(unit, axis=1, keepdims=True)
        uv = np.column_stack((lon / math.tau * 2.0, lat / math.pi + 0.5))
        self._emit(points, normals, uv, _grid_triangles(sides, rings), surface)

    def loft(self, sections: Sequence[Section], surface: Surface, *, sides: int = 20) -> None:
        """A body through rounded outlines, bottom to top; the texture goes round it once, the front in its middle."""
        angles = math.pi / 2 + np.linspace(0.0, math.tau, sides + 1)
        ring = np.column_stack((np.cos(angles), np.sin(angles)))
        rows = [
            np.column_stack(
                (
                    np.sign(ring) * np.abs(ring) ** part.power * (part.half_width, part.half_depth) + (0.0, part.y),
                    np.full(sides + 1, part.z),
                )
            )
            for part in sections
        ]
        grid = np.array(rows)
        around = np.roll(grid[:, :-1], -1, axis=1) - np.roll(grid[:, :-1], 1, axis=1)
        normals = np.cross(np.concatenate((around, around[:, :1]), axis=1), np.gradient(grid, axis=0))
        normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
        u, v = np.meshgrid(np.linspace(0.0, 1.0, sides + 1), np.linspace(0.0, 1.0, len(sections)))
        uv = np.column_stack((u.ravel(), v.ravel()))
        triangles = _grid_triangles(sides, len(sections) - 1)
        self._emit(grid.reshape(-1, 3), normals.reshape(-1, 3), uv, triangles, surface)

    def _emit(
        self, points: Floats, normals: Floats, uv: Floats, triangles: NDArray[np.int64], surface: Surface
    ) -> None:
        self.mesh.add(points @ self.turn.T + self.origin, normals @ self.turn.T, uv, triangles, surface)


def _grid_triangles(across: int, along: int) -> NDArray[np.int64]:
    """Two triangles per cell of a grid of (along + 1) rows with (across + 1) points each."""
    row, column = (part.ravel() for part in np.mgrid[0:along, 0:across])
    low = row * (across + 1) + column
    high = low + across + 1
    return np.concatenate((np.column_stack((low, low + 1, high + 1)), np.column_stack((low, high + 1, high))))
