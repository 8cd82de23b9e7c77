"""A flat: living room, kitchen, hall, bedroom, study."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ghal360_robot.simulation.furniture import Furnished, chair_at, workplace
from ghal360_robot.simulation.objects import CATALOGUE, WorldObject, thing
from ghal360_robot.simulation.rooms import Door, FloorPlan, Opening, Wall, room_from_centre_lines

if TYPE_CHECKING:
    from numpy.random import Generator

PLAN = FloorPlan(
    width=12.0,
    depth=9.0,
    rooms=(
        room_from_centre_lines("living room", 0.0, 0.0, 7.2, 4.8),
        room_from_centre_lines("kitchen", 0.0, 4.8, 4.6, 9.0),
        room_from_centre_lines("hall", 4.6, 4.8, 7.8, 9.0),
        room_from_centre_lines("bedroom", 7.8, 4.8, 12.0, 9.0),
        room_from_centre_lines("study", 7.2, 0.0, 12.0, 4.8),
    ),
    walls=(
        Wall(0.0, 0.0, 12.0, 0.0),
        Wall(0.0, 9.0, 12.0, 9.0),
        Wall(0.0, 0.0, 0.0, 9.0),
        Wall(12.0, 0.0, 12.0, 9.0),
        Wall(0.0, 4.8, 12.0, 4.8),
        Wall(7.2, 0.0, 7.2, 4.8),
        Wall(4.6, 4.8, 4.6, 9.0),
        Wall(7.8, 4.8, 7.8, 9.0),
    ),
    doors=(
        Door(5.9, 4.8, 1.4, along_x=True, framed=False),
        Door(2.0, 4.8, 1.2, along_x=True),
        Door(4.6, 6.5, 1.2, along_x=False),
        Door(7.8, 6.2, 1.2, along_x=False),
        Door(7.2, 3.4, 1.2, along_x=False),
    ),
    openings=(
        Opening("window", "living room", "s", 2.6, 2.4),
        Opening("window", "living room", "s", 5.8, 1.5),
        Opening("window", "living room", "w", 2.2, 1.4),
        Opening("window", "kitchen", "w", 6.7, 1.3),
        Opening("window", "bedroom", "n", 9.0, 1.4),
        Opening("window", "bedroom", "e", 6.0, 1.4),
        Opening("window", "study", "s", 9.6, 2.2),
        Opening("closed door", "hall", "n", 6.2, 1.0),
    ),
)


def furnish(rng: Generator) -> Furnished:
    """Furniture of the flat, places for a television, and decoration."""
    items: list[WorldObject] = []
    _living_room(items, rng)
    _kitchen(items, rng)
    _hall(items)
    _bedroom(items)
    _study(items, rng)
    living, bedroom = PLAN.room("living room"), PLAN.room("bedroom")
    kitchen = PLAN.room("kitchen")
    places = (
        thing("television", *living.against("n", 3.85, 0.09, 0.18), z=CATALOGUE["tv stand"].size[2]),
        thing("television", *bedroom.against("w", 8.2, 0.09, 0.03), z=1.02),
        thing("television", *kitchen.against("e", 8.2, 0.09, 0.03), z=1.05),
    )
    return Furnished(tuple(items), places)


def _living_room(items: list[WorldObject], rng: Generator) -> None:
    room = PLAN.room("living room")
    x = 3.85 + float(rng.uniform(-0.15, 0.15))
    items += [
        thing("sofa", *room.against("s", x, 0.9, 0.06)),
        thing("coffee table", x, 1.65),
        thing("rug", x, 1.7),
        thing("tv stand", *room.against("n", 3.85, 0.42)),
        thing("armchair", 1.35, 1.75, math.pi / 2 + float(rng.uniform(-0.25, 0.25))),
        thing("floor lamp", 0.4, 0.4),
        thing("bookshelf", *room.against("w", 3.95, 0.34)),
        thing("sideboard", *room.against("e", 1.5, 0.42)),
        thing("picture", *room.against("e", 1.5, 0.04, 0.0), z=1.35),
        thing("picture", *room.against("s", 4.3, 0.04, 0.0), z=1.4, width=0.7),
        thing("picture", *room.against("n", 6.85, 0.04, 0.0), z=1.4, width=0.4),
        thing("table lamp", room.x1 - 0.25, 2.05, z=CATALOGUE["sideboard"].size[2]),
        thing("book pile", x + 0.2, 1.72, 0.4, z=CATALOGUE["coffee table"].size[2]),
    ]


def _kitchen(items: list[WorldObject], rng: Generator) -> None:
    room = PLAN.room("kitchen")
    items += [
        thing("fridge", *room.against("n", 0.42, 0.64)),
        thing("kitchen unit", *room.against("n", 1.04, 0.60)),
        thing("stove", *room.against("n", 1.64, 0.60)),
        thing("kitchen unit", *room.against("n", 2.24, 0.60)),
        thing("sink unit", *room.against("n", 2.99, 0.60)),
        *(thing("wall cabinet", *room.against("n", u, 0.35, 0.0), z=1.42) for u in (1.04, 1.64, 2.24, 2.84)),
        thing("wall clock", *room.against("e", 7.5, 0.05, 0.0), z=1.8),
        thing("picture", *room.against("s", 3.6, 0.04, 0.0), z=1.35),
    ]
    x, y = room.x0 + 0.45, 6.5
    items.append(thing("dining table", x, y, math.pi / 2))
    items.append(thing("fruit bowl", x, y + 0.1, z=CATALOGUE["dining table"].size[2]))
    for along in (-0.35, 0.35):
        items.append(chair_at("chair", x + 0.425, y + along, math.pi / 2, rng))
    items.append(chair_at("chair", x, y - 0.70, 0.0, rng))
    items.append(chair_at("chair", x, y + 0.70, math.pi, rng))


def _hall(items: list[WorldObject]) -> None:
    room = PLAN.room("hall")
    items += [
        thing("wardrobe", *room.against("w", 8.3, 0.58), width=1.2),
        thing("shoe bench", *room.against("e", 7.75, 0.36)),
        thing("mirror", *room.against("e", 7.75, 0.04, 0.0), z=0.7),
        thing("picture", *room.against("w", 5.4, 0.04, 0.0), z=1.35, width=0.5),
        thing("coat rack", room.x0 + 0.3, 7.45),
    ]


def _bedroom(items: list[WorldObject]) -> None:
    room = PLAN.room("bedroom")
    bed_width = CATALOGUE["bed"].size[0]
    x = room.x1 - 0.06 - bed_width / 2
    beside = x - bed_width / 2 - 0.26
    items += [
        thing("bed", *room.against("n", x, 2.05)),
        thing("nightstand", *room.against("n", beside, 0.40)),
        thing("table lamp", beside, room.y1 - 0.22, z=CATALOGUE["nightstand"].size[2], width=0.22),
        thing("wardrobe", *room.against("s", 10.6, 0.58)),
        thing("picture", *room.against("n", x, 0.04, 0.0), z=1.4),
        thing("rug", x - 1.3, 6.9, math.pi / 2, width=1.8),
    ]


def _study(items: list[WorldObject], rng: Generator) -> None:
    room = PLAN.room("study")
    x, y, yaw = room.against("e", 2.9, 0.70)
    items += workplace("desk", x, y, yaw, rng, screen_first=True)
    items += [
        thing("bookshelf", *room.against("n", 8.6, 0.34)),
        thing("bookshelf", *room.against("n", 9.57, 0.34)),
        thing("armchair", 8.0, 0.75, math.pi - math.radians(35) + float(rng.uniform(-0.2, 0.2))),
        thing("sideboard", *room.against("s", 9.8, 0.42)),
        thing("rug", 9.3, 2.4),
        thing("picture", *room.against("e", 2.9, 0.04, 0.0), z=1.4),
        thing("picture", *room.against("w", 1.6, 0.04, 0.0), z=1.4, width=0.6),
        thing("wall clock", *room.against("n", 10.9, 0.05, 0.0), z=1.8),
    ]
