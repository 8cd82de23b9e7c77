"""A pose from two wheel positions, with its covariance: exact arcs, and no jump where the integrators jump.

The covariance has two parts. What differs from metre to metre (floor, tyre squash) is random and grows with
the root of the distance. What is wrong all the time (tyre diameters, track) grows with the distance itself
and undoes itself on the way back: it is carried as the pose's derivative by each of those errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

MAX_WHEEL_MPS = 9.5
"""Firmware maximum 8.047 m/s plus 4.5 rad/s at half the track, rounded up (fact sheet section 7)."""
MAX_WHEEL_MPS2 = 15.0
"""Firmware maxima: 7.848 m/s^2 plus 28.274 rad/s^2 at half the track (fact sheet 6.1)."""
SLACK_S = 0.05
"""Five of the base's control ticks: its time and its positions are not sampled together."""
SPEEDS_TELL_S = 0.3
"""Between packets further apart than this the speeds may have done anything; so long a silence ends the link."""
CLOCK_SLACK_S, CLOCK_DRIFT = 0.5, 0.01
"""Two clocks agree this well over a gap: packets may wait for a busy computer, and quartz is better than 1 %.
Where they do not, the base was switched off in between, however late its own time is again."""

Covariance = tuple[float, float, float, float, float, float]
"""xx, xy, x yaw, yy, y yaw, yaw yaw: m^2, m rad, rad^2."""
Derivative = tuple[float, float, float]
"""Of x, y, yaw by one unknown."""
_ZERO: Derivative = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Noise:
    """How far to believe the wheels; standard deviations. Nobody published them for an RMP 110: calibrate."""

    random_m: float = 0.01
    """Of one wheel after one metre, growing with the root: a hard floor's joints, carpet doubles it."""
    diameter: float = 0.01
    """Common relative error: 0.46228 m stored against 0.4811 m of the bare tyre is 4 % (fact sheet section 7);
    inflation and load are within a percent once it is measured."""
    unequal: float = 0.003
    """Relative difference between the wheels: a tenth of a bar in one tyre."""
    track: float = 0.01
    """Relative: 0.481224 against 0.479111 m in two descriptions, and a tyre's contact patch is 9 cm wide."""
    moved_m: float = 1.0
    moved_rad: float = 1.0
    """While it was off somebody may have pushed the base: whoever uses the pose has to look around again."""


NOISE = Noise()


def ulp32(value: float) -> float:
    """Distance between neighbouring float32 at this magnitude."""
    return float(2.0 ** (math.frexp(value)[1] - 24)) if value else 0.0


@dataclass(frozen=True, slots=True)
class Odometry:
    """Pose in the frame `odom` (m, rad counter-clockwise) and the wheel readings it belongs to."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    right_m: float | None = None
    left_m: float | None = None
    time_s: float = 0.0
    jumps: int = 0
    """How often readings could not be motion: integrators reset, base restarted."""
    stamp_ns: int | None = None
    speeds_mps: tuple[float, float] | None = None
    """Right and left wheel's, where they were given."""
    random: Covariance = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """What chance added so far."""
    by_diameter: Derivative = _ZERO
    by_unequal: Derivative = _ZERO
    by_track: Derivative = _ZERO

    def advance(
        self,
        right_m: float,
        left_m: float,
        time_s: float,
        track_m: float,
        *,
        stamp_ns: int | None = None,
        speeds_mps: tuple[float, float] | None = None,
        noise: Noise = NOISE,
    ) -> Odometry:
        """The pose after the wheels moved to these positions at the base's own time.

        `stamp_ns` is the packet's reception, `speeds_mps` right and left wheel's speed in it; with them a
        restart is noticed in every gap, and a reset of the integrators also where it is a small step.
        """
        read: dict[str, Any] = {
            "right_m": right_m, "left_m": left_m, "time_s": time_s, "stamp_ns": stamp_ns, "speeds_mps": speeds_mps,
        }  # fmt: skip
        if self.right_m is None or self.left_m is None:
            return replace(self, **read)
        right, left, dt_s = right_m - self.right_m, left_m - self.left_m, time_s - self.time_s
        if dt_s < 0 or not self._same_run(stamp_ns, dt_s):
            return replace(self, **read, jumps=self.jumps + 1, random=_pushed(self.random, noise))
        limit_m = MAX_WHEEL_MPS * (dt_s + SLACK_S)
        possible = max(abs(right), abs(left)) <= limit_m
        expected = self._by_speed(speeds_mps, dt_s)
        if expected is not None and possible:
            fastest_mps = max(map(abs, (*(speeds_mps or ()), *(self.speeds_mps or ()))))
            slack_m = jump_slack_m(fastest_mps, dt_s, time_s, max(abs(right_m), abs(left_m)))
            possible = max(abs(right - expected[0]), abs(left - expected[1])) <= slack_m
        if possible:
            return replace(self, **read, **self._moved(right, left, track_m, noise))
        # The integrators were reset, the wheels were not: what the speeds say bridges the step.
        bridged = {} if expected is None else self._moved(*expected, track_m, noise)
        return replace(self, **read, **bridged, jumps=self.jumps + 1)

    def covariance(self, noise: Noise = NOISE) -> Covariance:
        """Of (x, y, yaw) since the first reading: random and systematic errors together."""
        total = self.random
        for derivative, sigma in (
            (self.by_diameter, noise.diameter),
            (self.by_unequal, noise.unequal),
            (self.by_track, noise.track),
        ):
            total = _plus(total, _outer(derivative, sigma))
        return total

    @property
    def resolution_m(self) -> float:
        """Smallest step of the base's float32 wheel positions: 1 mm from 8.2 km on, 8 mm from 65 km on."""
        return ulp32(max(abs(self.right_m or 0.0), abs(self.left_m or 0.0)))

    def _same_run(self, stamp_ns: int | None, dt_s: float) -> bool:
        """Whether the base's clock went on as ours did."""
        if stamp_ns is None or self.stamp_ns is None:
            return True
        elapsed_s = (stamp_ns - self.stamp_ns) / 1e9
        slack_s = CLOCK_SLACK_S + CLOCK_DRIFT * elapsed_s + ulp32(self.time_s + dt_s)
        return abs(elapsed_s - dt_s) <= slack_s

    def _by_speed(self, speeds_mps: tuple[float, float] | None, dt_s: float) -> tuple[float, float] | None:
        """How far the wheels went by their speeds, where those tell."""
        if speeds_mps is None or self.speeds_mps is None or dt_s > SPEEDS_TELL_S:
            return None
        (right, left), (right_then, left_then) = speeds_mps, self.speeds_mps
        return (right + right_then) / 2 * dt_s, (left + left_then) / 2 * dt_s

    def _moved(self, right: float, left: float, track_m: float, noise: Noise) -> dict[str, Any]:
        """Pose and errors, by field, after the wheels rolled on by `right` and `left` metres along one arc."""
        distance, turn = (right + left) / 2, (right - left) / track_m
        half = turn / 2
        # The chord of an arc is shorter than the arc by sin(a)/a of half the turn.
        shape, slope = _chord(half)
        c, s = math.cos(self.yaw + half), math.sin(self.yaw + half)
        chord = distance * shape
        x, y = chord * c, chord * s

        def by(d_distance: float, d_turn: float) -> Derivative:
            """Of this step, by something that changes its distance and its turn."""
            d_chord = d_distance * shape + distance * slope * d_turn / 2
            return d_chord * c - y * d_turn / 2, d_chord * s + x * d_turn / 2, d_turn

        def carried(before: Derivative, step: Derivative) -> Derivative:
            """An error made earlier, seen from here, plus that of this step."""
            return before[0] - y * before[2] + step[0], before[1] + x * before[2] + step[1], before[2] + step[2]

        variance = noise.random_m**2
        random = _carried(self.random, x, y)
        for rolled, step in ((right, by(0.5, 1 / track_m)), (left, by(0.5, -1 / track_m))):
            random = _plus(random, _outer(step, math.sqrt(variance * abs(rolled))))
        return {
            "x": self.x + x,
            "y": self.y + y,
            "yaw": self.yaw + turn,
            "random": random,
            "by_diameter": carried(self.by_diameter, by(distance, turn)),
            "by_unequal": carried(self.by_unequal, by((right - left) / 4, distance / track_m)),
            "by_track": carried(self.by_track, by(0.0, -turn)),
        }


def jump_slack_m(speed_mps: float, dt_s: float, time_s: float, position_m: float) -> float:
    """How far a wheel's positions may differ from its speeds over `dt_s` on a base whose integrators go on."""
    apart_s = SLACK_S + ulp32(time_s)
    return speed_mps * apart_s + MAX_WHEEL_MPS2 * (dt_s + SLACK_S) ** 2 / 2 + 2 * ulp32(position_m)


def _chord(half: float) -> tuple[float, float]:
    """sin(a)/a and its derivative."""
    if abs(half) < 1e-4:
        return 1.0 - half * half / 6, -half / 3
    shape = math.sin(half) / half
    return shape, (math.cos(half) - shape) / half


def _outer(derivative: Derivative, sigma: float) -> Covariance:
    x, y, yaw = sigma * derivative[0], sigma * derivative[1], sigma * derivative[2]
    return x * x, x * y, x * yaw, y * y, y * yaw, yaw * yaw


def _plus(one: Covariance, other: Covariance) -> Covariance:
    xx, xy, xt, yy, yt, tt = one
    dxx, dxy, dxt, dyy, dyt, dtt = other
    return xx + dxx, xy + dxy, xt + dxt, yy + dyy, yt + dyt, tt + dtt


def _pushed(random: Covariance, noise: Noise) -> Covariance:
    place = noise.moved_m**2
    return _plus(random, (place, 0.0, 0.0, place, 0.0, noise.moved_rad**2))


def _carried(random: Covariance, x: float, y: float) -> Covariance:
    """F P F' for a step of (x, y) in the odometry's frame: an error in yaw swings the step."""
    xx, xy, xt, yy, yt, tt = random
    return (
        xx - 2 * y * xt + y * y * tt,
        xy + x * xt - y * yt - x * y * tt,
        xt - y * tt,
        yy + 2 * x * yt + x * x * tt,
        yt + x * tt,
        tt,
    )
