"""darknet: YOLOv3 and its relatives from a `.cfg` and a `.weights` file, as the paper's robot ran them, in torch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.perception.detectors.boxes import Boxes, suppress
from ghal360_robot.perception.detectors.coco import CLASSES
from ghal360_robot.perception.detectors.compute import Compute, Engine, rows_last
from ghal360_robot.perception.detectors.darknet_cfg import parse_cfg
from ghal360_robot.perception.detectors.darknet_module import DarknetModule, Head
from ghal360_robot.perception.detectors.errors import WeightsError
from ghal360_robot.perception.detectors.letterbox import Placing, letterbox
from ghal360_robot.perception.detectors.names_file import class_names
from ghal360_robot.perception.detectors.network import SquareNetwork

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.base import DetectorOptions
    from ghal360_robot.perception.detectors.network import Outputs
    from ghal360_robot.perception.detectors.store import Entry, Proposed

    Picture = NDArray[np.uint8]
    Floats = NDArray[np.float32]

LIMIT = 100
SAME = 0.45
"""Darknet's own suppression threshold."""
MAX_EXPONENT = 20.0
"""Without a bound, the boxes of broken weights are infinite."""
SMALL_LAYERS = 30
"""YOLOv3-tiny has 24 layers, YOLOv3 107."""


class Darknet(SquareNetwork):
    """The network of one pair of files."""

    background = 128

    def __init__(self, name: str, cfg: str, weights: bytes, classes: tuple[str, ...], compute: Compute) -> None:
        """Raises WeightsError where the two files do not belong together."""
        config = parse_cfg(cfg)
        module = DarknetModule(config, weights)
        for head in module.heads:
            if head.n_classes != len(classes):
                raise WeightsError(
                    f"The cfg of '{name}' tells {head.n_classes} classes apart, but there are {len(classes)} names: "
                    "add it again with the right list of names (--classes FILE)."
                )
        self.name, self.class_names, self.side = name, classes, config.side
        # Best F1 on COCO photographs (fact sheet on the detector, section 3); YOLOv3's is darknet's own default.
        self.default_score = 0.15 if len(config.layers) < SMALL_LAYERS else 0.25
        self._heads = module.heads
        self._engine = Engine(module, compute)

    def place(self, picture: Picture, square: Picture) -> Placing:
        return letterbox(picture, square)

    def run(self, batch: Picture) -> Iterator[Outputs]:
        for maps in self._engine(batch):
            yield from zip(*(rows_last(each) for each in maps), strict=True)

    def decode(self, outputs: Outputs, min_score: float) -> Boxes:
        parts = [decode(values, head, self.side, min_score) for values, head in zip(outputs, self._heads, strict=True)]
        together = Boxes(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
        return suppress(together, SAME, LIMIT)


def decode(values: Floats, head: Head, side: int, min_score: float) -> Boxes:
    """Boxes of one yolo layer (rows, columns, anchors x (5 + classes)) in pixels of the square."""
    rows, columns, _ = values.shape
    cells = values.reshape(rows, columns, len(head.anchors), 5 + head.n_classes)
    objectness = _sigmoid(cells[..., 4])
    y, x, anchor = np.nonzero(objectness > min_score)
    found = cells[y, x, anchor]
    score = objectness[y, x, anchor, None] * _sigmoid(found[:, 5:])
    which, kind = np.nonzero(score > min_score)
    found, x, y, anchor = found[which], x[which], y[which], anchor[which]
    cell = np.array((side / columns, side / rows), np.float32)
    centre = (_sigmoid(found[:, :2]) + np.stack((x, y), 1)) * cell
    half = np.exp(np.minimum(found[:, 2:4], MAX_EXPONENT)) * np.array(head.anchors, np.float32)[anchor] / 2
    return Boxes(np.hstack((centre - half, centre + half)).astype(np.float32), score[which, kind], kind)


def load(entry: Entry | Proposed, options: DetectorOptions) -> Darknet:
    """The network with the files that were added. Raises WeightsError."""
    classes = class_names(entry.read("names")) if entry.has("names") else CLASSES
    try:
        cfg = entry.read("cfg").decode()
    except UnicodeDecodeError as error:
        raise WeightsError("The cfg is no text: is it the weights file?") from error
    return Darknet(entry.name, cfg, entry.read("weights"), classes, Compute.of(options))


def _sigmoid(values: Floats) -> Floats:
    chances: Floats = np.reciprocal(1 + np.exp(-np.clip(values, -60, 60)), dtype=np.float32)
    return chances
