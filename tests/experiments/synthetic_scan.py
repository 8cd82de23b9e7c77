"""Makes the small navigation graph in data/, in the format of the Matterport3D Simulator's connectivity files.

    python -m tests.experiments.synthetic_scan

Three rooms on a corridor, 18 m x 11 m, viewpoints about two metres apart. No part of it is Matterport data.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from ghal360_robot.experiments.grid import GridMap, Thing, _Sight

DATA = Path(__file__).parent / "data"
SCAN = "synthetic"
CELL_M = 0.25
WIDTH_M, DEPTH_M = 18.0, 11.0
EYE_M = 1.5
STEP_M, SEEN_M, ANNOTATED_M = 3.0, 12.0, 9.0
TARGETS = (Thing("backpack", 1.6, 9.4), Thing("laptop", 16.3, 8.8))
CLUTTER = (
    Thing("chair", 3.9, 7.2),
    Thing("suitcase", 2.5, 9.8),
    Thing("chair", 8.2, 9.6),
    Thing("plant", 10.9, 6.3),
    Thing("monitor", 15.1, 9.9),
    Thing("chair", 13.6, 7.0),
    Thing("plant", 0.6, 1.0),
    Thing("bin", 9.0, 0.6),
    Thing("plant", 17.2, 3.9),
)


def walls() -> np.ndarray:
    """(rows, columns) of walls: a corridor in the south, three rooms in the north, a door from each."""
    wall = np.zeros((round(DEPTH_M / CELL_M), round(WIDTH_M / CELL_M)), bool)
    wall[[0, -1], :] = wall[:, [0, -1]] = True
    middle = round(4.8 / CELL_M)
    wall[middle, :] = True
    for x in (6.0, 12.0):
        wall[middle:, round(x / CELL_M)] = True
    for x in (2.6, 8.6, 14.8):
        wall[middle, round(x / CELL_M) : round((x + 1.6) / CELL_M)] = False
    return wall


def build() -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The connectivity list and the objects file."""
    rng = np.random.default_rng(360)
    sight = _Sight(walls(), CELL_M, SEEN_M)
    x, y = np.meshgrid(np.arange(1.2, WIDTH_M - 0.6, 2.2), np.arange(1.2, DEPTH_M - 0.6, 2.2))
    xy = np.column_stack((x.ravel(), y.ravel())) + rng.uniform(-0.25, 0.25, (x.size, 2))
    # A viewpoint in each door, or nobody could leave a room.
    xy = np.concatenate([xy[np.abs(xy[:, 1] - 4.9) > 0.6], [[3.4, 4.9], [9.4, 4.9], [15.6, 4.9]]])
    ids = [rng.bytes(16).hex() for _ in xy]
    visible = np.stack([sight.clear(np.broadcast_to(here, xy.shape), xy) for here in xy])
    near = np.hypot(*(xy[None] - xy[:, None]).transpose(2, 0, 1)) <= STEP_M
    left_out = len(xy) // 2
    connectivity = [
        {
            "image_id": id_,
            "pose": [1, 0, 0, round(float(here[0]), 3), 0, 1, 0, round(float(here[1]), 3), 0, 0, 1, EYE_M, 0, 0, 0, 1],
            "included": i != left_out,
            "visible": [bool(v) and i != j for j, v in enumerate(visible[i])],
            "unobstructed": [
                bool(v and n) and i != j for j, (v, n) in enumerate(zip(visible[i], near[i], strict=True))
            ],
            "height": EYE_M,
        }
        for i, (id_, here) in enumerate(zip(ids, xy, strict=True))
    ]
    viewpoints = {
        id_: sightings(sight, here) for i, (id_, here) in enumerate(zip(ids, xy, strict=True)) if i != left_out
    }
    names = [target.name for target in TARGETS]
    return connectivity, {"format": "ghal360-objects", "version": 1, "targets": names, "viewpoints": viewpoints}


def sightings(sight: _Sight, here: np.ndarray) -> list[dict[str, Any]]:
    """What is annotated at a viewpoint: everything in line of sight within reach."""
    found = []
    for thing in (*TARGETS, *CLUTTER):
        there = np.array([thing.x, thing.y])
        distance = float(np.hypot(*(there - here)))
        if distance <= ANNOTATED_M and sight.clear(here[None], there[None])[0]:
            heading = math.degrees(math.atan2(there[0] - here[0], there[1] - here[1])) % 360
            elevation = math.degrees(math.atan2(0.4 - EYE_M, distance))
            found.append(
                {
                    "name": thing.name,
                    "heading_deg": round(heading, 1),
                    "elevation_deg": round(elevation, 1),
                    "width_deg": round(math.degrees(2 * math.atan2(0.2, distance)), 1),
                    "distance_m": round(math.hypot(distance, 0.4 - EYE_M), 2),
                }
            )
    return found


def main() -> None:
    connectivity, objects = build()
    DATA.mkdir(exist_ok=True)
    (DATA / f"{SCAN}_connectivity.json").write_text(one_line_each(connectivity))
    (DATA / f"{SCAN}_objects.json").write_text(json.dumps(objects, indent=1) + "\n")


def one_line_each(viewpoints: list[dict[str, Any]]) -> str:
    return "[\n" + ",\n".join(json.dumps(viewpoint) for viewpoint in viewpoints) + "\n]\n"


def grid() -> GridMap:
    """The same building as a grid, for comparison."""
    rows = tuple("".join("#" if cell else "." for cell in row) for row in walls()[::-1])
    return GridMap(SCAN, CELL_M, rows, TARGETS, CLUTTER, partial_steps=True)


if __name__ == "__main__":
    main()
