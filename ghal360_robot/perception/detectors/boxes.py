"""Boxes in one ordinary picture, as networks give them, and suppression of the weaker of two that overlap."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float32]


class Boxes(NamedTuple):
    """Objects in one picture, best score first."""

    xyxy: Floats
    """(n, 4) left, top, right, bottom in pixels of that picture; 0, 0 is the outer corner of its first pixel."""
    score: Floats
    """(n,) 0..1."""
    kind: NDArray[np.intp]
    """(n,) index into the network's `class_names`."""


def suppress(boxes: Boxes, threshold: float, limit: int) -> Boxes:
    """The best `limit` boxes, without those that overlap a better one of their class by more than `threshold`."""
    order = np.argsort(-boxes.score, kind="stable")
    xyxy, score, kind = boxes.xyxy[order], boxes.score[order], boxes.kind[order]
    left, top, right, bottom = xyxy.T
    area = np.maximum(right - left, 0) * np.maximum(bottom - top, 0)
    kept: list[int] = []
    alive = np.ones(len(score), bool)
    for index in range(len(score)):
        if not alive[index]:
            continue
        kept.append(index)
        if len(kept) == limit:
            break
        rest = slice(index + 1, None)
        width = np.minimum(right[index], right[rest]) - np.maximum(left[index], left[rest])
        height = np.minimum(bottom[index], bottom[rest]) - np.maximum(top[index], top[rest])
        common = np.maximum(width, 0) * np.maximum(height, 0)
        much = common > threshold * (area[index] + area[rest] - common)
        alive[rest] &= ~(much & (kind[rest] == kind[index]))
    return Boxes(xyxy[kept], score[kept], kind[kept])
