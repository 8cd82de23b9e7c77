"""An office floor: open-plan desks, meeting room, corridor, lounge, manager's office, kitchenette."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ghal360_robot.simulation.furniture import Furnished, chair_at, workplace
from ghal360_robot.simulation.objects import CATALOGUE, WorldObject, thing
from ghal360_robot.simulation.rooms import Door, FloorPlan, Opening, Wall, room_from_centre_lines

if TYPE_CHECKING:
    from numpy.random import Generator

PLAN = FloorPlan(
    width=14.0,
    depth=10.0,
    rooms=(
        room_from_centre_lines("open plan", 0.0, 3.9, 7.6, 10.0),
        room_from_centre_lines("meeting room", 7.6, 5.7, 14.0, 10.0),
        room_from_centre_lines("corridor", 7.6, 3.9, 14.0, 5.7),
        room_from_centre_lines("lounge", 0.0, 0.0, 4.6, 3.9),
        room_from_centre_lines("manager's office", 4.6, 0.0, 9.2, 3.9),
        room_from_centre_lines("kitchenette", 9.2, 0.0, 14.0, 3.9),
    ),
    walls=(
        Wall(0.0, 0.0, 14.0, 0.0),
        Wall(0.0, 10.0, 14.0, 10.0),
        Wall(0.0, 0.0, 0.0, 10.0),
        Wall(14.0, 0.0, 14.0, 10.0),
        Wall(0.0, 3.9, 14.0, 3.9),
        Wall(7.6, 5.7, 14.0, 5.7),
        Wall(7.6, 3.9, 7.6, 10.0),
        Wall(4.6, 0.0, 4.6, 3.9),
        Wall(9.2, 0.0, 9.2, 3.9),
    ),
    doors=(
        Door(7.6, 4.8, 1.4, along_x=False, framed=False),
        Door(9.0, 5.7, 1.2, along_x=True),
        Door(11.4, 3.9, 1.2, along_x=True),
        Door(6.4, 3.9, 1.2, along_x=True),
        Door(2.6, 3.9, 1.2, along_x=True),
    ),
    openings=(
        Opening("window", "open plan", "n", 1.5, 2.0),
        Opening("window", "open plan", "n", 4.2, 2.0),
        Opening("window", "open plan", "n", 6.5, 1.4),
        Opening("window", "open plan", "w", 7.0, 2.2),
        Opening("window", "meeting room", "n", 9.6, 2.2),
        Opening("window", "meeting room", "n", 12.2, 2.2),
        Opening("closed door", "corridor", "e", 4.8, 1.0),
        Opening("closed door", "corridor", "s", 9.6, 0.9),
        Opening("closed door", "corridor", "n", 12.6, 0.9),
        Opening("window", "lounge", "s", 2.3, 2.2),
        Opening("window", "manager's office", "s", 6.9, 2.4),
        Opening("window", "kitchenette", "e", 2.2, 1.4),
    ),
)


def furnish(rng: Generator) -> Furnished:
    """Furniture of the office, places for a television (on stands and walls), and decoration."""
    items: list[WorldObject] = []
    _open_plan(items, rng)
    _meeting_room(items, rng)
    _lounge(items)
    _managers_office(items, rng)
    _kitchenette(items, rng)
    _corridor(items)
    meeting, lounge = PLAN.room("meeting room"), PLAN.room("lounge")
    open_plan = PLAN.room("open plan")
    places = (
        thing("television", *meeting.against("e", 7.85, 0.09, 0.03), z=1.02),
        thing("television", *lounge.against("e", 1.75, 0.09, 0.18), z=CATALOGUE["tv stand"].size[2]),
        thing("television", *open_plan.against("e", 6.35, 0.09, 0.03), z=1.05),
    )
    return Furnished(tuple(items), places)


def _open_plan(items: list[WorldObject], rng: Generator) -> None:
    room = PLAN.room("open plan")
    desk_w, desk_d, desk_h = CATALOGUE["desk"].size
    columns = int(rng.integers(2, 4))
    middle_x, middle_y = 3.3, 6.35
    for column in range(columns):
        x = middle_x + (column - (columns - 1) / 2) * desk_w
        items += workplace("desk", x, middle_y + desk_d / 2, math.pi, rng)
        items += workplace("desk", x, middle_y - desk_d / 2, 0.0, rng)
        items.append(thing("desk divider", x, middle_y, z=desk_h))
    first = float(rng.uniform(0.85, 1.3))
    for index in range(int(rng.integers(2, 4))):
        x, y, _ = room.against("n", first + index * (desk_w + 0.06), desk_d)
        items += workplace("desk", x, y, 0.0, rng, screen_first=True)
    items += [
        thing("filing cabinet", *room.against("e", 8.9, 0.42)),
        thing("filing cabinet", *room.against("e", 8.08, 0.42)),
        thing("bookshelf", *room.against("s", 4.9, 0.34)),
        thing("wall clock", *room.against("s", 4.2, 0.05, 0.0), z=1.9),
        thing("whiteboard", *room.against("e", 8.5, 0.04, 0.0), z=1.0),
        thing("picture", *room.against("s", 1.1, 0.04, 0.0), z=1.3),
    ]


def _meeting_room(items: list[WorldObject], rng: Generator) -> None:
    room = PLAN.room("meeting room")
    x, y = 10.95, room.centre[1]
    depth = CATALOGUE["meeting table"].size[1]
    items.append(thing("meeting table", x, y))
    for offset in (-0.8, 0.0, 0.8):
        items.append(chair_at("office chair", x + offset, y + depth / 2, math.pi, rng))
        items.append(chair_at("office chair", x + offset, y - depth / 2, 0.0, rng))
    items += [
        thing("sideboard", *room.against("e", 7.85, 0.42)),
        thing("whiteboard", *room.against("w", 8.3, 0.04, 0.0), z=0.95),
        thing("picture", *room.against("s", 11.4, 0.04, 0.0), z=1.3),
    ]


def _lounge(items: list[WorldObject]) -> None:
    room = PLAN.room("lounge")
    items += [
        thing("sofa", *room.against("w", 1.75, 0.9)),
        thing("coffee table", room.x0 + 1.55, 1.75, math.pi / 2),
        thing("tv stand", *room.against("e", 1.75, 0.42)),
        thing("rug", room.x0 + 1.7, 1.75, math.pi / 2),
        thing("picture", *room.against("w", 1.75, 0.04, 0.0), z=1.35),
        thing("copier", *room.against("n", 4.05, 0.58)),
    ]


def _managers_office(items: list[WorldObject], rng: Generator) -> None:
    room = PLAN.room("manager's office")
    items += workplace("executive desk", 7.35, 1.75, math.pi / 2, rng)
    items += [
        chair_at("chair", 7.35 - 0.4, 1.35, -math.pi / 2, rng, tucked=-0.1),
        chair_at("chair", 7.35 - 0.4, 2.15, -math.pi / 2, rng, tucked=-0.1),
        thing("bookshelf", *room.against("e", 0.62, 0.34)),
        thing("bookshelf", *room.against("e", 3.2, 0.34)),
        thing("sideboard", *room.against("w", 1.6, 0.42)),
        thing("picture", *room.against("w", 1.6, 0.04, 0.0), z=1.35),
        thing("picture", *room.against("e", 1.9, 0.04, 0.0), z=1.35),
    ]


def _kitchenette(items: list[WorldObject], rng: Generator) -> None:
    room = PLAN.room("kitchenette")
    table = (13.2, 2.8)
    cabinets = (10.24, 10.84, 11.44, 12.04, 12.64, 13.24)
    items += [
        thing("fridge", *room.against("s", 9.62, 0.64)),
        thing("kitchen unit", *room.against("s", 10.24, 0.60)),
        thing("sink unit", *room.against("s", 10.99, 0.60)),
        *(thing("kitchen unit", *room.against("s", x, 0.60)) for x in (11.74, 12.34, 12.94, 13.54)),
        *(thing("wall cabinet", *room.against("s", x, 0.35, 0.0), z=1.42) for x in cabinets),
        thing("round table", *table),
        thing("wall clock", *room.against("w", 2.0, 0.05, 0.0), z=1.8),
        thing("picture", *room.against("n", 13.1, 0.04, 0.0), z=1.3),
    ]
    for bearing in (math.radians(185), math.radians(262)):
        x, y = table[0] + 0.42 * math.cos(bearing), table[1] + 0.42 * math.sin(bearing)
        items.append(chair_at("chair", x, y, bearing + math.pi / 2, rng))


def _corridor(items: list[WorldObject]) -> None:
    room = PLAN.room("corridor")
    items += [
        thing("picture", *room.against("n", 10.9, 0.04, 0.0), z=1.3),
        thing("picture", *room.against("s", 13.0, 0.04, 0.0), z=1.3),
    ]
