"""How the robot's body moves through the simulated world: unicycle kinematics, and walls that do not give."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.messages import Pose2, Twist

if TYPE_CHECKING:
    from ghal360_robot.simulation.world import World

TOUCH_M = 0.002
"""A body leaning on a wall stays in touch until it is this far away: one collision, not a hundred."""


@dataclass(frozen=True, slots=True)
class Body:
    """Where the robot truly is, how far it went, and how often it hit something."""

    pose: Pose2
    distance_m: float = 0.0
    collisions: int = 0
    touching: bool = False


def advance(pose: Pose2, twist: Twist, dt_s: float) -> Pose2:
    """The pose after `dt_s` of a constant twist: exact on the arc."""
    turn = twist.w * dt_s
    if abs(turn) < 1e-9:
        along, aside = twist.v * dt_s, 0.0
    else:
        along = twist.v * math.sin(turn) / twist.w
        aside = twist.v * (1.0 - math.cos(turn)) / twist.w
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    yaw = math.remainder(pose.yaw + turn, math.tau)
    return Pose2(pose.x + c * along - s * aside, pose.y + s * along + c * aside, yaw)


def move(world: World, body: Body, twist: Twist, dt_s: float, radius: float) -> Body:
    """One step of the body; against a solid it turns but does not advance.

    The first touch counts as a collision; leaning on the same solid does not count again.
    """
    goal = advance(body.pose, twist, dt_s)
    if world.clearance(goal.x, goal.y) >= radius:
        gone = math.hypot(goal.x - body.pose.x, goal.y - body.pose.y)
        touching = body.touching and world.clearance(goal.x, goal.y) < radius + TOUCH_M
        return Body(goal, body.distance_m + gone, body.collisions, touching)
    stuck = Pose2(body.pose.x, body.pose.y, goal.yaw)
    return Body(stuck, body.distance_m, body.collisions + (not body.touching), touching=True)
