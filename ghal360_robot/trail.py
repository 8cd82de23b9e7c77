"""Where the base was a moment ago: a picture or a head pose is judged with the odometry of its own instant."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.angles import wrap
from ghal360_robot.messages import Pose2

if TYPE_CHECKING:
    from ghal360_robot.messages import BaseState

LENGTH = 100
"""Two seconds at 50 Hz; camera, decoder and detector together take less than one."""

JUMP_M, JUMP_RAD = 0.2, 0.3
"""Besides what a base can drive and turn in the time between two states: further is no motion but a restart."""
FASTEST_M_S, FASTEST_RAD_S = 3.0, 6.0


def further(then: Pose2, now: Pose2, distance_m: float, angle_rad: float) -> bool:
    """Whether from one pose to the next the base moved or turned by more than that."""
    moved, turned = math.hypot(now.x - then.x, now.y - then.y), abs(wrap(now.yaw - then.yaw))
    return moved > distance_m or turned > angle_rad


@dataclass(frozen=True, slots=True)
class Trail:
    """The last poses by stamp, oldest first."""

    stamps: tuple[int, ...] = ()
    poses: tuple[Pose2, ...] = ()

    def extended(self, state: BaseState | None) -> Trail:
        """With one more state; an old or repeated one changes nothing."""
        if state is None or (self.stamps and state.stamp_ns <= self.stamps[-1]):
            return self
        return Trail((*self.stamps[1 - LENGTH :], state.stamp_ns), (*self.poses[1 - LENGTH :], state.pose))

    def began_anew(self, state: BaseState | None) -> bool:
        """Whether this newest state continues another odometry: the base was restarted, or its counters were."""
        if state is None or not self.stamps or state.stamp_ns <= self.stamps[-1]:
            return False
        seconds = (state.stamp_ns - self.stamps[-1]) / 1e9
        furthest_m, furthest_rad = JUMP_M + FASTEST_M_S * seconds, JUMP_RAD + FASTEST_RAD_S * seconds
        return further(self.poses[-1], state.pose, furthest_m, furthest_rad)

    def at(self, stamp_ns: int) -> Pose2:
        """The pose at an instant: interpolated inside the trail, its nearest end outside, origin if empty."""
        if not self.stamps:
            return Pose2()
        after = bisect.bisect_left(self.stamps, stamp_ns)
        if after == 0:
            return self.poses[0]
        if after == len(self.stamps):
            return self.poses[-1]
        t0, t1 = self.stamps[after - 1], self.stamps[after]
        a, b = self.poses[after - 1], self.poses[after]
        share = (stamp_ns - t0) / (t1 - t0)
        turned = wrap(b.yaw - a.yaw)
        return Pose2(a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), wrap(a.yaw + share * turned))
