"""A recorded run as an environment: the floor that its lidar saw, and the things that its detector named.

Everything is in the odometry frame of the run, moved so that the south-west corner is (0, 0): x east, y
north. Odometry drifts, so a long run gives a blurred map; where a run has a map of its own, that is better.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from calibration.mounting import LidarMount
from ghal360_robot.config import parse_config
from ghal360_robot.experiments.errors import EnvironmentFileError
from ghal360_robot.experiments.grid import FREE, FURNITURE, WALL, GridMap, Thing
from ghal360_robot.experiments.ground import far
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.surroundings import look_around

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from ghal360_robot.messages import Pose2

CELL_M = 0.25
REACH_M = 8.0
"""Further away a beam of half a degree is wider than a third of a cell."""
EVERY_S = 0.5
"""At 0.5 m/s a new scan every cell."""
BODY_M = 0.40
FEWEST_PLACES = 3
"""From so many places a thing has to be seen to be believed: two directions meet somewhere, three by chance hardly."""
SAME_M = 0.75
VOTE_M = 0.25


def recorded_map(run: Path, target: str = "") -> GridMap:
    """The environment of a run; `target` as in the run's configuration unless given.

    Raises EnvironmentFileError where the run has no scans, no odometry, or never saw the target well enough.
    """
    with RunReader(run) as reader:
        if not reader.config_json:
            raise EnvironmentFileError(f"{run} does not hold its settings, so nobody knows where its lidar sat")
        config = parse_config(reader.config_json, str(run))
        mounting = config.mounting
        lidar = LidarMount(
            mounting.lidar_x_m,
            mounting.lidar_y_m,
            mounting.lidar_z_m,
            math.radians(mounting.lidar_yaw_deg),
            mounting.lidar_upside_down,
        )
        poses = [(state.stamp_ns, state.pose) for state in reader.base_states()]
        if not poses:
            raise EnvironmentFileError(f"{run} holds no odometry")
        at = _Poses(poses)
        rays, ends = _scans(reader, lidar, at)
        sightings = _sightings(reader, at, config.perception.min_score)
    name = target or config.perception.target
    if not len(ends):
        raise EnvironmentFileError(f"{run} holds no lidar scans")
    low = np.floor(ends.min(axis=0) - 2 * CELL_M)
    cells = _cells(rays, ends, low, [pose for _, pose in poses])
    crossings = {each: _crossings(where) for each, where in sightings.items()}
    for spot, seen_from in (crossing for all_ in crossings.values() for crossing in all_):
        _open_sight(cells, low, spot, seen_from)
    things = {each: [Thing(each, *(spot - low).tolist()) for spot, _ in found] for each, found in crossings.items()}
    if not things.get(name):
        raise EnvironmentFileError(f"{run} never saw {name or 'its target'!r} from enough places to say where it is")
    return GridMap(
        name=run.name,
        cell_m=CELL_M,
        rows=tuple("".join(row) for row in cells[::-1]),
        targets=tuple(things[name][:1]),
        clutter=tuple(thing for each, all_ in things.items() if each != name for thing in all_),
        partial_steps=True,
    )


class _Poses:
    """The odometry of a run, by stamp."""

    def __init__(self, poses: list[tuple[int, Pose2]]) -> None:
        self._stamps = np.array([stamp for stamp, _ in poses])
        self._poses = [pose for _, pose in poses]

    def __call__(self, stamp_ns: int) -> Pose2:
        return self._poses[max(0, int(np.searchsorted(self._stamps, stamp_ns, side="right")) - 1)]


def _scans(
    reader: RunReader, lidar: LidarMount, at: _Poses
) -> tuple[list[tuple[NDArray[np.float64], NDArray[np.float64]]], NDArray[np.float64]]:
    """Of every scan kept: its origin and its ends (k, 2); and all ends together."""
    rays, last_ns = [], -math.inf
    for scan in reader.scans():
        if scan.stamp_ns - last_ns < EVERY_S * 1e9:
            continue
        last_ns = scan.stamp_ns
        pose, points = at(scan.stamp_ns), look_around(scan, lidar).points
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        turn = np.array([[cos, -sin], [sin, cos]])
        here = np.array([pose.x, pose.y])
        origin = here + turn @ np.array([lidar.x, lidar.y])
        ends = here + points @ turn.T
        rays.append((origin, ends[far(ends - origin) <= REACH_M]))
    return rays, np.concatenate([ends for _, ends in rays]) if rays else np.empty((0, 2))


def _cells(
    rays: list[tuple[NDArray[np.float64], NDArray[np.float64]]],
    ends: NDArray[np.float64],
    low: NDArray[np.float64],
    driven: list[Pose2],
) -> NDArray[np.str_]:
    """FREE where more beams passed than ended, and where the robot itself has been; what nobody saw is WALL."""
    columns, rows = (np.ceil((ends.max(axis=0) + CELL_M - low) / CELL_M)).astype(int).tolist()
    passed, hit = np.zeros((rows, columns), np.int64), np.zeros((rows, columns), np.int64)
    for origin, tips in rays:
        reach = far(tips - origin)
        for part in np.arange(0.0, REACH_M, CELL_M / 2):
            inside = part < reach - CELL_M
            points = origin + (tips[inside] - origin) * (part / reach[inside, None])
            _count(passed, points, low)
        _count(hit, tips, low)
    cells = np.where(passed > hit, FREE, WALL)
    blocked = hit >= np.maximum(passed, 1)
    body = math.ceil(BODY_M / CELL_M) - 1
    near = blocked.copy()
    for dy in range(-body, body + 1):
        for dx in range(-body, body + 1):
            near |= np.roll(blocked, (dy, dx), (0, 1))
    cells[near & (cells == FREE)] = FURNITURE  # free, but not for a body this wide
    for pose in driven:
        x, y = ((np.array([pose.x, pose.y]) - low) / CELL_M).astype(int).tolist()
        if 0 <= y < rows and 0 <= x < columns:
            cells[y, x] = FREE
    return cells


def _count(counts: NDArray[np.int64], points: NDArray[np.float64], low: NDArray[np.float64]) -> None:
    x, y = np.floor((points - low) / CELL_M).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < counts.shape[1]) & (y < counts.shape[0])
    cell = np.unique(y[inside] * counts.shape[1] + x[inside])
    counts.ravel()[cell] += 1


def _sightings(reader: RunReader, at: _Poses, min_score: float) -> dict[str, NDArray[np.float64]]:
    """Of each name: (k, 3) where it was seen from and in which direction of the odometry frame."""
    seen: dict[str, list[tuple[float, float, float]]] = {}
    for found in reader.detections():
        pose = at(found.stamp_ns)
        for item in found.objects:
            if item.score >= min_score:
                seen.setdefault(item.name, []).append((pose.x, pose.y, pose.yaw + item.yaw))
    return {name: np.array(rays) for name, rays in seen.items()}


def _open_sight(
    cells: NDArray[np.str_], low: NDArray[np.float64], spot: NDArray[np.float64], seen_from: NDArray[np.float64]
) -> None:
    """What the camera looked over is no wall, whatever the lidar met there 0.25 m above the floor."""
    for part in np.linspace(0.0, 1.0, round(REACH_M / CELL_M * 2)):
        x, y = np.floor((seen_from + part * (spot - seen_from) - low) / CELL_M).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < cells.shape[1]) & (y < cells.shape[0])
        x, y = x[inside], y[inside]
        cells[y, x] = np.where(cells[y, x] == WALL, FURNITURE, cells[y, x])


def _crossings(rays: NDArray[np.float64]) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Where most directions meet, then where most of the others do, each with the places (k, 2) it was seen from.

    Things seen from one place only are left out.
    """
    spots = []
    while len(rays) >= FEWEST_PLACES:
        steps = np.arange(VOTE_M, REACH_M, VOTE_M)
        x = rays[:, None, 0] + steps * np.cos(rays[:, None, 2])
        y = rays[:, None, 1] + steps * np.sin(rays[:, None, 2])
        points = np.stack((x, y), axis=2).reshape(-1, 2)
        cell, place = np.unique(np.round(points / VOTE_M).astype(int), axis=0, return_inverse=True)
        # One vote per place that it was seen from: a robot that stands and stares sees no distance.
        origin = np.unique(np.round(rays[:, :2] / VOTE_M).astype(int), axis=0, return_inverse=True)[1].ravel()
        votes = np.unique(np.column_stack((place.ravel(), np.repeat(origin, len(steps)))), axis=0)[:, 0]
        counts = np.bincount(votes, minlength=len(cell))
        if counts.max() < FEWEST_PLACES:
            break
        spot = cell[counts == counts.max()].mean(axis=0) * VOTE_M
        off = np.abs(np.cos(rays[:, 2]) * (spot[1] - rays[:, 1]) - np.sin(rays[:, 2]) * (spot[0] - rays[:, 0]))
        if not (off <= SAME_M).any():
            break
        spots.append((spot, rays[off <= SAME_M, :2]))
        rays = rays[off > SAME_M]
    return spots
