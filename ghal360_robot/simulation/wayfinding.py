"""Where the virtual operator goes next: the nearest opening it has not looked into, by open ways."""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.simulation.recollection import (
    CELL_M,
    FLOOR,
    GIVEN_UP,
    HIDING,
    NEAR,
    SIDE_CELLS,
    SOLID,
    SPACE,
    Recollection,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import Pose2

    Mask = NDArray[np.bool_]

COARSE = 2
"""Ways are sought on cells of 0.2 m; half of a 1.1 m door is still two of them."""
STEP_M = CELL_M * COARSE
PASSABLE_M = 0.48
"""Clearance of a way on the remembered cells, which blur by 0.07 m; a 1.1 m door leaves 0.55 m."""
ROOMY_M = 0.90
"""People like to keep this far from things where there is room."""
NARROW_COST = 5.0
"""How much longer a way feels at the narrowest than in the open."""
LEAVE_M = 0.6
"""Within this of the robot also tight floor is passable: it got there, so it gets out."""
MIN_OPENING_CELLS = 3
"""Coarse cells. What is unknown behind less than 0.6 m is no place to go or look into."""
WIDE_OPENING_CELLS = 12
"""An opening this wide draws as much as one can."""
PULL_M = 1.5
"""How much further one goes for a wide opening than for a small one."""
TURN_COST_M = 2.5
"""Turning right back costs the robot the time of this way: half a turn at 0.8 rad/s, and ramps."""
EDGE_M = 2.0
"""Floor behind furniture that one has only looked over must be this much closer than an opening."""
HIDDEN_M = 8.0
"""Floor seen only from afar must be this much closer; enough to look again before leaving for another room."""
FAR_COST = 0.3
"""How much further places feel for each metre away from the start: things are rarely left far away."""
LOYALTY_M = 1.5
"""A new goal must be closer by this than the one that was chosen before."""
SAME_GOAL_M = 0.8
"""A goal this close to the previous one is the same."""
SHADOW_CELLS = 3
"""What is unknown but thinner than this is the shadow of a lamp, not a room."""
AROUND_CELLS = 9
"""An opening over a desk or beside a chair is looked into from the floor next to it."""
SIGHT_M = 3.0
"""One looks at most this far along the way to go."""


@dataclass(frozen=True, slots=True)
class Way:
    """Where to go: the goal, and the next point to look at and drive to."""

    goal: tuple[float, float]
    waypoint: tuple[float, float]
    length_m: float


def next_way(memory: Recollection, pose: Pose2, previous: tuple[float, float] | None) -> Way | None:
    """The way to the best opening, edge or place not yet seen from close by; None if all is known.

    `previous` is the goal chosen last.
    """
    clearance = memory.clearance()
    room = np.where(memory.has(FLOOR), clearance, 0.0)
    coarse = _pooled(room)
    usable = (room >= PASSABLE_M) & ~memory.has(GIVEN_UP)
    openings = _draw(memory, pose, _pooled(_openings(memory) & usable), previous)
    edges = _draw(memory, pose, _pooled(_edges(memory) & usable), previous)
    hidden = _draw(memory, pose, _pooled(usable & ~memory.has(NEAR)), previous)
    way = _best(memory, pose, coarse, np.minimum(openings, np.minimum(edges + EDGE_M, hidden + HIDDEN_M)))
    if way is None:
        return None
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(way))
    return Way(way[-1], _waypoint(memory, clearance, way), length)


def _openings(memory: Recollection) -> Mask:
    """Cells around the borders between space that was looked into and space that was not."""
    unknown = (~memory.has(SPACE | HIDING)).astype(np.uint8)
    wide = cv2.morphologyEx(unknown, cv2.MORPH_OPEN, np.ones((SHADOW_CELLS, SHADOW_CELLS), np.uint8))
    border = (cv2.dilate(wide, np.ones((3, 3), np.uint8)) > 0) & memory.has(SPACE) & ~memory.has(HIDING)
    around: Mask = cv2.dilate(border.astype(np.uint8), np.ones((AROUND_CELLS, AROUND_CELLS), np.uint8)) > 0
    return around


def _edges(memory: Recollection) -> Mask:
    """Cells beside floor not seen yet, as behind a row of desks that one only looked over."""
    unknown = (~memory.has(FLOOR | SOLID)).astype(np.uint8)
    beside: Mask = cv2.dilate(unknown, np.ones((3, 3), np.uint8)) > 0
    return beside


def _pooled(fine: NDArray[np.generic]) -> NDArray[np.generic]:
    """The greatest value of each coarse cell."""
    side = SIDE_CELLS // COARSE
    pooled: NDArray[np.generic] = fine.reshape(side, COARSE, side, COARSE).max(axis=(1, 3))
    return pooled


def _best(
    memory: Recollection,
    pose: Pose2,
    room: NDArray[np.generic],
    draw: NDArray[np.float64],
) -> list[tuple[float, float]] | None:
    """Points from the robot to the goal of least effort, or None if none can be reached."""
    if not np.isfinite(draw).any():
        return None
    row, column = memory.cell(pose.x, pose.y)
    start = (row // COARSE, column // COARSE)
    least = float(draw.min())
    effort, came = {start: 0.0}, {start: start}
    queue = [(0.0, start)]
    best, best_effort = None, math.inf
    rooms, draws = room.tolist(), draw.tolist()
    while queue:
        so_far, (y, x) = heapq.heappop(queue)
        if so_far > effort[y, x]:
            continue
        if so_far + least >= best_effort:
            break
        if so_far + draws[y][x] < best_effort:
            best, best_effort = (y, x), so_far + draws[y][x]
        for dy, dx, step in _STEPS:
            cell = (y + dy, x + dx)
            space = rooms[cell[0]][cell[1]]
            if space < PASSABLE_M and not (space > 0 and math.dist(cell, start) * STEP_M < LEAVE_M):
                continue
            tight = max(0.0, ROOMY_M - space) / (ROOMY_M - PASSABLE_M)
            then = so_far + step * (1.0 + NARROW_COST * min(tight, 1.0) ** 2)
            if then < effort.get(cell, math.inf):
                effort[cell], came[cell] = then, (y, x)
                heapq.heappush(queue, (then, cell))
    if best is None:
        return None
    cells = [best]
    while came[cells[-1]] != cells[-1]:
        cells.append(came[cells[-1]])
    return [(pose.x, pose.y)] + [_centre(memory, cell) for cell in cells[-2::-1]]


_STEPS = [(dy, dx, STEP_M * math.hypot(dx, dy)) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dx, dy) != (0, 0)]


def _draw(
    memory: Recollection, pose: Pose2, goals: NDArray[np.generic], previous: tuple[float, float] | None
) -> NDArray[np.float64]:
    """What each goal costs beside the way to it, m; inf where there is no goal. Small patches are none."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(goals.astype(np.uint8), connectivity=8)
    sizes = stats[:, cv2.CC_STAT_AREA].astype(np.float64)
    pull = PULL_M * np.minimum(sizes / WIDE_OPENING_CELLS, 1.0)
    per_label = np.where(sizes >= MIN_OPENING_CELLS, PULL_M - pull, np.inf)
    per_label[0] = np.inf
    cost: NDArray[np.float64] = per_label[labels]
    rows, columns = np.nonzero(np.isfinite(cost))
    if count < 2 or not rows.size:
        return cost
    x = memory.x0 + (columns + 0.5) * STEP_M
    y = memory.y0 + (rows + 0.5) * STEP_M
    aside = np.abs((np.arctan2(y - pose.y, x - pose.x) - pose.yaw + math.pi) % math.tau - math.pi)
    cost[rows, columns] += TURN_COST_M * aside / math.pi
    middle = SIDE_CELLS * CELL_M / 2
    cost[rows, columns] += FAR_COST * np.hypot(x - memory.x0 - middle, y - memory.y0 - middle)
    if previous is not None:
        same = np.hypot(x - previous[0], y - previous[1]) < SAME_GOAL_M
        cost[rows[same], columns[same]] -= LOYALTY_M
    return cost


def _centre(memory: Recollection, cell: tuple[int, int]) -> tuple[float, float]:
    return memory.x0 + (cell[1] + 0.5) * STEP_M, memory.y0 + (cell[0] + 0.5) * STEP_M


def _waypoint(
    memory: Recollection, clearance: NDArray[np.float64], way: list[tuple[float, float]]
) -> tuple[float, float]:
    """The furthest point of the way that can be driven to straight."""
    here = way[0]
    chosen = way[min(1, len(way) - 1)]
    for point in way[2:]:
        far = math.dist(here, point)
        if far > SIGHT_M or not _straight(memory, clearance, here, point):
            break
        chosen = point
    return chosen


def _straight(
    memory: Recollection, clearance: NDArray[np.float64], here: tuple[float, float], there: tuple[float, float]
) -> bool:
    far = math.dist(here, there)
    for i in range(1, int(far / CELL_M) + 1):
        part = i * CELL_M / far
        x, y = here[0] + part * (there[0] - here[0]), here[1] + part * (there[1] - here[1])
        if clearance[memory.cell(x, y)] < PASSABLE_M and i * CELL_M > LEAVE_M:
            return False
    return True
