"""Wheels that do not do what the base told them: stalled, moving without a command, slipping.

All of it is judged from words of the compact feedback set. A packet's targets are those the base itself
follows at that moment, so its latency, ramps, mode changes and command timeout are no deviations.

What cannot be seen from here: the wheels' speeds are controlled. Two wheels that spin on wet ground alike, or
a base that is dragged sideways, turn exactly as commanded; only an IMU (a standard 110 has none) or the
lidar tells. Targets below `STILL_MPS` at the wheel are too close to standstill to be judged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Self

from drivers.rmp110.codec.parameters import Stored
from drivers.rmp110.device.odometry import SPEEDS_TELL_S, jump_slack_m, ulp32

STILL_MPS = 0.05
"""Slower is standing: crawling and the creep at a ramp's end are below it."""
FOLLOWS = 0.3
"""A wheel that does less than this share of its target does not follow it."""
STALL_S = 0.4
"""A loaded base in front of a doorstep needs a moment to break away."""
LAG_S = 0.3
"""Wheels follow their targets this late at worst; only then does a target of zero mean standing."""
RUNS_S = 0.15
"""Longer than a jolt; with the lag before it still less than half a second."""
FREE_MPS = 0.3
"""Faster than a target that is not zero by so much: more than a ramp (0.9 m/s^2 at the wheel) and its lag."""
ACCEL_MARGIN = 2.0
"""Motors overshoot their limits; slipping and hitting something are ten times beyond."""
SPEED_NOISE_MPS = 0.05
"""Of one reading of a wheel's speed, generously: nobody published it."""
QUANTUM_S = 0.02
"""The base's time has steps of 10 ms, and an interval has two ends."""
AGREE_S = 0.4
"""Positions are compared with speeds over about this time: shorter is sampling, longer tells too late."""
AGREE_M, AGREE_SKEW_S = 0.04, 0.06
"""What a healthy base differs by: a reset too small to tell from motion; at speed, the time between sampling
positions and speeds."""
CONTRADICT_MPS, CONTRADICT_S = 0.1, 0.2
"""The base's speed is the mean of its wheels' in every log; so far off, for so long, is not rounding."""
SHOWN_S = 1.0
"""A warning stays at least so long after its cause has gone, to be read and not to flicker."""
COARSE_M = 0.001
"""Wheel positions with bigger steps are told: float32 has them from 8.2 km on."""


class Trouble(Enum):
    """What can be odd: seconds from onset to warning, the sentence for one wheel, and for both."""

    STALL = (
        STALL_S,
        "the {} wheel does not follow: it is blocked or its motor gave up",
        "neither wheel follows: the base stands against something or its motors gave up",
    )
    UNCOMMANDED = (
        RUNS_S,
        "the {} wheel turns without a command: the base is pushed or rolls, or a motor runs away",
        "the base moves without a command: it is pushed, rolls down a slope, or its motors run away",
    )
    SLIP = (
        0.0,
        "the {} wheel changed speed faster than its motor can: it slips or hit something",
        "both wheels changed speed faster than their motors can: they slip or the base hit something",
    )
    DISAGREE = (
        0.0,
        "the {} wheel's position and speed disagree: it slips or its sensor fails; do not trust the odometry",
        "both wheels' positions and speeds disagree: they slip or a sensor fails; do not trust the odometry",
    )
    CONTRADICT = (
        CONTRADICT_S,
        "the base's speed is not that of its {} wheel: do not trust the odometry",
        "the base's speed is not that of its wheels: do not trust the odometry",
    )

    @property
    def onset_s(self) -> float:
        return self.value[0]

    def sentence(self, right: bool, left: bool) -> str:
        """For the person at the robot; at least one wheel is concerned."""
        _, one, both = self.value
        return both if right and left else one.format("right" if right else "left")


class Wheel(NamedTuple):
    """One wheel in one packet: what it shall do, what it does, where it is."""

    target_mps: float
    speed_mps: float
    position_m: float


class Reading(NamedTuple):
    """What one packet says about both wheels, at the base's own time."""

    time_s: float
    right: Wheel
    left: Wheel
    base_mps: float

    @classmethod
    def of(cls, values: Mapping[str, float], stored_track_m: float) -> Reading:
        """From feedback words by name; `stored_track_m` is what the base makes wheel targets with."""
        v, turning = values["vel_target_mps"], values["yaw_rate_target_rps"] * stored_track_m / 2
        return cls(
            values["operational_time"],
            Wheel(v - turning, values["right_front_vel_mps"], values["right_front_pos_m"]),
            Wheel(v + turning, values["left_front_vel_mps"], values["left_front_pos_m"]),
            values["linear_vel_mps"],
        )


class Alarm(NamedTuple):
    """One condition with its onset and release."""

    on: bool = False
    since_s: float | None = None
    last_s: float = -math.inf

    def step(self, active: bool, now_s: float, onset_s: float) -> Alarm:
        if active:
            since_s = now_s if self.since_s is None else self.since_s
            return Alarm(self.on or now_s - since_s >= onset_s, since_s, now_s)
        if self is QUIET:
            return self
        still_on = self.on and now_s - self.last_s < SHOWN_S
        return Alarm(still_on, None, self.last_s) if still_on else QUIET


QUIET = Alarm()


@dataclass(frozen=True, slots=True)
class WheelWatch:
    """What is remembered of one wheel."""

    before: Wheel
    idle_since_s: float | None = None
    """Since when its target is a standstill."""
    apart_m: float = 0.0
    """By how much position and speed disagreed lately."""
    alarms: tuple[Alarm, ...] = (QUIET,) * len(Trouble)

    def step(self, wheel: Wheel, base: Reading, dt_s: float, max_mps2: float) -> WheelWatch:
        """The wheel in the next packet, `dt_s` later."""
        idle = abs(wheel.target_mps) < STILL_MPS / 2
        idle_since_s = (base.time_s if self.idle_since_s is None else self.idle_since_s) if idle else None
        apart_m, slack_m = self._apart(wheel, base.time_s, dt_s)
        faster = abs(wheel.speed_mps - self.before.speed_mps) - max_mps2 * (dt_s + QUANTUM_S + ulp32(base.time_s))
        now = (
            _stalls(wheel),
            _runs(wheel, idle_for_s=0.0 if idle_since_s is None else base.time_s - idle_since_s),
            faster > SPEED_NOISE_MPS,
            abs(apart_m) > slack_m,
            abs(base.base_mps - (base.right.speed_mps + base.left.speed_mps) / 2) > CONTRADICT_MPS,
        )
        alarms = self.alarms
        if any(now) or alarms != _ALL_QUIET:
            alarms = tuple(
                alarm.step(active, base.time_s, trouble.onset_s)
                for alarm, active, trouble in zip(alarms, now, Trouble, strict=True)
            )
        return WheelWatch(wheel, idle_since_s, apart_m, alarms)

    def _apart(self, wheel: Wheel, time_s: float, dt_s: float) -> tuple[float, float]:
        """Disagreement of position and speed over the last moments, and how much of it is harmless."""
        mean_mps = (wheel.speed_mps + self.before.speed_mps) / 2
        step_m = wheel.position_m - self.before.position_m - mean_mps * dt_s
        fastest_mps = max(abs(wheel.speed_mps), abs(self.before.speed_mps))
        from_zero = abs(wheel.position_m) <= fastest_mps * (dt_s + AGREE_SKEW_S) and abs(step_m) > AGREE_M / 2
        if from_zero or abs(step_m) > jump_slack_m(fastest_mps, dt_s, time_s, wheel.position_m):
            return 0.0, math.inf  # the integrators were reset: odometry counts that where it is no small step
        coarse_m = 2 * ulp32(wheel.position_m)
        slack_m = AGREE_M + fastest_mps * (AGREE_SKEW_S + ulp32(time_s)) + coarse_m
        return self.apart_m * math.exp(-dt_s / AGREE_S) + step_m, slack_m


_ALL_QUIET = (QUIET,) * len(Trouble)


@dataclass(frozen=True, slots=True)
class SlipWatch:
    """Both wheels over time. `step` it with every packet; `warnings` is what is odd now."""

    stored_track_m: float
    max_mps2: float
    """No wheel of this base changes its speed faster."""
    time_s: float | None = None
    right: WheelWatch | None = None
    left: WheelWatch | None = None

    @classmethod
    def of(cls, stored: Stored) -> Self:
        """For a base with these stored parameters."""
        track_m = stored["track_width"]
        along = max(stored["max_accel"], stored["max_decel"], stored["max_dtz_decel"])
        return cls(track_m, ACCEL_MARGIN * (along + stored["max_yaw_accel"] * track_m / 2))

    def step(self, values: Mapping[str, float]) -> SlipWatch:
        """One packet's words by name, all finite. A restart or a long gap begins anew."""
        reading = Reading.of(values, self.stored_track_m)
        right, left = self.right, self.left
        dt_s = -1.0 if self.time_s is None else reading.time_s - self.time_s
        if right is None or left is None or not 0.0 <= dt_s <= SPEEDS_TELL_S + ulp32(reading.time_s):
            right, left = WheelWatch(reading.right), WheelWatch(reading.left)
        else:
            right = right.step(reading.right, reading, dt_s, self.max_mps2)
            left = left.step(reading.left, reading, dt_s, self.max_mps2)
        return SlipWatch(self.stored_track_m, self.max_mps2, reading.time_s, right, left)

    @property
    def slipping(self) -> tuple[str, ...]:
        """What the wheels do now that they were not told to, in words, worst first; empty while they obey."""
        if self.right is None or self.left is None or self.right.alarms == self.left.alarms == _ALL_QUIET:
            return ()
        return tuple(
            trouble.sentence(right.on, left.on)
            for trouble, right, left in zip(Trouble, self.right.alarms, self.left.alarms, strict=True)
            if right.on or left.on
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """The same, and what is odd about the numbers although the wheels obey."""
        if self.right is None or self.left is None:
            return ()
        said = list(self.slipping)
        coarse_m = ulp32(max(abs(self.right.before.position_m), abs(self.left.before.position_m)))
        if coarse_m >= COARSE_M:
            said.append(
                f"the base's wheel positions have grown so far that their steps are {1e3 * coarse_m:.0f} mm: "
                "reset its integrators, or switch it off and on"
            )
        return tuple(said)


def _stalls(wheel: Wheel) -> bool:
    """Told to turn, and hardly turning, or turning the other way."""
    target, speed = abs(wheel.target_mps), math.copysign(1.0, wheel.target_mps) * wheel.speed_mps
    return target > STILL_MPS and speed < FOLLOWS * target


def _runs(wheel: Wheel, idle_for_s: float) -> bool:
    """Turning faster than told, by more than lag explains."""
    free_mps = STILL_MPS if idle_for_s > LAG_S else FREE_MPS
    return abs(wheel.speed_mps) > abs(wheel.target_mps) + free_mps
