"""How fast the robot may go towards what is around it: stop, approach and slow zones, and people.

Distances follow from speed, the base's own deceleration and the reaction time (fact sheet on safety, B3). A zone is
no polygon but the ground that the outline sweeps along the commanded arc:
- stop: contact within the distance that the base needs to stop from its MEASURED speed;
- approach: only as fast as it can stop a standoff before contact;
- slow: something would pass closer than a wider margin, so it is passed at a gentle pace;
- people: who moves may walk up to the robot while that brakes (ISO 13855, S = K T + C), whether or not they are in
  the way now; who has stopped for a moment is kept clear of by the width of a body and passed at a crawl.
A motion that takes no clearance away is allowed at a crawl, however close things are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ghal360_robot.messages import Twist
from ghal360_robot.safety.footprint import STANDSTILL, Disc, disc_velocity, first_contacts

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from ghal360_robot.safety.limits import SafetyLimits

    Floats = NDArray[np.float64]

CRAWL = 0.1
"""m/s: allowed when already too close, as long as the motion takes no clearance away."""

NOISE_M = 0.01
"""Less clearance than now by so little is the same: a third of what is left of a scan's noise."""

ABEAM = 0.17
"""Cosine of 80 degrees: who is abeam is neither run up to nor left behind; past them the robot crawls."""

BERTH_M = 0.25
"""Resting people this much further away than they have to be are passed at a crawl."""

DEEP_M = 0.05
"""Returns so far inside the outline are of something on the robot itself."""

LEAST, LEAST_TURN = 0.03, 0.05
"""m/s and rad/s: slower is not worth creaking for; the robot stops."""

RELEASE = 0.09
"""m/s, less than the crawl: once stopped it starts again only when it may go this fast, or it would start and stop
with the noise of every scan."""


class Verdict(NamedTuple):
    """What one motion may be scaled by (1 and more: not at all), and what limits it: free metres, where, who."""

    share: float
    free_m: float = math.inf
    at: tuple[float, float] | None = None
    person: bool = False


FREE = Verdict(math.inf)


class Ranked(NamedTuple):
    """Points (n, 2) and their square metres (n,) from a disc's centre, nearest first; `deep` of them deep inside it."""

    points: Floats
    squared: Floats
    deep: int

    def part(self, begin: int, end: int | None = None) -> Ranked:
        """Those from `begin` to before `end`, none of them counting as deep."""
        return Ranked(self.points[begin:end], self.squared[begin:end], 0)


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """What there is to run into, base frame, metres: all returns (n, 2), and those of people (m, 2) among them."""

    points: Floats
    resting: Floats
    walking: Floats
    _ranked: dict[tuple[int, Disc], Ranked] = field(default_factory=dict, repr=False)
    _walkers: dict[Disc, tuple[Floats, Floats]] = field(default_factory=dict, repr=False)

    def ranked(self, points: Floats, disc: Disc) -> Ranked:
        """Some of these points by their distance from a disc; worked out once a tick."""
        key = id(points), disc
        if key not in self._ranked:
            squared = (points[:, 0] - disc.x) ** 2 + (points[:, 1] - disc.y) ** 2
            nearest = squared.argsort()
            squared = squared[nearest]
            deep = int(squared.searchsorted(max(disc.radius - DEEP_M, 0.0) ** 2))
            self._ranked[key] = Ranked(np.asfortranarray(points.take(nearest, axis=0)), squared, deep)
        return self._ranked[key]

    def walkers(self, disc: Disc) -> tuple[Floats, Floats]:
        """Of those who walk, metres and direction (m,) from a disc's centre; worked out once a tick."""
        if disc not in self._walkers:
            dx, dy = self.walking[:, 0] - disc.x, self.walking[:, 1] - disc.y
            self._walkers[disc] = np.hypot(dx, dy), np.arctan2(dy, dx)
        return self._walkers[disc]


class Berth(NamedTuple):
    """How much room is kept: margin beside the outline, the wider one, and the speed allowed in between."""

    margin_m: float
    wide_m: float
    slow: float


def stoppable(room_m: float, decel: float, reaction_s: float, slow: float = 0.0) -> float:
    """The speed (m/s) from which the robot gets down to `slow` within `room_m`, reaction included."""
    excess = 2.0 * (max(room_m, 0.0) + slow * reaction_s) / decel + (slow / decel) ** 2
    return decel * (math.sqrt(reaction_s * reaction_s + excess) - reaction_s)


def stopping_m(speed: float, decel: float, reaction_s: float) -> float:
    """What the robot still covers before it stands, metres."""
    return abs(speed) * reaction_s + speed * speed / (2.0 * decel)


def approachable(apart_m: float, decel: float, reaction_s: float, walking: float) -> float:
    """The speed (m/s) at which somebody `apart_m` away who walks up at `walking` finds the robot standing.

    While it reacts and brakes, T = reaction + v / decel, both come closer: walking T + v reaction + v^2 / 2 decel.
    """
    b = decel * reaction_s + walking
    return math.sqrt(b * b + 2.0 * decel * max(apart_m - walking * reaction_s, 0.0)) - b


def judge(around: Around, twist: Twist, limits: SafetyLimits, measured: Twist) -> Verdict:
    """What part of `twist` may go out; the same arc at that share of speed is allowed as a whole."""
    things = Berth(limits.margin_m, limits.slow_margin_m, limits.slow_max)
    people = Berth(limits.person_margin_m, limits.person_margin_m + BERTH_M, CRAWL)
    verdicts = [FREE]
    for disc in limits.footprint:
        verdicts.append(_zones(around, around.points, twist, disc, limits, measured, things))
        if len(around.resting):
            verdict = _zones(around, around.resting, twist, disc, limits, measured, people)
            verdicts.append(verdict._replace(person=True))
        if len(around.walking):
            verdicts.append(_walking(around, twist, disc, limits))
    return _worst(verdicts)


def _worst(verdicts: Iterable[Verdict]) -> Verdict:
    return min(verdicts, key=lambda verdict: (verdict.share, verdict.free_m))


def limit(
    around: Around, wanted: Twist, limits: SafetyLimits, measured: Twist, stopped: float = 0.0
) -> tuple[Twist, Verdict]:
    """The fastest safe twist in the spirit of `wanted`, and what limits it.

    Slowing down keeps the turn, because turning is what leads around things; where the tighter arc that follows
    is not free itself, the same arc is driven more slowly, and where that is too slow to be worth it, the robot
    only turns. `stopped` is the speed at which it had to stop before, 0 for none; only its sign matters.
    """
    first = judge(around, wanted, limits, measured)
    again = stopped * wanted.v > 0.0
    least = RELEASE if again else LEAST
    if first.share >= 1.0 and not (again and first.share * abs(wanted.v) < least):
        return wanted, first
    share = min(first.share, 1.0)
    if share * abs(wanted.v) >= least:
        slower = Twist(share * wanted.v, wanted.w)
        if wanted.w and judge(around, slower, limits, measured).share < 1.0:
            slower = Twist(share * wanted.v, share * wanted.w)
        return slower, first
    turn = min(judge(around, Twist(0.0, wanted.w), limits, measured).share, 1.0) * wanted.w
    return Twist(0.0, turn if turn == wanted.w or abs(turn) >= LEAST_TURN else 0.0), first


def _zones(
    around: Around, points: Floats, twist: Twist, disc: Disc, limits: SafetyLimits, measured: Twist, berth: Berth
) -> Verdict:
    """Stop, approach and slow zone of one disc around those `points` of `around` that do not move now.

    What is deep inside the outline (a cable, dirt on the window) is judged by itself: how close it is says nothing
    about how close the rest may come.
    """
    near = around.ranked(points, disc)
    if not near.deep:
        return _zone(near, twist, disc, limits, measured, berth)
    parts = (near.part(0, near.deep), near.part(near.deep))
    return _worst(_zone(part, twist, disc, limits, measured, berth) for part in parts)


def _zone(near: Ranked, twist: Twist, disc: Disc, limits: SafetyLimits, measured: Twist, berth: Berth) -> Verdict:
    """The zones around some points, whichever of them are deep."""
    speed = math.hypot(*disc_velocity(disc, twist))
    if speed < STANDSTILL or len(near.points) == 0:
        return FREE
    moving = math.hypot(*disc_velocity(disc, measured))
    decel = _decel(disc, twist, limits)
    reach_m = stopping_m(max(speed, moving), decel, limits.reaction_s) + max(limits.standoff_m, berth.wide_m)
    clearance = math.sqrt(float(near.squared[0]))
    if clearance > disc.radius + berth.margin_m + reach_m:
        return FREE
    points = near.points[: near.squared.searchsorted((disc.radius + berth.margin_m + reach_m) ** 2, "right")]
    close = clearance < disc.radius + berth.margin_m
    radius = max(clearance - NOISE_M, 0.0) if close else disc.radius + berth.margin_m
    touch, side = first_contacts(points, twist, disc, (radius, disc.radius + berth.wide_m))
    free_m, wide_m = speed * touch.seconds, speed * side.seconds
    allowed, which, reach = CRAWL if close else math.inf, None, free_m
    if math.isfinite(wide_m):
        gentle = stoppable(wide_m, decel, limits.reaction_s, berth.slow)
        if gentle < allowed:
            allowed, which, reach = gentle, side.point, wide_m
    if math.isfinite(free_m):
        pace = stoppable(free_m - limits.standoff_m, decel, limits.reaction_s)
        if _same_way(disc, twist, measured) and free_m < stopping_m(moving, decel, limits.reaction_s):
            pace = 0.0
        if pace <= allowed:
            allowed, which, reach = pace, touch.point, free_m
    at = None if which is None else (float(points[which, 0]), float(points[which, 1]))
    return Verdict(allowed / speed, reach, at)


def _walking(around: Around, twist: Twist, disc: Disc, limits: SafetyLimits) -> Verdict:
    """Speed and separation from everybody who walks and whom this motion does not leave behind."""
    vx, vy = disc_velocity(disc, twist)
    speed = math.hypot(vx, vy)
    if speed < STANDSTILL:
        return FREE
    points, (apart, bearing) = around.walking, around.walkers(disc)
    decel = _decel(disc, twist, limits)
    turn = twist.w * (limits.reaction_s + speed / decel)
    towards = _towards(bearing - math.atan2(vy, vx), turn)
    verdicts = [FREE]
    for mask, least in ((towards > ABEAM, 0.0), (np.abs(towards) <= ABEAM, CRAWL)):
        theirs = np.where(mask, apart, np.inf)
        nearest = int(theirs.argmin())
        if not mask[nearest]:
            continue
        apart_m = float(apart[nearest]) - disc.radius - limits.person_margin_m
        pace = approachable(apart_m, decel, limits.reaction_s, limits.person_speed)
        at = (float(points[nearest, 0]), float(points[nearest, 1]))
        verdicts.append(Verdict(max(pace, least) / speed, max(apart_m, 0.0), at, person=True))
    return _worst(verdicts)


def _towards(bearing: Floats, turn: float) -> Floats:
    """Cosine of how far off its way somebody at `bearing` is, at best, while the robot turns by `turn` radians.

    Turning goes on while the robot brakes: whom it has at its side now it may have in front of it before it stands.
    """
    middle, reach = turn / 2, abs(turn) / 2
    off = np.abs(np.mod(bearing - middle + math.pi, math.tau) - math.pi) - reach
    return np.cos(np.maximum(off, 0.0))


def _decel(disc: Disc, twist: Twist, limits: SafetyLimits) -> float:
    """Of a disc, m/s^2: the base brakes drive and turn by limits of their own, and the later of the two counts."""
    if not twist.w or (disc.x == 0.0 and disc.y == 0.0):
        return limits.decel
    speed = math.hypot(*disc_velocity(disc, twist))
    return speed / max(abs(twist.v) / limits.decel, abs(twist.w) / limits.w_accel)


def _same_way(disc: Disc, twist: Twist, measured: Twist) -> bool:
    (ax, ay), (bx, by) = disc_velocity(disc, twist), disc_velocity(disc, measured)
    return ax * bx + ay * by > 0.0
