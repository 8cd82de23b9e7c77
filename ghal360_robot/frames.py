"""From the base's frame into the one that its pose is in, in the plane; REP-103."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ghal360_robot.messages import Pose2


def place_of(pose: Pose2, point: tuple[float, float]) -> tuple[float, float]:
    """A point (x, y) of the frame that stands at `pose`, metres, where `pose` itself is given."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return pose.x + c * point[0] - s * point[1], pose.y + s * point[0] + c * point[1]
