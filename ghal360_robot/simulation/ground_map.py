"""The simulated floor as an occupancy map, and poses of the world in the robot's odometry frame.

The odometry starts where the robot stood when it was connected: at the world's start.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.messages import Pose2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.simulation.world import World

RESOLUTION_M = 0.05
FREE, OCCUPIED = 254, 0
"""Grey values of ROS map files: white is free, black is not."""


def occupancy(world: World) -> NDArray[np.uint8]:
    """(rows, columns) of cells of RESOLUTION_M; row 0 is the top of the map (largest y)."""
    columns, rows = (math.ceil(span / RESOLUTION_M) for span in (world.plan.width, world.plan.depth))
    x = (np.arange(columns) + 0.5) * RESOLUTION_M
    y = (np.arange(rows)[::-1] + 0.5) * RESOLUTION_M
    return np.where(world.clearances(*np.meshgrid(x, y)) > 0.0, FREE, OCCUPIED).astype(np.uint8)


def in_odometry(start: Pose2, pose: Pose2) -> Pose2:
    """A pose of the world as the robot's odometry would call it."""
    dx, dy = pose.x - start.x, pose.y - start.y
    c, s = math.cos(start.yaw), math.sin(start.yaw)
    return Pose2(c * dx + s * dy, c * dy - s * dx, math.remainder(pose.yaw - start.yaw, math.tau))
