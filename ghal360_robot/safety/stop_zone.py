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

NEAR_M = 1.0
"""The path is looked along at least this far; further where the limits need more to stop."""

SAMPLE_M = 0.05
"""Distance of path samples: what is missed between two is less than a millimetre of a disc's clearance."""

CRAWL = 0.1
"""m/s: allowed when already too close, as long as the motion leads away."""

STANDSTILL = 1e-4
"""m/s: below a tenth of a millimetre a second the base does not translate."""

AHEAD = math.radians(50)
"""To either side of the way ahead there must be beams, and some of them must come back."""

BLOCKED_SHARE = 0.05
"""A lidar that gets less than this share of the beams ahead back is covered, or faces 25 m of nothing."""


@dataclass(frozen=True, slots=True)
class Clearance:
    """`free_m` along the arc until contact (inf if none) and the bearing of what limits it, base frame."""

    free_m: float
    bearing: float | None
    retreating: bool = False
    """The robot is already inside the margin and this motion leads away."""


def horizon_m(limits: SafetyLimits) -> float:
    """How far ahead it matters what is there: the stopping distance from full speed, and the standoff."""
    v = limits.v_max
    return max(NEAR_M, v * limits.reaction_s + v * v / (2.0 * limits.decel) + limits.standoff_m)


def clearance(points: NDArray[np.float64], twist: Twist, radius: float, horizon: float) -> Clearance:
    """Free path length (m) of a disc of `radius` along the arc of `twist` among `points` (n, 2), base frame."""
    if abs(twist.v) < STANDSTILL or len(points) == 0:
        return Clearance(math.inf, None)
    near = points[np.hypot(points[:, 0], points[:, 1]) < horizon + radius]
    if len(near) == 0:
        return Clearance(math.inf, None)
    along = np.linspace(0.0, horizon, math.ceil(horizon / SAMPLE_M) + 1)
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
        return Clearance(math.inf, None)
    first = int(hits[0])
    nearest = near[int(distance[first].argmin())]
    return Clearance(float(along[first - 1]), math.atan2(nearest[1], nearest[0]))


def blind_ahead(ranges: NDArray[np.float32], bearings: NDArray[np.float64]) -> str | None:
    """Why this scan says nothing about the way ahead, or None. Beams (n,) with `bearings` in the base frame."""
    ahead = np.abs(bearings) <= AHEAD
    edges = bearings[ahead]
    if len(edges) == 0 or edges.min() > -0.9 * AHEAD or edges.max() < 0.9 * AHEAD:
        return "the scan does not cover the way ahead"
    if np.isfinite(ranges[ahead]).mean() < BLOCKED_SHARE:
        return "lidar sees nothing ahead: covered?"
    return None


def limit(
    points: NDArray[np.float64] | None, wanted: Twist, limits: SafetyLimits
) -> tuple[Twist, tuple[str, ...], float | None]:
    """Slow or stop translation so that the robot can stop in time; rotation passes.

    `points` are the valid returns of the last scan. Returns (twist, reasons, free metres, None if not limited).
    """
    if abs(wanted.v) < STANDSTILL:
        return Twist(0.0, wanted.w), (), None
    if points is None:
        return Twist(0.0, wanted.w), ("no scan",), None
    radius, horizon = limits.footprint_radius_m + limits.margin_m, horizon_m(limits)
    seen = clearance(points, wanted, radius, horizon)
    allowed = _allowed(seen, wanted, limits)
    if abs(allowed.v) < abs(wanted.v):
        # Slower with the same turn rate is a tighter arc: that one has to be free as well.
        tighter = clearance(points, allowed, radius, horizon)
        if tighter.free_m < seen.free_m:
            seen, allowed = tighter, _allowed(tighter, wanted, limits)
    if abs(allowed.v) >= abs(wanted.v):
        return wanted, (), seen.free_m if math.isfinite(seen.free_m) else None
    word = "stopped" if allowed.v == 0.0 else "slowed"
    return allowed, (f"{word}: obstacle {seen.free_m:.1f} m, {_direction(seen.bearing)}",), seen.free_m


def _allowed(seen: Clearance, wanted: Twist, limits: SafetyLimits) -> Twist:
    if seen.retreating:
        speed = CRAWL
    else:
        a, t, room = limits.decel, limits.reaction_s, max(0.0, seen.free_m - limits.standoff_m)
        speed = a * (math.sqrt(t * t + 2.0 * room / a) - t)
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
