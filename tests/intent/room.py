"""A room of straight walls with a lidar and a base in it, just enough to close the loop in a test."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.egocentric import sticky_wedge
from ghal360_robot.intent.controller import DriveSettings, DriveState, step_drive
from ghal360_robot.messages import Pose2, Twist

TICK_S = 0.02
TICKS_PER_SCAN = 3
BEAMS = np.radians(np.linspace(-135, 135, 811))
RANGE_NOISE_M = 0.01

Wall = tuple[tuple[float, float], tuple[float, float]]


def door(width: float, x: float = 3.0, thickness: float = 0.15) -> list[Wall]:
    """A wall across the way with a door in its middle."""
    walls: list[Wall] = []
    for side in (-1, 1):
        near, far = side * width / 2, side * 4.0
        walls += [
            ((x, near), (x, far)),
            ((x, near), (x + thickness, near)),
            ((x + thickness, near), (x + thickness, far)),
        ]
    return walls


@dataclass
class Room:
    walls: list[Wall]
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    v: float = 0.0
    w: float = 0.0
    lag_s: float = 0.15
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))
    closest_m: float = math.inf
    drive: DriveState = field(default_factory=DriveState)

    def scan(self) -> NDArray[np.float64]:
        """Points in the base frame, (n, 2)."""
        a = np.array([wall[0] for wall in self.walls]) - (self.x, self.y)
        b = np.array([wall[1] for wall in self.walls]) - (self.x, self.y)
        ray = np.column_stack([np.cos(BEAMS + self.yaw), np.sin(BEAMS + self.yaw)])[:, None, :]
        along = (b - a)[None, :, :]
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = ray[..., 0] * along[..., 1] - ray[..., 1] * along[..., 0]
            distance = (a[:, 0] * along[..., 1] - a[:, 1] * along[..., 0]) / cross
            share = (a[:, 0] * ray[..., 1] - a[:, 1] * ray[..., 0]) / cross
            distance[~((distance > 0) & (share >= 0) & (share <= 1))] = np.inf
        seen = np.isfinite(distance.min(axis=1))
        r = distance.min(axis=1)[seen] + self.rng.normal(0, RANGE_NOISE_M, int(seen.sum()))
        return np.column_stack([r * np.cos(BEAMS[seen]), r * np.sin(BEAMS[seen])])

    def clearance(self) -> float:
        """Metres from the robot's centre to the nearest wall."""
        a = np.array([wall[0] for wall in self.walls])
        along = np.array([wall[1] for wall in self.walls]) - a
        centre = np.array([self.x, self.y])
        share = np.clip(((centre - a) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
        return float(np.hypot(*(a + share[:, None] * along - centre).T).min())

    def look_and_drive(
        self, settings: DriveSettings, goal: tuple[float, float], gaze_error: float, seconds: float
    ) -> bool:
        """Drive with the operator's gaze on `goal`, off by a constant error; True once past the door."""
        points, wedge = self.scan(), None
        for tick in range(round(seconds / TICK_S)):
            if tick % TICKS_PER_SCAN == 0:
                points = self.scan()
            gaze = math.atan2(goal[1] - self.y, goal[0] - self.x) + gaze_error
            wedge = sticky_wedge(-gaze, wedge, math.radians(3))
            self.drive = step_drive(
                settings,
                self.drive,
                intention=wedge,
                gaze=gaze,
                pose=Pose2(self.x, self.y, self.yaw),
                measured=Twist(self.v, self.w),
                cue_shown=False,
                points=points,
            )
            self.move(self.drive.twist)
            self.closest_m = min(self.closest_m, self.clearance())
            if self.x > goal[0] - 0.7:
                return True
        return False

    def move(self, wanted: Twist) -> None:
        """The base follows with a lag, as a driven mass does."""
        follow = 1 - math.exp(-TICK_S / self.lag_s)
        self.v += follow * (wanted.v - self.v)
        self.w += follow * (wanted.w - self.w)
        self.yaw += self.w * TICK_S
        self.x += self.v * math.cos(self.yaw) * TICK_S
        self.y += self.v * math.sin(self.yaw) * TICK_S
