"""Procedural floors: the paper's three environments as open floors, and the same with rooms.

The paper shows no map. Sizes, furniture, distractors and cell are those of configuration F1 in
docs/REPRODUCTION.md; where things stand is drawn from the floor's number.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ghal360_robot.experiments.grid import FREE, FURNITURE, WALL, GridMap, Thing, ground_of
from ghal360_robot.experiments.ground import DISTANCES_M

CELL_M = 0.5
SIZES_M = ((20.0, 15.0), (26.0, 18.0), (26.0, 16.0))
FURNITURE_SHARE = 0.04
DISTRACTORS = 14
TARGETS = ("backpack", "laptop")
FEWEST_STARTS = 8
"""A target is drawn anew until every distance has so many places to start from."""
DRAWS = 500
DOOR_CELLS = 3
"""1.5 m: a step of three cells along the wall's normal passes anywhere in it."""


def open_floor(number: int) -> GridMap:
    """Floor `number` without walls; 0, 1, 2 are those of the experiments, any other is unseen."""
    rng = np.random.default_rng([number, 20])
    width, depth = SIZES_M[number % len(SIZES_M)]
    cells = np.full((round(depth / CELL_M), round(width / CELL_M)), FREE)
    cells[rng.random(cells.shape) < FURNITURE_SHARE] = FURNITURE
    return _furnished(f"open-{number}", cells, rng)


def room_floor(number: int) -> GridMap:
    """Floor `number` divided into six rooms that doors join into one ring and a few short cuts."""
    rng = np.random.default_rng([number, 21])
    width, depth = SIZES_M[number % len(SIZES_M)]
    cells = np.full((round(depth / CELL_M), round(width / CELL_M)), FREE)
    cells[rng.random(cells.shape) < FURNITURE_SHARE] = FURNITURE
    rows, columns = cells.shape
    middle = rows // 2 + int(rng.integers(-2, 3))
    walls = [columns // 3 + int(rng.integers(-2, 3)), 2 * columns // 3 + int(rng.integers(-2, 3))]
    cells[middle, :] = WALL
    for x in walls:
        cells[:, x] = WALL
    # Doors between neighbours: all but one of the seven, so that no way is the only one to most rooms.
    edges = [0, *walls, columns]
    closed = int(rng.integers(7))
    doors = [(middle, a + 2 + int(rng.integers(b - a - 4 - DOOR_CELLS)), True) for a, b in pairwise(edges)]
    doors += [
        (low + 2 + int(rng.integers(high - low - 4 - DOOR_CELLS)), x, False)
        for x in walls
        for low, high in ((0, middle), (middle, rows))
    ]
    for i, (row, column, along_x) in enumerate(doors):
        if i == closed:
            continue
        if along_x:
            cells[row - 3 : row + 4, column : column + DOOR_CELLS] = FREE
        else:
            cells[row : row + DOOR_CELLS, column - 3 : column + 4] = FREE
    return _furnished(f"rooms-{number}", cells, rng)


def _furnished(name: str, cells: np.ndarray, rng: np.random.Generator) -> GridMap:
    """Distractors and targets on free cells; every target can be approached from every distance."""
    free = np.argwhere(cells == FREE)[:, ::-1]
    rows = tuple("".join(row) for row in cells[::-1])

    def somewhere(what: str) -> Thing:
        x, y = (free[rng.integers(len(free))] + 0.5) * CELL_M
        return Thing(what, float(x), float(y))

    clutter = tuple(somewhere("clutter") for _ in range(DISTRACTORS))
    targets: list[Thing] = []
    for what in TARGETS:
        for _ in range(DRAWS):
            target = somewhere(what)
            ground = ground_of(GridMap(name, CELL_M, rows, (target,), ()), step_m=1.5, range_m=6.0)
            if all(len(ground.starts(ground.goals[0], d)) >= FEWEST_STARTS for d in DISTANCES_M):
                targets.append(target)
                break
        else:
            raise ValueError(f"floor {name}: no place for a {what} can be reached from every distance")
    return GridMap(name, CELL_M, rows, tuple(targets), clutter)
