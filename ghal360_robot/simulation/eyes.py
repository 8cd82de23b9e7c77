"""What a human in front of the panorama sees of the simulated world: free floor ahead, and the target or not.

Line of sight only; nothing here tells more than the picture shows within the operator's field of view.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.messages import Cue
from ghal360_robot.simulation.world import CAMERA_HEIGHT_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import Pose2
    from ghal360_robot.simulation.world import World

LOOKS_PER_TURN = 180
"""Every 2 degrees: 0.28 m apart at the end of the view, half of what the robot needs to pass."""
VIEW_M = 8.0
"""Beyond, a human judges no distances in a 2K panorama (5 pixels per degree)."""
RECOGNISED_M = 6.0
"""A backpack 6 m away is 17 x 23 pixels; further away nobody knows it for one."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One look: `free_m` (k,) of floor along `yaws` (k,) of the world, up to VIEW_M."""

    pose: Pose2
    yaws: NDArray[np.float64]
    free_m: NDArray[np.float64]
    target_yaw: float | None
    """World direction of the target if it is in view."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """All that the operator perceives: the picture, and what the page says about the robot."""

    view: View
    cue: Cue = Cue.NONE
    armed: bool = False
    ready: bool = False
    """A press of "arm" would arm."""
    trouble: bool = False
    """The link or a device is in trouble; nobody presses buttons then."""


def look(world: World, pose: Pose2, head_yaw: float, fov: float) -> View:
    """What is visible from the robot's camera with the head at `head_yaw` (base frame) and a field of `fov`."""
    gaze = pose.yaw + head_yaw
    step = math.tau / LOOKS_PER_TURN
    half = int(fov / 2 / step)
    yaws = gaze + step * np.arange(-half, half + 1, dtype=np.float64)
    free = np.minimum(world.ranges(pose.x, pose.y, yaws), VIEW_M)
    return View(pose, yaws, free, _target_yaw(world, pose, gaze, fov))


def _target_yaw(world: World, pose: Pose2, gaze: float, fov: float) -> float | None:
    target = world.target_object()
    dx, dy = target.x - pose.x, target.y - pose.y
    yaw = math.atan2(dy, dx)
    if math.hypot(dx, dy) > RECOGNISED_M or abs(math.remainder(yaw - gaze, math.tau)) > fov / 2:
        return None
    return yaw if world.visible(pose.x, pose.y, CAMERA_HEIGHT_M, target) else None
