"""Equirectangular pictures and directions: one picture column is one yaw, one row one pitch.

Pixel coordinates are continuous: `u` runs 0..width from the left edge to the right, `v` 0..height from
the top edge down, and the middle of pixel (i, j) is (i + 0.5, j + 0.5). The middle of the picture looks
along the camera's forward axis; left of it is positive yaw (counter-clockwise, REP-103), above it
positive pitch. The left and right edges are one and the same meridian, straight behind the camera: the
seam. `camera_yaw` is the direction of the camera's forward axis in the base frame, radians.

Every function takes scalars or arrays of any shape that broadcast.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, cos, pi, sin, tau
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PictureSize:
    """Width and height of an equirectangular picture in pixels (2:1 for a whole sphere)."""

    width: int
    height: int

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ValueError(f"a picture of {self.width} x {self.height} pixels has no directions")


@dataclass(frozen=True, slots=True)
class PixelBox:
    """An upright box in the picture, pixels; it crosses the seam when `left + width` exceeds the picture."""

    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class SphereBox:
    """A box of meridians and parallels: direction of its centre, span of yaw and span of pitch, radians."""

    yaw: float
    pitch: float
    width: float
    height: float


def wrap_angle(angle: ArrayLike) -> Floats:
    """The same direction as an angle in [-pi, pi)."""
    wrapped = np.mod(np.asarray(angle, np.float64) + pi, tau) - pi
    # np.mod of a tiny negative number rounds up to the modulus itself.
    return np.where(wrapped >= pi, -pi, wrapped)


def direction_of_pixel(u: ArrayLike, v: ArrayLike, size: PictureSize, camera_yaw: float = 0.0) -> tuple[Floats, Floats]:
    """Yaw in [-pi, pi) and pitch in the base frame of a point of the picture."""
    yaw = wrap_angle(camera_yaw + pi - np.asarray(u, np.float64) * (tau / size.width))
    pitch = pi / 2 - np.asarray(v, np.float64) * (pi / size.height)
    return yaw, pitch


def pixel_of_direction(
    yaw: ArrayLike, pitch: ArrayLike, size: PictureSize, camera_yaw: float = 0.0
) -> tuple[Floats, Floats]:
    """Where a direction of the base frame falls in the picture: `u` in [0, width), `v` in [0, height]."""
    turned = wrap_angle(np.asarray(yaw, np.float64) - camera_yaw)
    u = (pi - turned) * (size.width / tau)
    v = (pi / 2 - np.asarray(pitch, np.float64)) * (size.height / pi)
    return np.where(u >= size.width, 0.0, u), v


def unit_vector(yaw: ArrayLike, pitch: ArrayLike) -> Floats:
    """Directions (...,) as unit vectors (..., 3): x forward, y left, z up."""
    yaws, pitches = np.broadcast_arrays(np.asarray(yaw, np.float64), np.asarray(pitch, np.float64))
    flat = np.cos(pitches)
    return np.stack((flat * np.cos(yaws), flat * np.sin(yaws), np.sin(pitches)), axis=-1)


def direction_of_vector(vector: ArrayLike) -> tuple[Floats, Floats]:
    """Yaw and pitch of vectors (..., 3) of any length above zero."""
    x, y, z = np.moveaxis(np.asarray(vector, np.float64), -1, 0)
    return wrap_angle(np.arctan2(y, x)), np.arctan2(z, np.hypot(x, y))


def angular_distance(yaw_a: ArrayLike, pitch_a: ArrayLike, yaw_b: ArrayLike, pitch_b: ArrayLike) -> Floats:
    """Angle between two directions, radians; exact near 0 and pi too, where acos and haversine are not."""
    a, b = unit_vector(yaw_a, pitch_a), unit_vector(yaw_b, pitch_b)
    distance: Floats = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))
    return distance


def sphere_box(box: PixelBox, size: PictureSize, camera_yaw: float = 0.0) -> SphereBox:
    """The directions a box of the picture covers, in the base frame."""
    yaw, pitch = direction_of_pixel(box.left + box.width / 2, box.top + box.height / 2, size, camera_yaw)
    return SphereBox(
        yaw=float(yaw),
        pitch=float(pitch),
        width=box.width * tau / size.width,
        height=box.height * pi / size.height,
    )


def pixel_box(box: SphereBox, size: PictureSize, camera_yaw: float = 0.0) -> PixelBox:
    """The box of the picture that covers these directions; `left` is in [0, width)."""
    width = box.width * size.width / tau
    left_yaw = box.yaw + box.width / 2
    left, middle = pixel_of_direction(left_yaw, box.pitch, size, camera_yaw)
    height = box.height * size.height / pi
    return PixelBox(float(left), float(middle) - height / 2, width, height)


def parts_of_box(box: PixelBox, size: PictureSize) -> tuple[PixelBox, ...]:
    """The one or two pieces of a box that lie inside the picture, for cutting out or drawing.

    A box over the seam gives its right-edge piece first; one as wide as the picture gives the whole width.
    """
    if box.width >= size.width:
        return (PixelBox(0.0, box.top, float(size.width), box.height),)
    left = box.left % size.width
    beyond = left + box.width - size.width
    if beyond <= 0:
        return (PixelBox(left, box.top, box.width, box.height),)
    return (
        PixelBox(left, box.top, size.width - left, box.height),
        PixelBox(0.0, box.top, beyond, box.height),
    )


def camera_rotation(yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Floats:
    """(3, 3) turns directions of the camera into those of the base: rolled about x, pitched about y, turned about z.

    Positive pitch leans the camera's zenith towards x, positive roll towards -y (REP-103).
    """
    cy, sy, cp, sp, cr, sr = cos(yaw), sin(yaw), cos(pitch), sin(pitch), cos(roll), sin(roll)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def turned_box(box: SphereBox, rotation: Floats) -> SphereBox:
    """The smallest box of the turned frame around everything in a box; the whole circle where it holds a pole."""
    border = _border(box) @ rotation.T
    yaw, _ = direction_of_vector(border)
    height = border[..., 2]  # of which the pitch is the arcsine; smooth near the poles, too
    middle_yaw, _ = direction_of_vector(rotation @ unit_vector(box.yaw, box.pitch))
    aside = wrap_angle(yaw - middle_yaw)
    low, high = (asin(min(max(z, -1.0), 1.0)) for z in (_least(height), -_least(-height)))
    pole = _pole_inside(box, rotation)
    if pole:
        bottom, top = (low, pi / 2) if pole > 0 else (-pi / 2, high)
        return SphereBox(float(middle_yaw), (bottom + top) / 2, tau, top - bottom)
    right, left = _least(aside), -_least(-aside)
    centre = float(wrap_angle(middle_yaw + (left + right) / 2))
    return SphereBox(centre, (low + high) / 2, left - right, high - low)


BORDER_STEPS = 64
"""Points on each side of a box's border; the parabola through three of them is exact to 1e-7 rad between them."""


def _border(box: SphereBox) -> Floats:
    """(4, steps + 1, 3) points on the four sides: top, bottom, left, right."""
    along = np.linspace(-0.5, 0.5, BORDER_STEPS + 1)
    across, up = box.yaw + along * box.width, box.pitch + along * box.height
    sides = (
        (across, np.full_like(along, box.pitch + box.height / 2)),
        (across, np.full_like(along, box.pitch - box.height / 2)),
        (np.full_like(along, box.yaw + box.width / 2), up),
        (np.full_like(along, box.yaw - box.width / 2), up),
    )
    return np.stack([unit_vector(yaw, pitch) for yaw, pitch in sides])


def _least(values: Floats) -> float:
    """The least of smooth values (sides, points), looked for between the points as well."""
    least = float(values.min())
    # Of each side by itself: two share a corner, and only one of them need go on below it.
    middles = np.clip(values.argmin(axis=1), 1, values.shape[1] - 2)
    for side, at in zip(values, middles.tolist(), strict=True):
        before, here, after = side[at - 1 : at + 2].tolist()
        bend = before - 2 * here + after
        if bend > 0 and abs(before - after) <= 2 * bend:  # the parabola's bottom is between these points
            least = min(least, here - (before - after) ** 2 / (8 * bend))
    return least


def _pole_inside(box: SphereBox, rotation: Floats) -> int:
    """1 or -1 where the turned frame's zenith or nadir lies in the box, else 0."""
    for sign in (1, -1):
        yaw, pitch = direction_of_vector(rotation.T @ np.array((0.0, 0.0, float(sign))))
        aside = abs(float(wrap_angle(yaw - box.yaw)))
        if abs(float(pitch) - box.pitch) <= box.height / 2 and (aside <= box.width / 2 or box.width >= tau):
            return sign
    return 0
