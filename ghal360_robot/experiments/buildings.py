"""The simulator's office and home as grid environments, so that the same search runs on tables and on wheels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.experiments.grid import FREE, FURNITURE, WALL, GridMap, Thing
from ghal360_robot.simulation.raycast import Shapes
from ghal360_robot.simulation.rooms import CEILING_M
from ghal360_robot.simulation.world import ROBOT_RADIUS_M, Role, build_world

if TYPE_CHECKING:
    from ghal360_robot.simulation.world import World

CELL_M = 0.25
"""Doors of 1.1 m leave two or three cells for the robot's middle."""
OVER_M = 1.0
"""The camera looks over what is lower."""


def building(kind: str, seed: int, target: str) -> GridMap:
    """The building of that kind, as the simulator furnishes it. Raises ValueError for unknown names."""
    return building_map(build_world(kind, seed, target))


def building_map(world: World) -> GridMap:
    """FREE where the robot's middle may be, WALL where nobody sees through or over."""
    columns, rows = int(world.plan.width / CELL_M), int(world.plan.depth / CELL_M)
    x, y = np.meshgrid((np.arange(columns) + 0.5) * CELL_M, (np.arange(rows) + 0.5) * CELL_M)
    tall = (item for item in world.objects if item.z <= OVER_M <= item.top and item is not world.target_object())
    hiding = Shapes.of(tall, world.plan.wall_boxes(), CEILING_M)
    hidden = hiding.clearance(np.column_stack((x.ravel(), y.ravel()))).reshape(x.shape) <= CELL_M / 2
    cells = np.where(world.clearances(x, y) > ROBOT_RADIUS_M, FREE, FURNITURE)
    cells[hidden] = WALL
    # What hangs on a wall or stands in a corner is in a wall's cell, and nothing of it would be seen.
    target = world.target_object()
    row, column = int(target.y / CELL_M), int(target.x / CELL_M)
    around = cells[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
    around[around == WALL] = FURNITURE
    clutter = tuple(Thing(item.name, item.x, item.y) for item in world.objects if item.role is Role.CLUTTER)
    return GridMap(
        name=f"{world.name}-{world.seed}-{world.target}",
        cell_m=CELL_M,
        rows=tuple("".join(row) for row in cells[::-1]),
        targets=(Thing(target.name, target.x, target.y),),
        clutter=clutter,
        partial_steps=True,
    )
