"""The robot's outline as discs in the base frame, and when it first touches a point on its way: exact, no sampling.

A constant twist turns the whole robot about one point, the instantaneous centre; there a disc of radius R at
distance c from the centre covers a point at distance p while the angle between them is less than phi, with
cos phi = (p^2 + c^2 - R^2) / (2 p c). A straight way is a quadratic. Turning on the spot is the same with the
base's origin as centre, so discs beside the origin sweep new ground then as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import Twist

    Floats = NDArray[np.float64]

STRAIGHT = 1e-4
"""1/m: an arc of less curvature leaves the straight line by 0.2 mm in 2 m; the cosine would lose more."""

STANDSTILL = 1e-4
"""m/s: a disc that moves by less than a tenth of a millimetre a second stands."""


@dataclass(frozen=True, slots=True)
class Disc:
    """A part of the outline: centre in the base frame and radius, metres."""

    x: float
    y: float
    radius: float


class Contact(NamedTuple):
    """When a disc first touches something: seconds at the given twist (inf for never), and which point."""

    seconds: float
    point: int | None


NEVER = Contact(math.inf, None)


def disc_velocity(disc: Disc, twist: Twist) -> tuple[float, float]:
    """Velocity of a disc's centre in the base frame, m/s."""
    return twist.v - twist.w * disc.y, twist.w * disc.x


def first_contacts(points: Floats, twist: Twist, disc: Disc, radii: tuple[float, ...]) -> tuple[Contact, ...]:
    """First contact of the disc's centre, grown to each of `radii`, with `points` (n, 2) along a twist.

    A point inside the disc counts as touched at once unless the disc is moving off it.
    """
    vx, vy = disc_velocity(disc, twist)
    if len(points) == 0 or math.hypot(vx, vy) < STANDSTILL:
        return (NEVER,) * len(radii)
    if abs(twist.w) < STRAIGHT * abs(twist.v):
        return _straight(points, twist, disc, radii)
    return _arc(points, twist, disc, radii)


def _straight(points: Floats, twist: Twist, disc: Disc, radii: tuple[float, ...]) -> tuple[Contact, ...]:
    along = (points[:, 0] - disc.x) * math.copysign(1.0, twist.v)
    aside = points[:, 1] - disc.y
    near = np.flatnonzero((along > 0.0) & (np.abs(aside) < max(radii)))
    depth = _squares(radii) - aside[near] ** 2
    gaps = np.where(depth > 0.0, np.maximum(along[near] - np.sqrt(np.maximum(depth, 0.0)), 0.0), np.inf)
    return _earliest(gaps, near, abs(twist.v))


def _arc(points: Floats, twist: Twist, disc: Disc, radii: tuple[float, ...]) -> tuple[Contact, ...]:
    centre_y = twist.v / twist.w
    x, y = points[:, 0], points[:, 1] - centre_y
    disc_y = disc.y - centre_y
    disc_far = math.hypot(disc.x, disc_y)
    far = np.sqrt(x * x + y * y)
    near = (np.abs(far - disc_far) < max(radii)).nonzero()[0]
    if len(near) == 0:
        return (NEVER,) * len(radii)
    far = far.take(near)
    ahead = np.arctan2(y.take(near), x.take(near)) - math.atan2(disc_y, disc.x)
    if twist.w < 0.0:
        ahead = -ahead
    ahead[ahead < 0.0] += math.tau
    squares, product = far * far + disc_far * disc_far, 2.0 * disc_far * far
    cosine = (squares - _squares(radii)) / np.maximum(product, 1e-12)
    # Where the cosine is beyond 1 the disc passes by; below -1 it covers the point wherever it stands.
    half = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0))
    gaps = np.where(cosine < 1.0, np.maximum(ahead - half, 0.0), np.inf)
    return _earliest(gaps, near, abs(twist.w))


def _squares(radii: tuple[float, ...]) -> Floats:
    return np.array([[radius * radius] for radius in radii])


def _earliest(gaps: Floats, near: NDArray[np.intp], rate: float) -> tuple[Contact, ...]:
    """Of each radius (rows), for points `near`."""
    if len(near) == 0:
        return (NEVER,) * len(gaps)
    first = gaps.argmin(axis=1).tolist()
    least = [(float(gap[k]), k) for gap, k in zip(gaps, first, strict=True)]
    return tuple(Contact(gap / rate, int(near[k])) if math.isfinite(gap) else NEVER for gap, k in least)
