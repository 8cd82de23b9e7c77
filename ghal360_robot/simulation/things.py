"""How every kind of thing in the catalogue looks."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.simulation import (
    furniture_models,
    natural_clutter,
    natural_models,
    painted_models,
    small_models,
)
from ghal360_robot.simulation.meshes import Frame, Surface

if TYPE_CHECKING:
    from numpy.random import Generator

    from ghal360_robot.simulation.objects import WorldObject

Builder = Callable[[Frame, "WorldObject", "Generator"], None]

BUILDERS: dict[str, Builder] = {
    "backpack": painted_models.backpack,
    "laptop": painted_models.laptop,
    "bottle": painted_models.bottle,
    "television": painted_models.television,
    "potted plant": painted_models.potted_plant,
    "vase": painted_models.vase,
    "suitcase": painted_models.suitcase,
    "cushion": painted_models.cushion,
    "desk": furniture_models.desk,
    "executive desk": furniture_models.desk,
    "office chair": furniture_models.office_chair,
    "meeting table": furniture_models.table,
    "filing cabinet": furniture_models.cabinet,
    "copier": furniture_models.copier,
    "whiteboard": small_models.whiteboard,
    "monitor": small_models.monitor,
    "keyboard": small_models.keyboard,
    "paper tray": small_models.paper_tray,
    "desk divider": small_models.divider,
    "waste bin": small_models.waste_bin,
    "round table": furniture_models.round_table,
    "coat rack": small_models.coat_rack,
    "wall clock": small_models.wall_clock,
    "sofa": furniture_models.sofa,
    "armchair": furniture_models.sofa,
    "coffee table": furniture_models.table,
    "tv stand": furniture_models.cabinet,
    "sideboard": furniture_models.cabinet,
    "bookshelf": furniture_models.bookshelf,
    "dining table": furniture_models.table,
    "chair": furniture_models.chair,
    "kitchen unit": furniture_models.kitchen_unit,
    "stove": furniture_models.kitchen_unit,
    "sink unit": furniture_models.kitchen_unit,
    "wall cabinet": furniture_models.wall_cabinet,
    "fridge": furniture_models.fridge,
    "bed": furniture_models.bed,
    "nightstand": furniture_models.cabinet,
    "wardrobe": furniture_models.wardrobe,
    "shoe bench": furniture_models.cabinet,
    "floor lamp": small_models.floor_lamp,
    "table lamp": small_models.table_lamp,
    "book pile": small_models.book_pile,
    "fruit bowl": small_models.fruit_bowl,
    "mug": small_models.mug,
    "rug": small_models.flat_rug,
    "picture": small_models.panel_picture,
    "mirror": small_models.mirror,
}

NATURAL: dict[str, Builder] = {
    "backpack": natural_models.backpack,
    "laptop": natural_models.laptop,
    "bottle": natural_models.bottle,
    "television": natural_models.television,
    "potted plant": natural_clutter.potted_plant,
    "vase": natural_clutter.vase,
    "suitcase": natural_clutter.suitcase,
    "cushion": natural_clutter.cushion,
    "picture": natural_clutter.picture,
}
"""What looks like its kind in the field, for detectors that know real things, instead of wearing its class's paint."""

LOOKALIKES: dict[str, dict[str, Builder]] = {
    "television": {
        "monitor": natural_clutter.desk_lamp,
        "laptop": natural_clutter.shut_laptop,
        "whiteboard": natural_clutter.pinboard,
    },
}
"""What stands in a natural world for things that are the searched one to a detector: all screens are `tv` in COCO."""

ALIKE = frozenset({"chair", "office chair", "desk", "bookshelf", "filing cabinet"})
"""Kinds that are bought as a set: all of a room look the same."""


def add_thing(frame: Frame, item: WorldObject, seed: int, room: str, look: dict[str, Builder]) -> None:
    """The model of one thing, by `look`; other kinds than the `ALIKE` ones differ from place to place."""
    own = (*room.encode(), *item.name.encode()) if item.name in ALIKE else (round(item.x * 100), round(item.y * 100))
    rng = np.random.default_rng([seed, *own])
    look[item.name](frame, item, rng)


def look_of(target: str, *, painted: bool) -> dict[str, Builder]:
    """The models of a world in which `target` is searched for: natural ones, or painted ones."""
    return BUILDERS if painted else BUILDERS | NATURAL | LOOKALIKES.get(target, {})


def add_shadow(ground: Frame, item: WorldObject) -> None:
    """What a standing thing takes from the light of the floor or table under it."""
    spread = min(0.22, 0.05 + 0.25 * item.size[2], 0.6 * max(item.size[:2]))
    w, d = item.size[0] + 2 * spread, item.size[1] + 2 * spread
    surface = Surface("spot" if item.round else "shadow", (0.0, 0.0, 0.0), alpha=0.36, glows=True)
    ground.sheet((-w / 2, -d / 2, 0.006), (w, 0, 0), (0, d, 0), surface, whole=True)
