"""A pose from two wheel positions: exact arcs, and no jump where the base's integrators jump."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

MAX_WHEEL_MPS = 9.5
"""Firmware maximum 8.047 m/s plus 4.5 rad/s at half the track, rounded up (fact sheet section 7)."""
SLACK_S = 0.05
"""Five of the base's control ticks: its time and its positions are not sampled together."""


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

    def advance(self, right_m: float, left_m: float, time_s: float, track_m: float) -> Odometry:
        """The pose after the wheels moved to these positions at the base's own time."""
        if self.right_m is None or self.left_m is None:
            return replace(self, right_m=right_m, left_m=left_m, time_s=time_s)
        right, left, dt = right_m - self.right_m, left_m - self.left_m, time_s - self.time_s
        if dt < 0 or max(abs(right), abs(left)) > MAX_WHEEL_MPS * (dt + SLACK_S):
            return replace(self, right_m=right_m, left_m=left_m, time_s=time_s, jumps=self.jumps + 1)
        distance, turn = (right + left) / 2, (right - left) / track_m
        # The chord of an arc is shorter than the arc by sin(a)/a of half the turn.
        half = turn / 2
        chord = distance * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
        return replace(
            self,
            x=self.x + chord * math.cos(self.yaw + half),
            y=self.y + chord * math.sin(self.yaw + half),
            yaw=self.yaw + turn,
            right_m=right_m,
            left_m=left_m,
            time_s=time_s,
        )
