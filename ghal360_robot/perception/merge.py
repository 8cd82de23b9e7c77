"""From what each tile shows to what is there: one box for an object, however many tiles saw it. Pure.

Fact sheet on the detector, section 4.4: suppression by class on the sphere, in which a box that its tile cuts off
gives way to a whole one, and goes where most of it lies inside one that is kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import radians, tau
from typing import TYPE_CHECKING

from ghal360_robot.angles import wrap

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from ghal360_robot.perception.sphere import SphereBox

SAME = 0.5
"""Overlap (intersection over union) above which two boxes of one class are one object."""
INSIDE = 0.8
"""A cut box of which this share lies in a kept one is a part of it."""

CUT_WORTH = 0.5
"""A cut box gives way to a whole one of half its score."""
KEEP_SHARE = 0.6
"""Of the score that begins an object, what is enough to go on seeing it in the next picture."""
CONTINUES_YAW = radians(25)
"""The robot turns by so much between two pictures at 0.8 rad/s and 2 pictures a second."""
CONTINUES_PITCH = radians(15)
"""Driving towards a thing on the floor lowers it by this much at most."""


@dataclass(frozen=True, slots=True)
class TileBox:
    """One box as one tile saw it."""

    name: str
    score: float
    box: SphereBox
    cut: bool
    """Its tile's edge may have cut some of the object off."""


def intersection(a: SphereBox, b: SphereBox) -> float:
    """Common area of two boxes in yaw and pitch, rad^2; boxes may lie across the seam and be up to a circle wide."""
    apart = abs(wrap(a.yaw - b.yaw))
    half = (a.width + b.width) / 2
    near = min(a.width, b.width, max(0.0, half - apart))
    far = max(0.0, half - (tau - apart))  # two wide boxes meet on the far side as well
    width = min(a.width, b.width, near + far)
    height = min(a.pitch + a.height / 2, b.pitch + b.height / 2) - max(a.pitch - a.height / 2, b.pitch - b.height / 2)
    return width * max(0.0, height)


def area(box: SphereBox) -> float:
    return box.width * box.height


def overlap(a: SphereBox, b: SphereBox) -> float:
    """Intersection over union in yaw and pitch."""
    common = intersection(a, b)
    union = area(a) + area(b) - common
    return common / union if union > 0 else 0.0


def merged(found: Iterable[TileBox], shared: float) -> list[TileBox]:
    """One box for each object, best first; `shared` is the overlap of neighbouring tiles, radians.

    A cut box narrower than `shared` is dropped: its object lies whole in the neighbouring tile.
    """
    order = sorted(found, key=lambda item: -item.score * (CUT_WORTH if item.cut else 1.0))
    kept: list[TileBox] = []
    for item in order:
        if item.cut and item.box.width < shared:
            continue
        if not any(_same(item, other) for other in kept):
            kept.append(item)
    return sorted(kept, key=lambda item: -item.score)


def continued(found: Iterable[TileBox], before: Sequence[TileBox], start: Mapping[str, float]) -> list[TileBox]:
    """What is good enough to be new, and what is weaker but was there in the picture before.

    A network's score for one thing wanders by a third with the place of the tile's edges around it: with one threshold
    a sixth of the things found in a still panorama are lost when it turns, with this 3 %.
    """
    return [
        item for item in found if item.score >= start[item.name] or any(_continues(item, other) for other in before)
    ]


def _continues(item: TileBox, other: TileBox) -> bool:
    return (
        item.name == other.name
        and abs(wrap(item.box.yaw - other.box.yaw)) <= CONTINUES_YAW
        and abs(item.box.pitch - other.box.pitch) <= CONTINUES_PITCH
    )


def _same(item: TileBox, other: TileBox) -> bool:
    if item.name != other.name:
        return False
    common = intersection(item.box, other.box)
    if common <= 0:
        return False
    if common > SAME * (area(item.box) + area(other.box) - common):
        return True
    return item.cut and common >= INSIDE * area(item.box)
