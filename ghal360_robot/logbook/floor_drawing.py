"""The floor as far as the robot has seen it, drawn into the world: a map that grows while it drives. For the eye."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.floor_map import RESOLUTION_M, UNKNOWN_GREY, FloorMap
from ghal360_robot.frames import place_of
from ghal360_robot.logbook import entities, rows
from ghal360_robot.messages import Pose2
from ghal360_robot.trail import Trail

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ghal360_robot.logbook.table import Row
    from ghal360_robot.messages import Inputs

SCAN_NS = 200_000_000
"""A map needs no more than five scans a second."""

DRAW_NS = 2_000_000_000
"""A metre at the highest speed; a drawing of the floor of an office takes some kilobytes of the file."""


class FloorDrawing:
    """`rows` is called for every tick; used by the writer's thread alone."""

    def __init__(self) -> None:
        self._floor = FloorMap()
        self._trail = Trail()
        self._added_ns = 0
        self._drawn_ns = 0

    def rows(self, inputs: Inputs) -> Iterator[Row]:
        self._trail = self._trail.extended(inputs.base)
        around = inputs.surroundings
        if around is None or not self._trail.stamps or around.stamp_ns - self._added_ns < SCAN_NS:
            return
        self._added_ns = around.stamp_ns
        base = self._trail.at(around.stamp_ns)
        lidar = (*place_of(base, around.origin), base.yaw)
        self._floor.add(lidar, around.bearings, np.nan_to_num(around.raw.astype(np.float64)))
        if inputs.stamp_ns - self._drawn_ns >= DRAW_NS:
            self._drawn_ns = inputs.stamp_ns
            yield from self._drawing(inputs.stamp_ns)

    def _drawing(self, stamp_ns: int) -> Iterator[Row]:
        """What is known of it, without the rest."""
        cells = self._floor.cells()
        known = cells != UNKNOWN_GREY
        lines, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        if not len(lines):
            return
        x, y = self._floor.corner
        corner = Pose2(x + columns[0] * RESOLUTION_M, y + (len(cells) - 1 - lines[-1]) * RESOLUTION_M)
        seen = np.ascontiguousarray(cells[lines[0] : lines[-1] + 1, columns[0] : columns[-1] + 1])
        yield from rows.grid_map(entities.WORLD_MAP, stamp_ns, seen, RESOLUTION_M, corner)
