"""Six square views around a point become one equirectangular panorama."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Face:
    """One square view: heading (left positive) and pitch in degrees, place and size in the atlas.

    `column`, `row` (from the bottom) and `size` count in widths of a side view.
    """

    heading_deg: float
    pitch_deg: float
    column: float
    row: float
    size: float


FACES = (
    Face(0.0, 0.0, 0.0, 0.0, 1.0),
    Face(90.0, 0.0, 1.0, 0.0, 1.0),
    Face(180.0, 0.0, 0.0, 1.0, 1.0),
    Face(-90.0, 0.0, 1.0, 1.0, 1.0),
    Face(0.0, 90.0, 2.0, 0.0, 0.5),
    Face(0.0, -90.0, 2.0, 0.5, 0.5),
)
"""Four sides, and ceiling and floor at half their resolution: little of interest is there."""
ATLAS = (2.5, 2.0)
"""Width and height of the atlas in widths of a side view."""
MARGIN = 3
"""Pixels around each face that show more than its 90 degrees, so that no seam shows the neighbour."""


def face_fov_deg(size: int) -> float:
    """Field of view of a face of `size` pixels, so that its inner part spans exactly 90 degrees."""
    return math.degrees(2 * math.atan(size / (size - 2 * MARGIN)))


def directions(width: int, height: int) -> NDArray[np.float64]:
    """Unit vectors (h, w, 3) forward, left, up of each panorama pixel; the middle column looks forward."""
    yaw = (0.5 - (np.arange(width) + 0.5) / width) * math.tau
    pitch = (0.5 - (np.arange(height) + 0.5) / height) * math.pi
    yaw, pitch = np.meshgrid(yaw, pitch)
    return np.dstack((np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)))


@dataclass(frozen=True)
class CubeMap:
    """Where each panorama pixel lies in an atlas of faces, whose first row is the bottom one (as drawn)."""

    xy: NDArray[np.int16]
    fraction: NDArray[np.uint16]

    @classmethod
    def build(cls, width: int, height: int, side: int) -> CubeMap:
        """Fixed-point maps for cv2.remap from side views of `side` pixels to width x height."""
        ray = directions(width, height)
        best = np.full(ray.shape[:2], -np.inf)
        map_x, map_y = np.zeros(ray.shape[:2], np.float32), np.zeros(ray.shape[:2], np.float32)
        for face in FACES:
            forward, left, up = _axes(face.heading_deg, face.pitch_deg)
            depth = ray @ forward
            nearer = depth > best
            best[nearer] = depth[nearer]
            half = face.size * side / 2
            scale = (half - MARGIN) / np.where(depth > 1e-6, depth, 1.0)
            x = face.column * side + half - 0.5 - (ray @ left) * scale
            y = face.row * side + half - 0.5 + (ray @ up) * scale
            map_x[nearer], map_y[nearer] = x[nearer], y[nearer]
        xy, fraction = cv2.convertMaps(map_x, map_y, cv2.CV_16SC2)
        return cls(np.asarray(xy, np.int16), np.asarray(fraction, np.uint16))

    def panorama(self, atlas: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The panorama (h, w, channels) of an atlas (rows, columns, channels)."""
        return np.asarray(cv2.remap(atlas, self.xy, self.fraction, cv2.INTER_LINEAR), np.uint8)


def _axes(heading_deg: float, pitch_deg: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    heading, pitch = math.radians(heading_deg), math.radians(pitch_deg)
    forward = np.array([math.cos(heading) * math.cos(pitch), math.sin(heading) * math.cos(pitch), math.sin(pitch)])
    left = np.array([-math.sin(heading), math.cos(heading), 0.0])
    return forward, left, np.cross(forward, left)
