"""painted: finds the objects of the simulated world by the hue they are painted with.

It works on simulated pictures only and knows nothing of real ones. The hues are the contract of
`ghal360_robot.simulation.paint`; a class is a hue band at high saturation, an object is a connected patch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.perception.detectors.base import PixelDetection
from ghal360_robot.perception.sphere import PixelBox
from ghal360_robot.simulation.paint import BAND_DEG, MAX_OTHER_SATURATION, MIN_PAINT_SATURATION, PAINT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Mask = NDArray[np.uint8]

WORKING_WIDTH = 960
"""H.264 4:2:0 keeps half the colour resolution, so a 1920 picture has no more colour than this."""
MIN_SATURATION = round(255 * (MIN_PAINT_SATURATION + MAX_OTHER_SATURATION) / 2)
"""Half way between paint and the rest: edges of patches mix with what is behind them."""
MIN_VALUE = 40
"""Of 255. Below, the hue of an 8-bit picture after compression is noise."""
MIN_AREA_PX = 10
"""At the working width; a bottle at 6 m covers about 15."""
HALF_SCORE_AREA_PX = 8
"""A patch of this area keeps half of the score that its purity earns."""
FULL_PURITY = 0.5
"""A patch that fills half of its box is as good as it gets: plants and backpacks are no rectangles."""
MAX_ASPECT = 8.0
"""Longer or thinner than this is a reflection or an edge, not an object; also the other way round."""
CLOSING_PX = 3
"""Straps, screen borders and compression cut patches by a pixel or two; this closes them."""


class PaintedDetector:
    """The colour detector of the simulated world."""

    name = "painted"
    class_names = tuple(PAINT)

    def __init__(self) -> None:
        self._class_of_hue = _class_of_hue()
        self._closing = np.ones((CLOSING_PX, CLOSING_PX), np.uint8)

    def warm_up(self) -> None:
        """Nothing to prepare."""

    def detect(self, rgb: NDArray[np.uint8]) -> list[PixelDetection]:
        """Painted objects, best score first. Raises ValueError unless `rgb` is (height, width, 3) uint8."""
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8 or not rgb.size:
            raise ValueError(f"A picture is (height, width, 3) uint8, not {rgb.shape} {rgb.dtype}.")
        scale = max(1.0, rgb.shape[1] / WORKING_WIDTH)
        classes = self._classes(rgb, scale)
        present = np.flatnonzero(np.bincount(classes.ravel(), minlength=len(PAINT) + 1)[1:] >= MIN_AREA_PX)
        found = [
            PixelDetection(self.class_names[index], score, _scaled(box, scale))
            for index in present.tolist()
            for score, box in self._patches(np.equal(classes, index + 1).astype(np.uint8))
        ]
        return sorted(found, key=lambda detection: -detection.score)

    def _classes(self, rgb: NDArray[np.uint8], scale: float) -> Mask:
        """The class of each pixel at the working width, counted from 1; 0 where there is no paint."""
        if scale > 1:
            size = (round(rgb.shape[1] / scale), max(1, round(rgb.shape[0] / scale)))
            rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        hsv = cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV_FULL)
        painted = cv2.inRange(hsv, (0, MIN_SATURATION, MIN_VALUE), (255, 255, 255))
        classes = cv2.bitwise_and(cv2.LUT(hsv[:, :, 0], self._class_of_hue), painted)
        return classes.astype(np.uint8, copy=False)

    def _patches(self, mask: Mask) -> Iterator[tuple[float, PixelBox]]:
        """Score and box of every plausible connected patch of one class; patches are whole across the seam."""
        width = mask.shape[1]
        start = _empty_column(mask)
        rows = np.flatnonzero(np.any(mask, axis=1))
        top = max(0, int(rows[0]) - CLOSING_PX)
        turned = np.roll(mask[top : int(rows[-1]) + CLOSING_PX + 1], -start, axis=1)
        closed = cv2.morphologyEx(turned, cv2.MORPH_CLOSE, self._closing)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
        areas = np.bincount(labels[turned.astype(bool)], minlength=count)
        for label in range(1, count):
            left, first_row, box_width, box_height = map(int, stats[label, :4])
            area = int(areas[label])
            if area < MIN_AREA_PX or not 1 / MAX_ASPECT <= box_width / box_height <= MAX_ASPECT:
                continue
            purity = area / (box_width * box_height)
            score = min(1.0, purity / FULL_PURITY) * area / (area + HALF_SCORE_AREA_PX)
            yield score, PixelBox((left + start) % width, top + first_row, box_width, box_height)


def _class_of_hue() -> Mask:
    """(256,) class of each 8-bit hue, counted from 1; 0 between the bands."""
    table = np.zeros(256, np.uint8)
    hues_deg = np.arange(256) * 360 / 256
    for index, centre_deg in enumerate(PAINT.values(), start=1):
        table[np.abs((hues_deg - centre_deg + 180) % 360 - 180) <= BAND_DEG] = index
    return table


def _empty_column(mask: Mask) -> int:
    """A column without paint where the picture can be cut open; 0 if there is none."""
    painted = cv2.reduce(mask, 0, cv2.REDUCE_MAX)[0] > 0
    if not (painted[0] and painted[-1]):
        return 0
    empty = np.flatnonzero(~painted)
    return int(empty[0]) if empty.size else 0


def _scaled(box: PixelBox, scale: float) -> PixelBox:
    return PixelBox(box.left * scale, box.top * scale, box.width * scale, box.height * scale)
