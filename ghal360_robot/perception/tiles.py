"""How a panorama is cut into pictures for a network, and what their boxes mean on the sphere. Pure.

Directions are those of `sphere` with the camera's forward axis as x (`camera_yaw` = 0). Choices and their
measurements: fact sheet on the detector, section 4.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from math import asin, atan2, cos, pi, radians, sin, sqrt, tan, tau
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.angles import wrap
from ghal360_robot.perception.sphere import (
    PictureSize,
    SphereBox,
    direction_of_vector,
    pixel_of_direction,
    wrap_angle,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Picture = NDArray[np.uint8]
    Floats = NDArray[np.float64]

EDGE = 0.012
"""A box that comes this near to an edge of its tile (share of the tile) is cut off by it: 6 pixels of 512."""


@dataclass(frozen=True, slots=True)
class EquirectTile:
    """A piece of the panorama as it is: `width` radians around `yaw`, `height` around `pitch`."""

    yaw: float
    pitch: float
    width: float
    height: float

    def cut(self, panorama: Picture) -> Picture:
        """Its pixels, joined across the seam; a view where it lies within the picture."""
        size = PictureSize(panorama.shape[1], panorama.shape[0])
        left, top, columns, rows = self._pixels(size)
        if left + columns <= size.width:
            return panorama[top : top + rows, left : left + columns]
        beyond = left + columns - size.width
        return np.hstack((panorama[top : top + rows, left:], panorama[top : top + rows, :beyond]))

    def boxes(self, xyxy: ArrayLike, panorama: PictureSize) -> tuple[SphereBox, ...]:
        """Boxes (n, 4) in pixels of the cut as what they cover on the sphere."""
        left, top, _, _ = self._pixels(panorama)
        per_column, per_row = tau / panorama.width, pi / panorama.height
        return tuple(
            SphereBox(
                wrap(pi - (left + (x0 + x1) / 2) * per_column),
                pi / 2 - (top + (y0 + y1) / 2) * per_row,
                (x1 - x0) * per_column,
                (y1 - y0) * per_row,
            )
            for x0, y0, x1, y1 in np.asarray(xyxy, np.float64).reshape(-1, 4).tolist()
        )

    def cuts(self) -> bool:
        """Whether its left and right edges cut through what the neighbouring tiles show whole."""
        return self.width < tau - 1e-9

    def turned(self, yaw: float) -> EquirectTile:
        return replace(self, yaw=wrap(self.yaw + yaw))

    def _pixels(self, size: PictureSize) -> tuple[int, int, int, int]:
        """Left (0..width), top, columns and rows; whole pixels, so that nothing is interpolated."""
        columns = min(size.width, max(1, round(self.width / tau * size.width)))
        rows = min(size.height, max(1, round(self.height / pi * size.height)))
        left = round((pi - self.yaw - self.width / 2) / tau * size.width) % size.width
        top = round((pi / 2 - self.pitch - self.height / 2) / pi * size.height)
        return left, min(max(top, 0), size.height - rows), columns, rows


@dataclass(frozen=True, slots=True)
class PerspectiveTile:
    """What a pinhole camera of `side` x `side` pixels and field of view `fov` sees, looking along `yaw` and `pitch`."""

    yaw: float
    pitch: float
    fov: float
    side: int = 512

    def cut(self, panorama: Picture) -> Picture:
        columns, rows = _maps(self, panorama.shape[1], panorama.shape[0])
        return cv2.remap(panorama, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP).astype(
            np.uint8, copy=False
        )

    def directions(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
        """Yaw and pitch of points of the tile, in pixels from its upper left corner."""
        right, up = (self._plane(x), -self._plane(y))
        # Along the optical axis, to the left of it, upwards; then pitched and turned.
        ahead = np.cos(self.pitch) - up * np.sin(self.pitch)
        vector = np.stack(np.broadcast_arrays(ahead, -right, np.sin(self.pitch) + up * np.cos(self.pitch)), axis=-1)
        yaw, pitch = direction_of_vector(vector)
        return wrap_angle(yaw + self.yaw), pitch

    def boxes(self, xyxy: ArrayLike, panorama: PictureSize) -> tuple[SphereBox, ...]:
        """Boxes (n, 4) in pixels of the tile as boxes on the sphere whose sides pass through the middles of theirs.

        The smallest boxes around all that they show would be up to half as large again: an upright thing aside of
        the optical axis is drawn as a leaning one, whose corners show what is beside it.
        """
        return tuple(self._box(*corners) for corners in np.asarray(xyxy, np.float64).reshape(-1, 4).tolist())

    def cuts(self) -> bool:
        """Whether its left and right edges cut through what the neighbouring tiles show whole."""
        return True

    def turned(self, yaw: float) -> PerspectiveTile:
        return replace(self, yaw=wrap(self.yaw + yaw))

    def _plane(self, pixels: ArrayLike) -> Floats:
        """Pixels as tangents of the angle from the optical axis."""
        return (np.asarray(pixels, np.float64) - self.side / 2) * (2 * tan(self.fov / 2) / self.side)

    def _box(self, x0: float, y0: float, x1: float, y1: float) -> SphereBox:
        left, right = self._plane((x0, x1)).tolist()
        low, high = (-self._plane((y1, y0))).tolist()
        x, y = (left + right) / 2, (low + high) / 2
        bottom, top, pole = self._pitch_at(x, low), self._pitch_at(x, high), self._pole(left, right, low, high)
        if pole:
            bottom, top = (min(bottom, top), pi / 2) if pole > 0 else (-pi / 2, max(bottom, top))
            return SphereBox(self.yaw, (bottom + top) / 2, tau, top - bottom)
        leftmost, middle, rightmost = (self._yaw_at(at, y) for at in (left, x, right))
        outward, inward = wrap(leftmost - middle), wrap(rightmost - middle)
        yaw = wrap(self.yaw + middle + (outward + inward) / 2)
        return SphereBox(yaw, (bottom + top) / 2, outward - inward, top - bottom)

    def _pole(self, left: float, right: float, low: float, high: float) -> int:
        """1 or -1 where the zenith or nadir lies inside, else 0."""
        if abs(self.pitch) < 1e-9 or not left <= 0 <= right or not low <= 1 / tan(self.pitch) <= high:
            return 0
        return 1 if self.pitch > 0 else -1

    def _yaw_at(self, x: float, y: float) -> float:
        return atan2(-x, cos(self.pitch) - y * sin(self.pitch))

    def _pitch_at(self, x: float, y: float) -> float:
        return asin((sin(self.pitch) + y * cos(self.pitch)) / sqrt(1 + x * x + y * y))


Tile = EquirectTile | PerspectiveTile


@cache
def _maps(tile: PerspectiveTile, width: int, height: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """For each pixel of the tile, where in the panorama it is (cv2.remap counts from pixel centres)."""
    middle = np.arange(tile.side) + 0.5
    yaw, pitch = tile.directions(middle[None, :], middle[:, None])
    u, v = pixel_of_direction(yaw, pitch, PictureSize(width, height))
    return (u - 0.5).astype(np.float32), np.clip(v - 0.5, 0, height - 1).astype(np.float32)


@dataclass(frozen=True, slots=True)
class TilePlan:
    """Tiles that together see all around; with `one_a_turn` only one of them each time."""

    name: str
    tiles: tuple[Tile, ...]
    one_a_turn: bool = False

    @property
    def period(self) -> float:
        """Radians by which an evenly spaced ring can be turned into itself."""
        return tau / len(self.tiles)

    @property
    def overlap(self) -> float:
        """Radians that neighbours of an evenly spaced ring share; 0 for a single tile."""
        spans = [tile.width if isinstance(tile, EquirectTile) else tile.fov for tile in self.tiles]
        return max(0.0, min(spans) - tau / len(self.tiles)) if len(self.tiles) > 1 else 0.0


EVERY_ROW = 8
"""Of the panorama's rows, looked at by `settled_yaw`: what is to be found is larger than 1.5 degrees."""

NOISE = 16
"""Of 255: smaller differences of neighbouring columns are the camera's and the codec's as much as the scene's."""


def settled_yaw(panorama: Picture, period: float) -> float:
    """Where to turn a ring of tiles with this period: their middles to where most is to be seen, edges to where least.

    It turns with the panorama, so that the tiles stand still in the world while the robot turns; else what a network
    finds would flicker as the tiles' edges sweep over things. The phase of the ring's harmonic of the upright edges.
    """
    rows, columns = panorama.shape[:2]
    band = panorama[rows // 6 : rows - rows // 6 : EVERY_ROW, :, 1].astype(np.int16)
    energy = np.maximum(np.abs(band - np.roll(band, 1, axis=1)) - NOISE, 0).sum(axis=0, dtype=np.int64)
    # Column i's difference lies on the line between columns i - 1 and i.
    yaw = pi - np.arange(columns) * (tau / columns)
    harmonic = complex(energy @ np.exp(1j * (tau / period) * yaw))
    # Where nothing stands out there is no phase, only rounding.
    return float(np.angle(harmonic)) * period / tau if abs(harmonic) > 1e-6 * energy.sum() else 0.0


def equirect_ring(count: int, width_deg: float, height_deg: float = 120.0, pitch_deg: float = 0.0) -> tuple[Tile, ...]:
    """Evenly spaced pieces, the first one straight ahead."""
    return tuple(
        EquirectTile(wrap(tau * i / count), radians(pitch_deg), radians(width_deg), radians(height_deg))
        for i in range(count)
    )


def perspective_ring(count: int, fov_deg: float, pitch_deg: float, side: int = 512) -> tuple[Tile, ...]:
    """Evenly spaced pinhole views, the first one straight ahead."""
    return tuple(
        PerspectiveTile(wrap(tau * i / count), radians(pitch_deg), radians(fov_deg), side) for i in range(count)
    )


PLANS = {
    plan.name: plan
    for plan in (
        TilePlan("default", equirect_ring(4, 120.0)),
        TilePlan("fine", equirect_ring(6, 90.0, 90.0)),
        TilePlan("floor", perspective_ring(6, 90.0, -15.0)),
        TilePlan("round-robin", equirect_ring(4, 120.0), one_a_turn=True),
        TilePlan("full", (EquirectTile(0.0, 0.0, tau, pi),)),
    )
}
"""default: four tiles, the best for what it costs; floor: objects below the camera, 1.5 times the cost; fine: small
ones; round-robin: the default's tiles one at a time, for weak machines; full: the bare panorama, to compare with."""
