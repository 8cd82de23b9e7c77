"""The stop zone: how far the footprint can go along the commanded arc before it meets what the lidar saw.

The footprint is a disc, so turning on the spot never sweeps new ground. Distances follow from the base's
own deceleration and the reaction time (fact sheet on safety, B3): a speed is allowed when the robot can
still stop inside the free distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.messages import Twist

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.safety.limits import SafetyLimits

HORIZON_M = 2.0
"""Beyond this even the fastest allowed robot (1.5 m/s is never stored in an RMP-110) need not look."""

SAMPLES = 41
"""Path samples: 5 cm apart over the horizon, less than half of any margin."""

CRAWL = 0.1
"""m/s: allowed when already too close, as long as the motion leads away."""

STANDSTILL = 1e-4
"""m/s: below a tenth of a millimetre a second the base does not translate."""

BLOCKED_SHARE = 0.03
"""A lidar that sees less than this share of its beams is covered, not in open space."""


@dataclass(frozen=True, slots=True)
class Clearance:
    """`free_m` along the arc until contact (HORIZON_M if none) and the bearing of what limits it, base frame."""

    free_m: float
    bearing: float | None
    retreating: bool = False
    """The robot is already inside the margin and this motion leads away."""


def clearance(points: NDArray[np.float64], twist: Twist, radius: float) -> Clearance:
    """Free path length (m) of a disc of `radius` along the arc of `twist` among `points` (n, 2), base frame."""
    if abs(twist.v) < STANDSTILL or len(points) == 0:
        return Clearance(HORIZON_M, None)
    near = points[np.hypot(points[:, 0], points[:, 1]) < HORIZON_M + radius]
    if len(near) == 0:
        return Clearance(HORIZON_M, None)
    along = np.linspace(0.0, HORIZON_M, SAMPLES)
    centre_x, centre_y = _arc(along, twist)
    distance = np.hypot(near[:, 0][None, :] - centre_x[:, None], near[:, 1][None, :] - centre_y[:, None])
    closest = distance.min(axis=1)
    start = float(closest[0])
    if start < radius:
        nearest = near[int(distance[0].argmin())]
        bearing = math.atan2(nearest[1], nearest[0])
        retreating = bool(closest[1] > start)
        return Clearance(0.0, bearing, retreating)
    hits = np.flatnonzero(closest < radius)
    if len(hits) == 0:
        return Clearance(HORIZON_M, None)
    first = int(hits[0])
    nearest = near[int(distance[first].argmin())]
    return Clearance(float(along[first - 1]), math.atan2(nearest[1], nearest[0]))


def limit(
    points: NDArray[np.float64] | None, beams: int, wanted: Twist, limits: SafetyLimits
) -> tuple[Twist, tuple[str, ...], float | None]:
    """Slow or stop translation so that the robot can stop in time; rotation passes.

    `points` are the valid returns of the last scan of `beams` beams. Returns (twist, reasons, free metres).
    """
    if abs(wanted.v) < STANDSTILL:
        return Twist(0.0, wanted.w), (), None
    if points is None:
        return Twist(0.0, wanted.w), ("no scan",), None
    if len(points) < BLOCKED_SHARE * beams:
        return Twist(0.0, wanted.w), ("lidar sees nothing: covered?",), None
    radius = limits.footprint_radius_m + limits.margin_m
    seen = clearance(points, wanted, radius)
    allowed = _allowed(seen, wanted, limits)
    if abs(allowed.v) < abs(wanted.v):
        # Slower with the same turn rate is a tighter arc: that one has to be free as well.
        tighter = clearance(points, allowed, radius)
        if tighter.free_m < seen.free_m:
            seen, allowed = tighter, _allowed(tighter, wanted, limits)
    if abs(allowed.v) >= abs(wanted.v):
        return wanted, (), seen.free_m
    word = "stopped" if allowed.v == 0.0 else "slowed"
    return allowed, (f"{word}: obstacle {seen.free_m:.1f} m, {_direction(seen.bearing)}",), seen.free_m


def _allowed(seen: Clearance, wanted: Twist, limits: SafetyLimits) -> Twist:
    if seen.retreating:
        speed = CRAWL
    else:
        a, t, room = limits.decel, limits.reaction_s, max(0.0, seen.free_m - limits.standoff_m)
        speed = a * (math.sqrt(t * t + 2.0 * room / a) - t) if seen.free_m < HORIZON_M else math.inf
    return Twist(math.copysign(min(abs(wanted.v), speed), wanted.v), wanted.w)


def _arc(along: NDArray[np.float64], twist: Twist) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    forward = math.copysign(1.0, twist.v)
    curvature = twist.w / abs(twist.v)
    if abs(curvature) < 1e-6:
        return forward * along, np.zeros_like(along)
    turned = curvature * along
    return forward * np.sin(turned) / curvature, forward * (1.0 - np.cos(turned)) / curvature


def _direction(bearing: float | None) -> str:
    if bearing is None:
        return "ahead"
    degrees = math.degrees(bearing)
    if abs(degrees) <= 10:
        return "ahead"
    return f"{abs(degrees):.0f} deg {'left' if degrees > 0 else 'right'}"
