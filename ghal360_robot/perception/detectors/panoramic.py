"""Any network as a detector of the whole panorama: cut into tiles, searched in one batch, merged on the sphere."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from math import tau
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.angles import wrap
from ghal360_robot.perception.detectors.base import PixelDetection
from ghal360_robot.perception.detectors.letterbox import checked
from ghal360_robot.perception.merge import KEEP_SHARE, TileBox, continued, merged
from ghal360_robot.perception.names import canonical
from ghal360_robot.perception.sphere import PictureSize, pixel_box
from ghal360_robot.perception.tiles import EDGE, PLANS, PerspectiveTile, Tile, TilePlan, settled_yaw

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.boxes import Boxes
    from ghal360_robot.perception.detectors.network import Network

    Picture = NDArray[np.uint8]


class PanoramaDetector:
    """A network and a plan; `thresholds` are scores by class name, every other class has `min_score`.

    It remembers what the picture before showed: an object once found may go on with a weaker score.
    """

    def __init__(
        self,
        network: Network,
        plan: TilePlan = PLANS["default"],
        *,
        min_score: float | None = None,
        thresholds: Mapping[str, float] | None = None,
    ) -> None:
        self.network = network
        tiles = (replace(tile, side=network.side) if isinstance(tile, PerspectiveTile) else tile for tile in plan.tiles)
        self.plan = replace(plan, tiles=tuple(tiles))
        self.name = network.name
        self._names = tuple(canonical(name) for name in network.class_names)
        self.class_names = tuple(dict.fromkeys(self._names))
        everywhere = network.default_score if min_score is None else min_score
        asked = {canonical(name): score for name, score in (thresholds or {}).items()}
        self._start = {name: asked.get(name, everywhere) for name in self.class_names}
        self._least = np.array([KEEP_SHARE * self._start[name] for name in self._names], np.float32)
        self._turn = 0
        self._settled = 0.0
        self._before: deque[list[TileBox]] = deque(maxlen=len(plan.tiles) if plan.one_a_turn else 1)

    def warm_up(self) -> None:
        """Search one grey panorama: a first run allocates memory and chooses kernels, which takes long."""
        self.detect(np.full((960, 1920, 3), 127, np.uint8))
        self._before.clear()
        self._turn = 0
        self._settled = 0.0

    def detect(self, rgb: Picture) -> list[PixelDetection]:
        """Objects all around, best first. Raises PictureError unless `rgb` is (height, width, 3) uint8."""
        checked(rgb)
        size = PictureSize(rgb.shape[1], rgb.shape[0])
        tiles, shift = self._tiles(), self._shift(rgb)
        turned = np.roll(rgb, shift, axis=1) if shift else rgb
        cuts = [tile.cut(turned) for tile in tiles]
        found = self.network.detect(cuts, float(self._least.min()))
        boxes = [
            box
            for tile, cut, seen in zip(tiles, cuts, found, strict=True)
            for box in self._on_sphere(tile, cut, seen, size, shift * tau / size.width)
        ]
        before = [item for picture in self._before for item in picture]
        objects = continued(merged(boxes, self.plan.overlap), before, self._start)
        self._before.append(objects)
        return [PixelDetection(item.name, item.score, pixel_box(item.box, size)) for item in objects]

    def _tiles(self) -> tuple[Tile, ...]:
        if not self.plan.one_a_turn:
            return self.plan.tiles
        self._turn = (self._turn + 1) % len(self.plan.tiles)
        return (self.plan.tiles[self._turn],)

    def _shift(self, rgb: Picture) -> int:
        """Columns to move the picture by, so that the tiles stand still in the world."""
        settled, width = settled_yaw(rgb, self.plan.period), int(rgb.shape[1])
        if self.plan.one_a_turn:
            # Of the ring's equivalent places the nearest to the last one, or a tile would come twice or not at all.
            settled = self._settled + math.remainder(settled - self._settled, self.plan.period)
        self._settled = settled
        return round(settled / tau * width) % width

    def _on_sphere(self, tile: Tile, cut: Picture, seen: Boxes, size: PictureSize, turn: float) -> list[TileBox]:
        """Boxes of the picture that was moved, turned back by `turn`."""
        good = seen.score >= self._least[seen.kind]
        xyxy, score, kind = seen.xyxy[good], seen.score[good], seen.kind[good]
        # Nothing shows what lies beyond the upper and lower edges: what is cut there is as whole as it gets.
        near = np.minimum(xyxy[:, 0], cut.shape[1] - xyxy[:, 2]) < cut.shape[1] * EDGE
        is_cut = near & tile.cuts()
        return [
            TileBox(self._names[k], float(s), replace(box, yaw=wrap(box.yaw + turn)), bool(c))
            for box, s, k, c in zip(tile.boxes(xyxy, size), score, kind, is_cut, strict=True)
        ]
