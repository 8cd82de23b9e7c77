"""centernet: the MobileNetV3 CenterNet of the npm package @vladmandic/human, the detector that is always at hand.

Fact sheet on the detector, section 1: input is RGB 0..255 without normalisation, letterboxed on black; boxes are
reaches to the left, top, right and bottom of a cell's corner; scores run low.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.perception.detectors.boxes import Boxes, suppress
from ghal360_robot.perception.detectors.centernet_module import CELL_PX, CenterNetModule
from ghal360_robot.perception.detectors.coco import CLASSES
from ghal360_robot.perception.detectors.compute import Compute, Engine, rows_last
from ghal360_robot.perception.detectors.letterbox import Placing, letterbox
from ghal360_robot.perception.detectors.network import SquareNetwork
from ghal360_robot.perception.detectors.tfjs import read_weights

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.base import DetectorOptions
    from ghal360_robot.perception.detectors.network import Outputs
    from ghal360_robot.perception.detectors.store import Entry, Proposed

    Picture = NDArray[np.uint8]
    Floats = NDArray[np.float32]

SIDE = 512
"""The size it was trained at; any multiple of 32 runs (AP 0.256 at 384, 0.297 at 512, 0.307 at 640)."""
LIMIT = 100
"""Boxes per picture, as in the original's own decoding."""
SAME = 0.6
"""Overlap above which two boxes of one class are one object."""


class CenterNet(SquareNetwork):
    """The network; `detect` takes pictures of any size."""

    name = "centernet"
    class_names = CLASSES
    default_score = 0.30

    def __init__(self, model_json: bytes, weights_bin: bytes, compute: Compute, side: int = SIDE) -> None:
        """Raises WeightsError where the files are not CenterNet's."""
        self.side = side
        self._engine = Engine(CenterNetModule(read_weights(model_json, weights_bin)), compute)

    def place(self, picture: Picture, square: Picture) -> Placing:
        return letterbox(picture, square)

    def run(self, batch: Picture) -> Iterator[Outputs]:
        for logits, reaches in self._engine(batch):
            yield from zip(rows_last(logits), rows_last(reaches), strict=True)

    def decode(self, outputs: Outputs, min_score: float) -> Boxes:
        return decode(outputs[0], outputs[1], min_score)


def decode(logits: Floats, reaches: Floats, min_score: float) -> Boxes:
    """Boxes in pixels of the square from class logits (h, w, classes) and reaches (h, w, 4).

    A box is a cell whose score no neighbour of its class exceeds. Looking only at the cells above `min_score` gives
    what a maximum filter over all of them would, in a tenth of the time.
    """
    height, width, n_classes = logits.shape
    score = min(max(min_score, 1e-4), 1 - 1e-4)
    flat = np.flatnonzero(logits.reshape(-1) > np.log(score / (1 - score)))
    y, x, kind = (flat // n_classes) // width, (flat // n_classes) % width, flat % n_classes
    value = logits[y, x, kind]
    for dy, dx in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        beside_y = np.minimum(np.maximum(y + dy, 0), height - 1)
        beside_x = np.minimum(np.maximum(x + dx, 0), width - 1)
        peak = value >= logits[beside_y, beside_x, kind]
        x, y, kind, value = x[peak], y[peak], kind[peak], value[peak]
    best = np.argsort(-value, kind="stable")[:LIMIT]
    x, y, kind, value = x[best], y[best], kind[best], value[best]
    corner = np.stack((x, y, x, y), 1).astype(np.float32) * CELL_PX
    box = corner + reaches[y, x] * np.array((-1, -1, 1, 1), np.float32)
    return suppress(Boxes(box, 1 / (1 + np.exp(-value)), kind), SAME, LIMIT)


def load(entry: Entry | Proposed, options: DetectorOptions) -> CenterNet:
    """The network with the weights that were added. Raises WeightsError."""
    return CenterNet(entry.read("json"), entry.read("bin"), Compute.of(options))
