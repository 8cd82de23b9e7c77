"""How the base's targets follow commands (fact sheet 9.1 to 9.6); clockwise-positive, machine units."""

from __future__ import annotations

import math
from dataclasses import dataclass

from drivers.rmp110.codec.parameters import Stored

TICK_NS = 10_000_000
"""The base's control period."""
DT = TICK_NS / 1e9
LOW_PASS_HZ = 10.0
"""Close to the set-point the target approaches it like a low-pass of this corner frequency."""
SHARE = 1 - math.exp(-2 * math.pi * LOW_PASS_HZ * DT)
TOUCH = 1e-4
"""Closer than this the target is the set-point."""


def approach(target: float, goal: float, rise: float, fall: float) -> float:
    """One tick from `target` towards `goal`: first order near it, at `rise` or `fall` per second far away."""
    error = goal - target
    if abs(error) < TOUCH:
        return goal
    speeding_up = abs(goal) > abs(target) and goal * target >= 0
    limit = (rise if speeding_up else fall) * DT
    return target + max(-limit, min(limit, error * SHARE))


@dataclass(slots=True)
class Drive:
    """Targets, effective limits and wheel positions of both wheels; `yaw` is clockwise-positive."""

    right_m: float
    left_m: float
    v_limit: float = 0.0
    yaw_limit: float = 0.0
    v_target: float = 0.0
    yaw_target: float = 0.0
    v: float = 0.0
    yaw: float = 0.0
    blocked: bool = False

    def open_limits(self, stored: Stored) -> None:
        """In TRACTOR the effective limits grow to the stored ones at the acceleration limits."""
        self.v_limit = min(stored["max_velocity"], self.v_limit + stored["max_accel"] * DT)
        self.yaw_limit = min(stored["max_yaw_rate"], self.yaw_limit + stored["max_yaw_accel"] * DT)

    def shut_limits(self) -> None:
        self.v_limit = self.yaw_limit = 0.0

    def follow(self, velocity: float, yaw_rate: float, stored: Stored, decel: float) -> None:
        """One tick of a normalised command; `decel` is the deceleration limit that counts now."""
        self.v_target = approach(self.v_target, velocity * self.v_limit, stored["max_accel"], decel)
        yaw_accel = stored["max_yaw_accel"]
        self.yaw_target = approach(self.yaw_target, yaw_rate * self.yaw_limit, yaw_accel, yaw_accel)
        self.v, self.yaw = (0.0, 0.0) if self.blocked else (self.v_target, self.yaw_target)
        right, left = self.wheels(stored["track_width"])
        self.right_m += right * DT
        self.left_m += left * DT

    def wheels(self, track_m: float) -> tuple[float, float]:
        """Speeds of the right and the left wheel, m/s."""
        return self.v - self.yaw * track_m / 2, self.v + self.yaw * track_m / 2
