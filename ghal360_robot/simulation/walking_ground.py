"""The floor of a world as those see it who walk or drive on it by heart: how much room there is, and ways to places.

It knows the furniture only; who moves is looked after by who moves.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.simulation.floor_grid import CELL_M, flood, walking_distance
from ghal360_robot.simulation.plant import Body, advance, move
from ghal360_robot.simulation.world import ROBOT_RADIUS_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import Twist
    from ghal360_robot.simulation.world import World

FINE_M = 0.05
"""Cells of the clearance that is looked up rather than computed."""
COARSENESS_M = FINE_M * math.sqrt(0.5)
"""A point is at most this far from its cell's middle, and clearance changes no faster than the place."""
PLACES = 24
"""Places in a building that people walk between."""
PLACE_ROOM_M = 0.48
"""Clearance of a place to go to or to start from."""
PERSON_WAY_M, ROBOT_WAY_M = 0.34, 0.50
"""Clearance of the ways of people, and of the robot: every room can be reached with 0.52 m (placement)."""
NEAR_M = 0.05
"""Where the looked-up room is less than this more than the robot needs, the exact distance is taken."""
LOOK_CELLS = 12
"""How far along the way a walker looks for the next point to walk to straight."""

STEPS = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dx, dy) != (0, 0)]


class Ground:
    """Room and ways on the floor of one world. What is asked often is remembered; the answers never change."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._fine = _clearances(world, FINE_M)
        self._rows: list[list[float]] = self._fine.tolist()
        coarse = _clearances(world, CELL_M)
        self._open = {radius: coarse > radius for radius in (PERSON_WAY_M, ROBOT_WAY_M)}
        self._roomy = flood(coarse > PLACE_ROOM_M, self._seed(coarse))
        self._ways: dict[tuple[float, tuple[int, int]], list[list[float]]] = {}

    @staticmethod
    def _seed(coarse: NDArray[np.float64]) -> tuple[np.intp, ...]:
        return np.unravel_index(int(np.argmax(coarse)), coarse.shape)

    @cached_property
    def places(self) -> NDArray[np.float64]:
        """(n, 2) places all over the building from which every other one can be reached, the same for ever."""
        cells = np.argwhere(self._roomy)
        rng = np.random.default_rng(self.world.seed)
        chosen = [cells[rng.integers(len(cells))]]
        while len(chosen) < PLACES:
            # The best of a few draws by distance to the others: spread out, but not to the corners only.
            draws = cells[rng.integers(len(cells), size=4)]
            apart = np.min([np.hypot(*(draws - cell).T) for cell in chosen], axis=0)
            chosen.append(draws[int(apart.argmax())])
        return (np.array(chosen)[:, ::-1] + 0.5) * CELL_M

    def draw(self, rng: np.random.Generator) -> tuple[float, float]:
        """Any point with room around it."""
        cells = np.argwhere(self._roomy)
        row, column = cells[rng.integers(len(cells))]
        return (float(column) + 0.5) * CELL_M, (float(row) + 0.5) * CELL_M

    def room(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """A lower bound of the clearance at points of any shape; 0 outside."""
        columns, rows = np.floor(x / FINE_M).astype(np.intp), np.floor(y / FINE_M).astype(np.intp)
        height, width = self._fine.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        fine = self._fine[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
        return np.where(inside, np.maximum(fine - COARSENESS_M, 0.0), 0.0)

    def room_at(self, x: float, y: float) -> float:
        """A lower bound of the clearance at one point."""
        row, column = math.floor(y / FINE_M), math.floor(x / FINE_M)
        if not (0 <= row < len(self._rows) and 0 <= column < len(self._rows[0])):
            return 0.0
        return max(self._rows[row][column] - COARSENESS_M, 0.0)

    def rolled(self, body: Body, moving: Twist, dt_s: float) -> tuple[Body, bool]:
        """The robot's body after `dt_s`, and whether anything is near it: only there it may touch."""
        goal = advance(body.pose, moving, dt_s)
        if self.room_at(goal.x, goal.y) <= ROBOT_RADIUS_M + NEAR_M:
            return move(self.world, body, moving, dt_s, ROBOT_RADIUS_M), True
        gone = math.hypot(goal.x - body.pose.x, goal.y - body.pose.y)
        return Body(goal, body.distance_m + gone, body.collisions), False

    def aim(
        self, way_m: float, here: tuple[float, float], goal: tuple[float, float]
    ) -> tuple[tuple[float, float], float]:
        """The furthest point of the way to `goal` that can be walked to straight, and how long the way is.

        Ways have `way_m` of clearance (PERSON_WAY_M, ROBOT_WAY_M); without a way from here the length is inf.
        """
        length = self._way(way_m, goal)
        row, column = int(here[1] / CELL_M), int(here[0] / CELL_M)
        if not (1 <= row < len(length) - 1 and 1 <= column < len(length[0]) - 1):
            return here, math.inf
        whole = min(length[row + dy][column + dx] for dy, dx in [(0, 0), *STEPS])
        if whole < 2 * CELL_M:
            return goal, math.dist(here, goal)
        aim = None
        for step in range(LOOK_CELLS):
            row, column = min(((row + dy, column + dx) for dy, dx in STEPS), key=lambda cell: length[cell[0]][cell[1]])
            point = ((column + 0.5) * CELL_M, (row + 0.5) * CELL_M)
            last = length[row][column] < CELL_M
            if not last and step % 3:
                continue
            if aim is not None and not self._straight(way_m, here, point):
                break
            aim = point
            if last:
                break
        return aim or here, whole

    def _way(self, way_m: float, goal: tuple[float, float]) -> list[list[float]]:
        cell = int(goal[1] / CELL_M), int(goal[0] / CELL_M)
        if (way_m, cell) not in self._ways:
            mask = self._open[way_m]
            goals = np.zeros_like(mask)
            goals[cell] = True
            self._ways[way_m, cell] = walking_distance(mask, goals).tolist()
        return self._ways[way_m, cell]

    def _straight(self, way_m: float, here: tuple[float, float], there: tuple[float, float]) -> bool:
        parts = max(1, math.ceil(math.dist(here, there) / CELL_M))
        return all(
            self.room_at(here[0] + i / parts * (there[0] - here[0]), here[1] + i / parts * (there[1] - here[1]))
            > way_m - 2 * COARSENESS_M
            for i in range(1, parts + 1)
        )


def _clearances(world: World, cell_m: float) -> NDArray[np.float64]:
    """(rows, columns) the clearance in the middle of every cell; row 0 at y = 0."""
    columns, rows = round(world.plan.width / cell_m), round(world.plan.depth / cell_m)
    x: NDArray[np.float64] = (np.arange(columns, dtype=np.float64) + 0.5) * cell_m
    # Row by row, because the whole floor against all furniture at once falls out of the processor's cache.
    return np.stack([world.clearances(x, np.full(columns, (row + 0.5) * cell_m)) for row in range(rows)])
