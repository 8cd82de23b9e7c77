"""What a human in front of the panorama sees of the simulated world: free floor, open space, the target or not.

Line of sight only; nothing here tells more than the picture shows. The whole panorama is in front of the
operator, so floor and space are known all around, but a thing is recognised only in the view they turn to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.messages import Cue
from ghal360_robot.simulation.raycast import Shapes
from ghal360_robot.simulation.rooms import CEILING_M
from ghal360_robot.simulation.world import CAMERA_HEIGHT_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import Pose2
    from ghal360_robot.simulation.world import World, WorldObject

LOOKS_PER_TURN = 120
"""Every 3 degrees: 0.4 m apart at the end of the view; a door is three of them."""
VIEW_M = 8.0
"""Beyond, a human judges no distances in a 2K panorama (5 pixels per degree)."""
RECOGNISED_M = 6.0
"""A backpack 6 m away is 17 x 23 pixels; further away nobody knows it for one."""
MARKED_M = 10.0
"""Unless it is pointed out: who is told that these 10 x 14 pixels are it can say whether they may be."""
OVER_M = 1.0
"""The camera looks over what is lower than this, as desks and sofas, into the room behind."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One look around along `yaws` (k,) of the world, in rising order once round. Distances end at VIEW_M."""

    pose: Pose2
    yaws: NDArray[np.float64]
    floor_m: NDArray[np.float64]
    """Free floor (k,) before the first thing that stands in the way."""
    space_m: NDArray[np.float64]
    """Open space (k,) before the first thing that hides what is behind it."""
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


class Eyes:
    """Looks at one world. `look` is a pure function of its arguments."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._target = world.target_object()
        hiding = [item for item in world.objects if item.z <= OVER_M <= item.top]
        self._hiding = Shapes.of(hiding, world.plan.wall_boxes(), CEILING_M)
        tall = (item for item in hiding if item is not self._target)
        self._tall = Shapes.of(tall, world.plan.wall_boxes(), CEILING_M)
        rest = (item for item in world.objects if item is not self._target)
        self._rest = Shapes.of(rest, world.plan.wall_boxes(), CEILING_M)
        self._aims = _aims(self._target)
        step = math.tau / LOOKS_PER_TURN
        self._yaws = -math.pi + step * np.arange(LOOKS_PER_TURN, dtype=np.float64)

    def look(self, pose: Pose2, head_yaw: float, fov: float, *, marked: bool = False) -> View:
        """What is visible from the robot's camera with the head at `head_yaw` (base frame) and a field of `fov`.

        `marked`: the page points the target out, as it does with a confirm.
        """
        floor = np.minimum(self._world.ranges(pose.x, pose.y, self._yaws), VIEW_M)
        space = np.minimum(self._hiding.ranges(pose.x, pose.y, self._yaws), VIEW_M)
        return View(pose, self._yaws, floor, space, self._target_yaw(pose, pose.yaw + head_yaw, fov, marked=marked))

    def _target_yaw(self, pose: Pose2, gaze: float, fov: float, *, marked: bool) -> float | None:
        dx, dy = self._target.x - pose.x, self._target.y - pose.y
        yaw = math.atan2(dy, dx)
        reach = MARKED_M if marked else RECOGNISED_M
        if math.hypot(dx, dy) > reach or abs(math.remainder(yaw - gaze, math.tau)) > fov / 2:
            return None
        eye = np.array([[pose.x, pose.y, CAMERA_HEIGHT_M]])
        # Chairs and table legs are solid here and full of gaps in the picture: a piece that is pointed out is enough.
        hiding = self._tall if marked else self._rest
        return yaw if any(hiding.sees(eye, aim)[0] for aim in self._aims) else None


def _aims(item: WorldObject) -> tuple[tuple[float, float, float], ...]:
    """Points of a thing by which a human knows it even if the rest is hidden: middle, flanks, top."""
    cos, sin = math.cos(item.yaw), math.sin(item.yaw)
    return tuple(
        (item.x + right * item.size[0] * cos, item.y + right * item.size[0] * sin, item.z + up * item.size[2])
        for right, up in ((0.0, 0.5), (0.0, 0.9), (-0.4, 0.6), (0.4, 0.6))
    )


def look(world: World, pose: Pose2, head_yaw: float, fov: float) -> View:
    """One look at a world; `Eyes` spares the preparation when there are many."""
    return Eyes(world).look(pose, head_yaw, fov)
