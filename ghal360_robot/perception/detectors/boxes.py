"""Boxes in one ordinary picture, as networks give them, and suppression of the weaker of two that overlap."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Picture = NDArray[np.uint8]
    Floats = NDArray[np.float32]


class Boxes(NamedTuple):
    """Objects in one picture, best score first."""

    xyxy: Floats
    """(n, 4) left, top, right, bottom in pixels of that picture; 0, 0 is the outer corner of its first pixel."""
    score: Floats
    """(n,) 0..1."""
    kind: NDArray[np.intp]
    """(n,) index into the network's `class_names`."""


class Network(Protocol):
    """A detector for ordinary pictures; used by one thread at a time."""

    @property
    def name(self) -> str: ...

    @property
    def class_names(self) -> tuple[str, ...]: ...

    @property
    def side(self) -> int:
        """Pixels of its square input: tiles larger than this are scaled down."""
        ...

    @property
    def default_score(self) -> float:
        """The score at which it was found to do best (F1 on COCO photographs)."""
        ...

    def detect(self, pictures: Sequence[Picture], min_score: float) -> list[Boxes]:
        """Objects in each RGB picture (height, width, 3) uint8, all pictures in one batch."""
        ...


NOTHING = Boxes(np.zeros((0, 4), np.float32), np.zeros(0, np.float32), np.zeros(0, np.intp))


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
