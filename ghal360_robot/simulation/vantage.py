"""A place from which the target of a world can be seen, for pictures and detector tests."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.messages import Pose2
from ghal360_robot.simulation.world import CAMERA_HEIGHT_M

if TYPE_CHECKING:
    from ghal360_robot.simulation.world import World

CLEAR_M = 0.55


def vantage_pose(world: World, distance_m: float = 2.2) -> Pose2:
    """A free pose with the target in view at about `distance_m`, looking past it. Raises ValueError if none."""
    target = world.target_object()
    for radius in distance_m + np.array([0.0, 0.3, -0.3, 0.6, -0.6, 1.0]):
        for bearing in np.linspace(0.0, math.tau, 48, endpoint=False):
            x, y = target.x + radius * math.cos(bearing), target.y + radius * math.sin(bearing)
            if world.clearance(x, y) >= CLEAR_M and world.visible(x, y, CAMERA_HEIGHT_M, target):
                return Pose2(x, y, math.remainder(bearing + math.pi + 0.5, math.tau))
    raise ValueError(f"the {world.target} of this {world.name} cannot be seen from {distance_m} m")
