"""Matterport3D navigation graphs as environments.

Reads the connectivity files of the Matterport3D Simulator (`<scan>_connectivity.json`: one entry per
viewpoint with `image_id`, `pose` (4 x 4, row by row, metres, z up), `included`, `unobstructed`, `visible`,
`height`) and a file of ours beside it, `<scan>_objects.json`, with what can be seen from each viewpoint;
docs/environments.md describes it. The pictures themselves are not needed. Users bring their own licence.

Headings are clockwise from the dataset's +y axis, as in that simulator.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.experiments.environment_file import number, read_json, text
from ghal360_robot.experiments.errors import EnvironmentFileError
from ghal360_robot.experiments.ground import UNSEEN, Goal, Ground, wedges_of
from ghal360_robot.guidance.egocentric import N_WEDGES, WEDGE_WIDTH

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

CONNECTIVITY, OBJECTS = "_connectivity.json", "_objects.json"
FORMAT = "ghal360-objects"
VERSION = 1
MAX_VIEWPOINTS = 1000
"""The largest building of the dataset has 345."""
MAX_OBJECTS = 500
TOLERANCE_M = 1.0
"""Viewpoints are two metres apart: a start at 4 m is one between 3 and 5."""
AROUND_M = 1.0
"""The planner supposes things this far from viewpoints, in each direction."""
SAME_M = 2.0
"""Sightings of a target that put it further apart than this are of two things."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """An object as it is seen from a viewpoint; angles in radians, clockwise from +y."""

    name: str
    heading: float
    elevation: float
    width: float
    distance_m: float


@dataclass(frozen=True, slots=True, eq=False)
class NavigationGraph:
    """The included viewpoints of one building."""

    name: str
    ids: tuple[str, ...]
    xyz: NDArray[np.float64]
    """(n, 3) metres."""
    open_way: NDArray[np.bool_]
    """(n, n) whether one can step from one to the other."""
    visible: NDArray[np.bool_]
    """(n, n)"""
    sightings: tuple[tuple[Sighting, ...], ...]
    targets: tuple[str, ...]


def read_matterport(path: Path) -> NavigationGraph:
    """The graph of `<scan>_connectivity.json` with the objects beside it. Raises EnvironmentFileError."""
    if not path.name.endswith(CONNECTIVITY):
        raise EnvironmentFileError(f"{path}: a navigation graph is called <scan>{CONNECTIVITY}")
    scan = path.name.removesuffix(CONNECTIVITY)
    ids, xyz, open_way, visible = _viewpoints(read_json(path), str(path))
    beside = path.with_name(scan + OBJECTS)
    targets, seen = _objects(read_json(beside), str(beside))
    unknown = sorted(set(seen) - set(ids))
    if unknown:
        raise EnvironmentFileError(f"{beside} speaks of viewpoint {unknown[0]!r}, which {path.name} does not include")
    return NavigationGraph(scan, ids, xyz, open_way, visible, tuple(seen.get(id_, ()) for id_ in ids), targets)


def ground_of_graph(graph: NavigationGraph, *, range_m: float) -> Ground:
    """The tables of a graph; a step in a wedge leads to the nearest viewpoint in it, however far that is."""
    xy = graph.xyz[:, :2]
    between = xy[None, :, :] - xy[:, None, :]
    bearing = np.arctan2(between[..., 0], between[..., 1])
    length = np.linalg.norm(graph.xyz[None, :, :] - graph.xyz[:, None, :], axis=2)
    wedge = wedges_of(bearing)
    return Ground(
        name=graph.name,
        xy=xy,
        moves=_moves(graph.open_way, wedge, length),
        goals=tuple(_goal(graph, target, range_m) for target in graph.targets),
        tolerance_m=TOLERANCE_M,
        look=lambda: _spot_wedges(xy, graph.visible, range_m),
    )


def _moves(open_way: NDArray[np.bool_], wedge: NDArray[np.int64], length: NDArray[np.float64]) -> NDArray[np.int64]:
    n = len(open_way)
    moves = np.tile(np.arange(n)[:, None], (1, N_WEDGES))
    for k in range(N_WEDGES):
        far = np.where(open_way & (wedge == k), length, np.inf)
        nearest = far.argmin(axis=1)
        there = np.isfinite(far[np.arange(n), nearest])
        moves[there, k] = nearest[there]
    return moves


def _goal(graph: NavigationGraph, target: str, range_m: float) -> Goal:
    """The target as annotated; where it stands is worked out from the nearest sighting."""
    n = len(graph.ids)
    bearing, clutter = np.full(n, np.nan), np.zeros(n, np.int64)
    nearest: tuple[float, NDArray[np.float64]] | None = None
    estimates = []
    for i, seen in enumerate(graph.sightings):
        mine = [sighting for sighting in seen if sighting.name == target]
        if mine:
            best = min(mine, key=lambda sighting: sighting.distance_m)
            at = graph.xyz[i] + best.distance_m * _direction(best)
            estimates.append(at)
            if nearest is None or best.distance_m < nearest[0]:
                nearest = best.distance_m, at
            if best.distance_m <= range_m:
                bearing[i] = math.remainder(best.heading, math.tau)
        for sighting in seen:
            if sighting.name != target and sighting.distance_m <= range_m:
                clutter[i] |= 1 << int(wedges_of(np.array(sighting.heading)))
    if nearest is None:
        raise EnvironmentFileError(f"{graph.name}: nobody sees the target {target!r} from anywhere")
    apart = float(np.linalg.norm(np.array(estimates) - nearest[1], axis=1).max())
    if apart > SAME_M:
        raise EnvironmentFileError(
            f"{graph.name}: sightings put the target {target!r} {apart:.1f} m apart; a target has to be the only one"
        )
    x, y, _ = nearest[1].tolist()
    # In three dimensions: right above, on the next floor, is not near.
    distance = np.linalg.norm(graph.xyz - nearest[1], axis=1)
    return Goal(target, (x, y), bearing, distance, clutter.astype(np.uint8))


def _direction(sighting: Sighting) -> NDArray[np.float64]:
    """(3,) the unit vector towards a sighting."""
    flat = math.cos(sighting.elevation)
    return np.array(
        [flat * math.sin(sighting.heading), flat * math.cos(sighting.heading), math.sin(sighting.elevation)]
    )


def _spot_wedges(xy: NDArray[np.float64], visible: NDArray[np.bool_], range_m: float) -> NDArray[np.uint8]:
    """(n, 8 n) the wedge in which each spot around a viewpoint is seen from each viewpoint, or UNSEEN."""
    wedge = np.arange(N_WEDGES) * WEDGE_WIDTH
    offsets = AROUND_M * np.column_stack((np.sin(wedge), np.cos(wedge)))
    spots = (xy[:, None, :] + offsets).reshape(-1, 2)
    towards = spots[None, :, :] - xy[:, None, :]
    seen = np.repeat(visible | np.eye(len(xy), dtype=bool), N_WEDGES, axis=1)
    seen &= np.hypot(towards[..., 0], towards[..., 1]) <= range_m
    return np.where(seen, wedges_of(np.arctan2(towards[..., 0], towards[..., 1])), UNSEEN).astype(np.uint8)


def _viewpoints(
    body: Any, where: str
) -> tuple[tuple[str, ...], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    if not isinstance(body, list) or not 0 < len(body) <= MAX_VIEWPOINTS:
        raise EnvironmentFileError(f"{where} has to be a list of 1 to {MAX_VIEWPOINTS} viewpoints")
    if not all(isinstance(one, dict) for one in body):
        raise EnvironmentFileError(f"{where}: a viewpoint has to be an object")
    kept = [i for i, one in enumerate(body) if one.get("included") is True]
    if not kept:
        raise EnvironmentFileError(f"{where} includes no viewpoint")
    ids = tuple(text(body[i].get("image_id"), f"{where}: 'image_id'") for i in kept)
    if len(set(ids)) != len(ids):
        raise EnvironmentFileError(f"{where}: two viewpoints have the same image_id")
    xyz = np.array([_position(body[i].get("pose"), where) for i in kept])
    ways, views = (
        np.array([_flags(body[i].get(key), len(body), f"{where}: {key!r}") for i in kept])[:, kept]
        for key in ("unobstructed", "visible")
    )
    np.fill_diagonal(ways, val=False)
    return ids, xyz, ways, views


def _position(pose: Any, where: str) -> tuple[float, float, float]:
    if not isinstance(pose, list) or len(pose) != 16:
        raise EnvironmentFileError(f"{where}: a 'pose' has to be 16 numbers, row by row")
    x, y, z = (number(pose[i], f"{where}: 'pose'", -1e4, 1e4) for i in (3, 7, 11))
    return x, y, z


def _flags(flags: Any, n: int, what: str) -> list[bool]:
    if not isinstance(flags, list) or len(flags) != n or not all(isinstance(flag, bool) for flag in flags):
        raise EnvironmentFileError(f"{what} has to be {n} times true or false, one for each viewpoint of the file")
    return flags


def _objects(body: Any, where: str) -> tuple[tuple[str, ...], dict[str, tuple[Sighting, ...]]]:
    if not isinstance(body, dict) or body.get("format") != FORMAT or body.get("version") != VERSION:
        raise EnvironmentFileError(f"{where} is no file of format {FORMAT!r}, version {VERSION}")
    targets, viewpoints = body.get("targets"), body.get("viewpoints")
    if not isinstance(targets, list) or not 0 < len(targets) <= MAX_OBJECTS or not isinstance(viewpoints, dict):
        raise EnvironmentFileError(f"{where} has to have 'targets', a list of names, and 'viewpoints', an object")
    names = tuple(text(target, f"{where}: 'targets'") for target in targets)
    return names, {id_: _sightings(items, f"{where}: {id_!r:.40}") for id_, items in viewpoints.items()}


def _sightings(items: Any, what: str) -> tuple[Sighting, ...]:
    if not isinstance(items, list) or len(items) > MAX_OBJECTS or not all(isinstance(item, dict) for item in items):
        raise EnvironmentFileError(f"{what} has to have a list of at most {MAX_OBJECTS} objects")
    return tuple(
        Sighting(
            text(item.get("name"), f"{what}: 'name'"),
            math.radians(number(item.get("heading_deg"), f"{what}: 'heading_deg'", -720, 720)),
            math.radians(number(item.get("elevation_deg", 0), f"{what}: 'elevation_deg'", -90, 90)),
            math.radians(number(item.get("width_deg", 0), f"{what}: 'width_deg'", 0, 360)),
            number(item.get("distance_m"), f"{what}: 'distance_m'", 0, 1000),
        )
        for item in items
    )
