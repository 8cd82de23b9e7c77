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


def overlap(a: Floats, b: Floats) -> Floats:
    """(n, m) intersection over union of boxes (n, 4) and (m, 4)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    common = np.prod(np.clip(high - low, 0, None), axis=2)
    area_a, area_b = (np.prod(np.clip(x[:, 2:] - x[:, :2], 0, None), axis=1) for x in (a, b))
    union = area_a[:, None] + area_b[None, :] - common
    shares: Floats = np.where(union > 0, common / np.maximum(union, 1e-9), 0).astype(np.float32)
    return shares


def suppress(boxes: Boxes, threshold: float, limit: int) -> Boxes:
    """The best `limit` boxes, without those that overlap a better one of their class by more than `threshold`."""
    order = np.argsort(-boxes.score, kind="stable")
    xyxy, score, kind = boxes.xyxy[order], boxes.score[order], boxes.kind[order]
    kept: list[int] = []
    alive = np.ones(len(score), bool)
    for index in range(len(score)):
        if not alive[index]:
            continue
        kept.append(index)
        if len(kept) == limit:
            break
        rest = np.flatnonzero(alive & (kind == kind[index]))
        rest = rest[rest > index]
        if rest.size:
            alive[rest[overlap(xyxy[index : index + 1], xyxy[rest])[0] > threshold]] = False
    return Boxes(xyxy[kept], score[kept], kind[kept])
