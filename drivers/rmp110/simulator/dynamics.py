"""How the base's targets follow commands, and the wheels the targets (fact sheet 9.1 to 9.6).

Clockwise-positive, machine units. Near a set-point the target approaches it first-order, like a low-pass.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from drivers.rmp110.codec.parameters import RMP110_STORED, Stored

TICK_NS = 10_000_000
"""The base's control period."""
DT = TICK_NS / 1e9
LOW_PASS_HZ = {0: 10.0, 1: 4.0, 2: 1.0, 4: 0.5, 8: 0.2}
"""Corner frequency by bits 9 to 12 of the input bitmap (fact sheet 6.4)."""
TOUCH = 1e-4
"""Closer than this the target is the set-point."""
TRACTION_MPS2 = 8.0
"""No tyre follows a target that jumps, as it does when an obstacle gives way."""
GRAVITY_MPS2 = 9.80665
"""The lateral acceleration that dialects without such a parameter allow (fact sheet 3.3)."""
TRUE_TIRE_M, TRUE_TRACK_M = RMP110_STORED["tire_diameter"], RMP110_STORED["track_width"]
"""The metal of the simulated base, whatever its parameters say."""

_FLOAT32 = struct.Struct("f")


@dataclass(frozen=True, slots=True)
class BitmapBits:
    """Where the input bitmap says what; None where a protocol has no such bit."""

    limit_mapping: int | None
    """Clear: the yaw rate is limited by the lateral acceleration."""
    accel_mapping: int | None
    drive_while_charging: int
    filter_shift: int


CAN_BITS = BitmapBits(limit_mapping=0x1, accel_mapping=0x2, drive_while_charging=0x8, filter_shift=9)
"""Fact sheet 6.4."""
V3_BITS = BitmapBits(limit_mapping=None, accel_mapping=None, drive_while_charging=0x2, filter_shift=7)
"""Fact sheet section 11; the lateral acceleration is a parameter of its own and always counts."""


@dataclass(frozen=True, slots=True)
class Settings:
    """What the drive obeys, taken from the stored parameters once instead of in every tick."""

    velocity: float
    accel: float
    decel: float
    dtz_decel: float
    coastdown: float
    yaw_rate: float
    yaw_accel: float
    lateral: float
    tire_m: float
    track_m: float
    lateral_mapping: bool
    """The yaw rate is limited by the lateral acceleration at this speed."""
    accel_mapping: bool
    """The velocity command is an acceleration; without one the base coasts."""
    drive_while_charging: bool
    share: float
    """Of the way to the set-point that one tick goes."""

    @classmethod
    def of(cls, stored: Stored, bits: BitmapBits) -> Settings:
        bitmap = int(stored["input_bitmap"])
        corner_hz = LOW_PASS_HZ.get(bitmap >> bits.filter_shift & 0xF, min(LOW_PASS_HZ.values()))
        return cls(
            velocity=stored["max_velocity"],
            accel=stored["max_accel"],
            decel=stored["max_decel"],
            dtz_decel=stored["max_dtz_decel"],
            coastdown=_or(stored, "coastdown_decel", 0.0),
            yaw_rate=stored["max_yaw_rate"],
            yaw_accel=stored["max_yaw_accel"],
            lateral=_or(stored, "lateral_accel", GRAVITY_MPS2),
            tire_m=stored["tire_diameter"],
            track_m=stored["track_width"],
            lateral_mapping=not bitmap & (bits.limit_mapping or 0),
            accel_mapping=bool(bitmap & (bits.accel_mapping or 0)),
            drive_while_charging=bool(bitmap & bits.drive_while_charging),
            share=1 - math.exp(-2 * math.pi * corner_hz * DT),
        )


def _or(stored: Stored, name: str, otherwise: float) -> float:
    """A stored parameter that not every dialect has."""
    try:
        return stored[name]
    except KeyError:
        return otherwise


def approach(target: float, goal: float, rise: float, fall: float, share: float) -> float:
    """One tick from `target` towards `goal`: first order near it, at `rise` or `fall` per second far away."""
    error = goal - target
    limit = (rise if abs(goal) > abs(target) and goal * target >= 0 else fall) * DT
    step = error if -TOUCH < error < TOUCH else error * share
    return target + (limit if step > limit else -limit if step < -limit else step)


@dataclass(slots=True)
class Drive:
    """Targets, effective limits, wheel speeds and positions; `yaw` is clockwise-positive."""

    right_m: float
    left_m: float
    linear_m: float = 0.0
    v_limit: float = 0.0
    yaw_limit: float = 0.0
    v_target: float = 0.0
    yaw_target: float = 0.0
    v: float = 0.0
    yaw: float = 0.0
    accel: float = 0.0
    blocked: bool = False
    grip: tuple[float, float] = (1.0, 1.0)
    """How much of what the left and the right wheel turn moves the base."""
    float32: bool = True
    odometer_m: float = 0.0

    def open_limits(self, settings: Settings) -> None:
        """In TRACTOR the effective limits grow to the stored ones at the acceleration limits."""
        self.v_limit = min(settings.velocity, self.v_limit + settings.accel * DT)
        self.yaw_limit = min(settings.yaw_rate, self.yaw_limit + settings.yaw_accel * DT)

    def shut_limits(self) -> None:
        self.v_limit = self.yaw_limit = 0.0

    @property
    def resting(self) -> bool:
        """Nothing turns and nothing is about to."""
        return self.v == self.yaw == self.v_target == self.yaw_target == self.accel == 0.0

    def follow(self, velocity: float, yaw_rate: float, settings: Settings, decel: float) -> None:
        """One tick of a normalised command; `decel` is the deceleration limit that counts now."""
        goal, rise = velocity * self.v_limit, settings.accel
        if settings.accel_mapping and self.v_limit:
            goal, rise = math.copysign(self.v_limit, velocity) if velocity else 0.0, abs(velocity) * settings.accel
            decel = decel if velocity else settings.coastdown
        self.v_target = approach(self.v_target, goal, rise, decel, settings.share)
        goal = yaw_rate * self.yaw_limit
        if settings.lateral_mapping and self.v_target:
            most = settings.lateral / abs(self.v_target)
            goal = max(-most, min(most, goal))
        yaw_accel = settings.yaw_accel
        self.yaw_target = approach(self.yaw_target, goal, yaw_accel, yaw_accel, settings.share)
        self._turn(settings.track_m)

    def _turn(self, track_m: float) -> None:
        """The wheels go after the targets as far as tyres and obstacles allow."""
        before = self.v
        if self.blocked:
            self.v = self.yaw = 0.0
        else:
            most = TRACTION_MPS2 * DT
            step = self.v_target - self.v
            self.v = self.v_target if -most <= step <= most else self.v + math.copysign(most, step)
            most /= track_m / 2
            step = self.yaw_target - self.yaw
            self.yaw = self.yaw_target if -most <= step <= most else self.yaw + math.copysign(most, step)
        self.accel = (self.v - before) / DT
        if self.v == self.yaw == 0.0:
            return
        half = self.yaw * track_m / 2
        self.odometer_m += abs(self.v) * DT
        self.right_m += (self.v - half) * DT
        self.left_m += (self.v + half) * DT
        self.linear_m += self.v * DT
        if self.float32:
            (self.right_m,) = _FLOAT32.unpack(_FLOAT32.pack(self.right_m))
            (self.left_m,) = _FLOAT32.unpack(_FLOAT32.pack(self.left_m))
            (self.linear_m,) = _FLOAT32.unpack(_FLOAT32.pack(self.linear_m))

    def wheels(self, track_m: float) -> tuple[float, float]:
        """Speeds of the right and the left wheel as their encoders see them, m/s."""
        half = self.yaw * track_m / 2
        return self.v - half, self.v + half

    def twist(self, settings: Settings) -> tuple[float, float]:
        """What happens on the floor: m/s forward, rad/s counter-clockwise (REP-103)."""
        right, left = self.wheels(settings.track_m)
        scale = TRUE_TIRE_M / settings.tire_m
        left, right = left * self.grip[0] * scale, right * self.grip[1] * scale
        return (right + left) / 2, (right - left) / TRUE_TRACK_M
