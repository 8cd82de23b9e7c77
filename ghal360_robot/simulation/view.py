"""What the simulated lidar sees of the world from a moving body."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from drivers.tim571.geometry import BEAM_YAW

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ghal360_robot.messages import Pose2
    from ghal360_robot.simulation.world import World

LIDAR_AHEAD_M = 0.20
"""Where the scan plane's centre sits on the simulated robot; the robot's own configuration says the same."""

_YAW = np.asarray(BEAM_YAW, np.float64)


def lidar_view(world: World, pose: Callable[[], Pose2]) -> Callable[[int], tuple[NDArray[np.float64], None]]:
    """A source of distances (811,) for `Tim571Simulator`, from wherever `pose` says that the body is."""

    def see(_stamp_ns: int) -> tuple[NDArray[np.float64], None]:
        here = pose()
        x = here.x + LIDAR_AHEAD_M * math.cos(here.yaw)
        y = here.y + LIDAR_AHEAD_M * math.sin(here.yaw)
        return world.ranges(x, y, here.yaw + _YAW), None

    return see
