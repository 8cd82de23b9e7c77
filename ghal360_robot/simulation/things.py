"""How every kind of thing looks: small models in the thing's own frame, front along -y, bottom at z = 0."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.simulation.meshes import Colour, Frame, Surface
from ghal360_robot.simulation.paint import PAINT
from ghal360_robot.simulation.textures import hsv

if TYPE_CHECKING:
    from numpy.random import Generator

    from ghal360_robot.simulation.objects import WorldObject

Builder = Callable[[Frame, "WorldObject", "Generator"], None]

OAK: Colour = (0.83, 0.722, 0.612)
WALNUT: Colour = (0.50, 0.426, 0.368)
ASH: Colour = (0.78, 0.73, 0.66)
LACQUER: Colour = (0.93, 0.93, 0.92)
CHARCOAL: Colour = (0.235, 0.24, 0.25)
BLACK: Colour = (0.10, 0.10, 0.105)
CHROME = Surface("steel", (0.74, 0.75, 0.76), 0.3)
DARK = Surface("plain", CHARCOAL)
INK = Surface("plain", BLACK)
FABRICS: tuple[Colour, ...] = ((0.50, 0.53, 0.57), (0.47, 0.54, 0.48), (0.66, 0.62, 0.56), (0.40, 0.41, 0.47))


def timber(colour: Colour, metres: float = 0.8) -> Surface:
    """Wood of a colour; lacquer hides its grain."""
    if colour == LACQUER:
        return Surface("plain", colour)
    return Surface("wood", colour, metres)


def pick(rng: Generator, choices: tuple[Colour, ...]) -> Colour:
    return choices[int(rng.integers(len(choices)))]


def shade(colour: Colour, factor: float) -> Colour:
    return colour[0] * factor, colour[1] * factor, colour[2] * factor


def paint(name: str, value: float, saturation: float = 0.92) -> Surface:
    """A detectable class's colour."""
    return Surface("canvas", hsv(PAINT[name], saturation, value), 0.4)


def _fronts(
    f: Frame, w: float, d: float, low: float, high: float, columns: int, rows: int, face: Surface, knob: bool = True
) -> None:
    """Doors or drawers in front of a cabinet, with gaps and handles."""
    wide, tall = w / columns, (high - low) / rows
    for column in range(columns):
        for row in range(rows):
            x, z = -w / 2 + (column + 0.5) * wide, low + row * tall
            f.box(x, -d / 2 - 0.008, z + 0.004, (wide - 0.008, 0.018, tall - 0.008), face, skip=("back",))
            if not knob:
                continue
            if tall < 0.32:
                f.box(x, -d / 2 - 0.026, z + tall * 0.72, (min(0.16, wide * 0.5), 0.018, 0.012), CHROME, skip=())
            else:
                inner = (1.0 if column % 2 == 0 else -1.0) * (wide / 2 - 0.05)
                f.box(x + inner, -d / 2 - 0.026, z + tall * 0.5, (0.012, 0.018, min(0.3, tall * 0.35)), CHROME, skip=())


def desk(f: Frame, o: WorldObject, rng: Generator) -> None:
    w, d, h = o.size
    top = timber(WALNUT if o.name == "executive desk" else pick(rng, (ASH, OAK, LACQUER)))
    panel = Surface("plain", (0.80, 0.80, 0.79)) if o.name == "desk" else timber(shade(WALNUT, 0.9))
    f.box(0, 0, h - 0.03, (w, d, 0.03), top, skip=())
    for side in (-1.0, 1.0):
        f.box(side * (w / 2 - 0.02), 0, 0, (0.03, d - 0.04, h - 0.03), panel)
    f.box(0, d / 2 - 0.06, 0.06, (w - 0.06, 0.02, h - 0.10), panel, skip=())
    drawers = f.at((w / 2 - 0.25) * (1 if rng.random() < 0.5 else -1), 0.06)
    drawers.box(0, 0, 0.03, (0.40, d - 0.22, h - 0.1), panel)
    _fronts(drawers, 0.40, d - 0.22, 0.05, h - 0.08, 1, 3, Surface("plain", (0.88, 0.88, 0.87)))


def office_chair(f: Frame, o: WorldObject, rng: Generator) -> None:
    cloth = Surface("fabric", pick(rng, (CHARCOAL, (0.30, 0.32, 0.37), (0.36, 0.37, 0.36))), 0.25)
    for leg in range(5):
        arm = f.at(yaw=leg * math.tau / 5 + 0.3)
        arm.box(0, -0.13, 0.05, (0.045, 0.24, 0.035), INK, skip=())
        arm.tube(0, -0.23, 0.0, [(0.0, 0.0), (0.028, 0.01), (0.028, 0.05), (0.0, 0.06)], INK, sides=6)
    f.tube(0, 0, 0.06, [(0.04, 0.0), (0.03, 0.1), (0.025, 0.38)], CHROME, sides=8)
    f.blob(0, -0.01, 0.42, (0.25, 0.24, 0.05), cloth, power=0.45)
    back = f.at(0, 0.21, 0.50, pitch=0.14)
    back.blob(0, 0, 0.02, (0.215, 0.035, 0.235), cloth, power=0.45)
    back.box(0, 0.04, -0.06, (0.06, 0.03, 0.3), INK, skip=())
    for side in (-1.0, 1.0):
        f.box(side * 0.26, 0.02, 0.62, (0.05, 0.24, 0.03), INK, skip=())
        f.box(side * 0.26, 0.06, 0.45, (0.03, 0.04, 0.18), INK)
    del o


def chair(f: Frame, o: WorldObject, rng: Generator) -> None:
    w, d, h = o.size
    frame = timber(pick(rng, (OAK, ASH, WALNUT)), 0.4)
    for x in (-1.0, 1.0):
        f.box(x * (w / 2 - 0.03), -d / 2 + 0.03, 0, (0.04, 0.04, 0.44), frame)
        f.at(x * (w / 2 - 0.03), d / 2 - 0.04, pitch=0.05).box(0, 0, 0, (0.04, 0.04, h), frame)
    f.box(0, 0, 0.42, (w - 0.01, d - 0.02, 0.03), frame, skip=())
    f.blob(0, -0.01, 0.445, (w / 2 - 0.03, d / 2 - 0.04, 0.022), Surface("fabric", pick(rng, FABRICS), 0.2), power=0.4)
    for z in (0.56, 0.68, 0.80):
        f.at(0, d / 2 - 0.01, z).box(0, 0, 0, (w - 0.08, 0.02, 0.07), frame, skip=())
    f.box(0, 0, 0.14, (w - 0.08, 0.02, 0.03), frame, skip=())


def table(f: Frame, o: WorldObject, rng: Generator) -> None:
    """A table on two wide panels: meeting, dining and coffee tables."""
    w, d, h = o.size
    colour = pick(rng, (OAK, ASH, WALNUT))
    top, leg = timber(colour), timber(shade(colour, 0.85))
    f.box(0, 0, h - 0.04, (w, d, 0.04), top, skip=())
    for side in (-1.0, 1.0):
        f.box(side * (w / 2 - 0.14), 0, 0, (0.06, d - 0.12, h - 0.04), leg)
    f.box(0, 0, 0.10 if h > 0.6 else 0.06, (w - 0.3, 0.05, h - 0.2), leg, skip=())
    if o.name == "coffee table":
        f.box(0, 0, 0.12, (w - 0.3, d - 0.14, 0.02), top, skip=())


def round_table(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    f.tube(0, 0, 0, [(r * 0.72, 0.0), (r * 0.70, 0.05), (r * 0.35, 0.12), (r * 0.28, h - 0.1), (r * 0.5, h - 0.03)],
           Surface("steel", (0.55, 0.56, 0.57), 0.5), sides=20)  # fmt: skip
    f.tube(0, 0, h - 0.03, [(r * 0.5, 0.0), (r, 0.0), (r, 0.03), (0.0, 0.0301)], timber(LACQUER), sides=24)


def cabinet(f: Frame, o: WorldObject, rng: Generator) -> None:
    """Sideboard, filing cabinet, nightstand, tv stand, shoe bench: a body with fronts."""
    w, d, h = o.size
    if o.name == "filing cabinet":
        body = Surface("steel", (0.76, 0.77, 0.78), 0.6)
        face, columns, rows = Surface("steel", (0.82, 0.83, 0.84), 0.6), 1, 3
    else:
        colour = pick(rng, (OAK, WALNUT, ASH))
        body = timber(colour)
        face = timber(shade(colour, 1.05)) if rng.random() < 0.5 else Surface("plain", LACQUER)
        columns, rows = {"sideboard": (3, 1), "tv stand": (3, 1), "shoe bench": (2, 1)}.get(o.name, (1, 2))
    f.box(0, 0.01, 0.0, (w - 0.06, d - 0.06, 0.06), DARK)
    f.box(0, 0, 0.05, (w, d - 0.02, h - 0.05), body)
    f.box(0, -0.005, h - 0.02, (w + 0.01, d, 0.02), body, skip=())
    _fronts(f, w - 0.02, d - 0.02, 0.06, h - 0.025, columns, rows, face)


def bookshelf(f: Frame, o: WorldObject, rng: Generator) -> None:
    w, d, h = o.size
    wood = timber(pick(rng, (OAK, WALNUT, LACQUER)))
    for side in (-1.0, 1.0):
        f.box(side * (w / 2 - 0.0125), 0, 0, (0.025, d, h), wood)
    f.box(0, 0, h - 0.025, (w, d, 0.025), wood, skip=())
    f.box(0, d / 2 - 0.01, 0.0, (w, 0.02, h), wood, skip=("front", "bottom"))
    shelves = 5
    pitch = (h - 0.10) / shelves
    for level in range(shelves):
        z = 0.06 + level * pitch
        f.box(0, 0, z, (w - 0.05, d - 0.02, 0.025), wood, skip=())
        start = float(rng.uniform(0, 1))
        row = Surface(f"books {int(rng.integers(3))}")
        x0, y, low, high = -w / 2 + 0.025, -d / 2 + 0.06, z + 0.025, z + pitch
        corners = [(x0, y, low), (-x0, y, low), (-x0, y, high), (x0, y, high)]
        f.quad(corners, row, [(start, 0.0), (start + 1.0, 0.0), (start + 1.0, 1.0), (start, 1.0)])
    f.box(0, 0, 0, (w, d - 0.03, 0.06), wood)


def wardrobe(f: Frame, o: WorldObject, rng: Generator) -> None:
    w, d, h = o.size
    colour = pick(rng, (LACQUER, ASH, OAK))
    f.box(0, 0, 0, (w, d - 0.02, h), timber(colour))
    _fronts(f, w - 0.02, d - 0.02, 0.08, h - 0.03, 2 if w < 1.4 else 3, 1, timber(shade(colour, 1.04)))


def sofa(f: Frame, o: WorldObject, rng: Generator) -> None:
    """Sofa and armchair: base, arms, seat and back cushions."""
    w, d, _h = o.size
    colour = pick(rng, FABRICS)
    cloth, pillow = Surface("fabric", shade(colour, 0.92), 0.35), Surface("fabric", colour, 0.35)
    arm = 0.17
    f.box(0, 0, 0.06, (w, d, 0.22), cloth)
    f.box(0, d / 2 - 0.11, 0.2, (w, 0.22, 0.46), cloth)
    f.at(0, d / 2 - 0.11).blob(0, 0, 0.56, (w / 2, 0.115, 0.09), cloth, power=0.3)
    for side in (-1.0, 1.0):
        f.box(side * (w / 2 - arm / 2), 0, 0.1, (arm, d, 0.44), cloth)
        f.at(side * (w / 2 - arm / 2), 0).blob(0, 0, 0.47, (arm / 2 + 0.012, d / 2, 0.07), cloth, power=0.3)
        for end in (-1.0, 1.0):
            f.tube(side * (w / 2 - 0.1), end * (d / 2 - 0.1), 0, [(0.02, 0.0), (0.03, 0.07)], DARK, sides=6)
    seats = max(1, round((w - 2 * arm) / 0.65))
    wide = (w - 2 * arm) / seats
    for index in range(seats):
        x = -w / 2 + arm + (index + 0.5) * wide
        f.blob(x, -0.10, 0.25, (wide / 2 - 0.004, d / 2 - 0.10, 0.10), pillow, power=0.32)
        f.at(x, d / 2 - 0.26, 0.40, pitch=0.20).blob(0, 0, 0, (wide / 2 - 0.008, 0.10, 0.22), pillow, power=0.42)


def bed(f: Frame, o: WorldObject, rng: Generator) -> None:
    w, d, h = o.size
    wood = timber(pick(rng, (OAK, WALNUT)))
    sheet, cover = Surface("fabric", (0.94, 0.94, 0.93), 0.5), Surface("fabric", pick(rng, FABRICS), 0.6)
    f.box(0, 0, 0.0, (w, d, 0.30), wood)
    f.box(0, d / 2 - 0.03, 0, (w + 0.04, 0.06, 1.05), wood, skip=())
    f.blob(0, -0.01, 0.24, (w / 2 - 0.02, d / 2 - 0.04, 0.15), sheet, power=0.25)
    f.blob(0, -0.30, 0.22, (w / 2 + 0.005, d / 2 - 0.28, 0.17), cover, power=0.22)
    f.blob(0, 0.36, 0.46, (w / 2 - 0.03, 0.14, 0.055), sheet, power=0.35)
    for side in (-1.0, 1.0):
        f.at(side * w / 4, d / 2 - 0.32, h - 0.06, pitch=0.35).blob(0, 0, -0.02, (0.33, 0.22, 0.085), sheet, power=0.5)


def fridge(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    steel = Surface("steel", (0.80, 0.81, 0.82), 0.8)
    f.box(0, 0.02, 0, (w, d - 0.04, h), Surface("plain", (0.62, 0.63, 0.64)))
    for low, high in ((0.05, 0.70), (0.71, h)):
        f.box(0, -d / 2 + 0.03, low, (w, 0.06, high - low), steel, skip=())
        f.box(-w / 2 + 0.06, -d / 2 - 0.03, (low + high) / 2 - 0.2, (0.025, 0.03, 0.4), CHROME, skip=())


def kitchen_unit(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.box(0, 0.03, 0, (w, d - 0.08, 0.10), DARK)
    f.box(0, 0.01, 0.10, (w, d - 0.04, h - 0.14), Surface("plain", shade(LACQUER, 0.92)))
    f.box(0, 0, h - 0.04, (w + 0.002, d, 0.04), Surface("stone", (0.48, 0.48, 0.48), 0.6), skip=())
    f.sheet((-w / 2, d / 2 - 0.004, h), (w, 0, 0), (0, 0, 0.5), Surface("tiles", (0.90, 0.92, 0.91), 0.6), steps=(1, 2))
    front = Surface("plain", (0.80, 0.84, 0.82))
    if o.name == "stove":
        f.box(0, -0.02, h, (0.56, 0.50, 0.006), Surface("plain", (0.07, 0.07, 0.075)))
        for x, y in ((-0.13, 0.10), (0.13, 0.10), (-0.13, -0.12), (0.13, -0.12)):
            f.tube(
                x,
                y,
                h + 0.006,
                [(0.085, 0.0), (0.085, 0.001), (0.0, 0.0015)],
                Surface("plain", (0.2, 0.2, 0.21)),
                sides=16,
            )
        f.box(0, -d / 2 + 0.015, 0.12, (w - 0.01, 0.03, h - 0.18), Surface("steel", (0.66, 0.67, 0.68), 0.5))
        f.box(0, -d / 2 - 0.003, 0.22, (w - 0.12, 0.01, 0.36), INK)
        f.box(0, -d / 2 - 0.02, 0.64, (w - 0.12, 0.02, 0.02), CHROME, skip=())
        return
    _fronts(f, w, d - 0.04, 0.11, h - 0.05, 2 if w > 0.7 else 1, 1 if w > 0.7 else 2, front)
    if o.name == "sink unit":
        f.box(0, -0.02, h, (0.56, 0.42, 0.004), Surface("steel", (0.72, 0.73, 0.74), 0.4))
        f.box(0, -0.03, h + 0.004, (0.44, 0.32, 0.001), Surface("steel", (0.45, 0.46, 0.47), 0.4))
        f.tube(0, 0.20, h, [(0.02, 0.0), (0.016, 0.05), (0.014, 0.28)], CHROME, sides=8)
        f.box(0, 0.11, h + 0.26, (0.022, 0.2, 0.02), CHROME, skip=())


def wall_cabinet(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.box(0, 0, 0, (w, d - 0.02, h), Surface("plain", shade(LACQUER, 0.95)), skip=())
    _fronts(f, w, d - 0.02, 0.0, h, 1, 1, Surface("plain", (0.87, 0.89, 0.88)))


def copier(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.box(0, 0, 0.04, (w, d, h * 0.72), Surface("plain", (0.80, 0.81, 0.82)))
    _fronts(f, w - 0.02, d, 0.08, 0.58, 1, 3, Surface("plain", (0.88, 0.88, 0.88)))
    f.box(0, 0.02, h * 0.76, (w, d - 0.06, h * 0.14), Surface("plain", (0.45, 0.46, 0.48)))
    f.box(0, 0.03, h * 0.9, (w - 0.02, d - 0.08, h * 0.1), Surface("plain", (0.88, 0.88, 0.88)))
    f.at(0.12, -d / 2 + 0.04, h * 0.84, pitch=0.6).box(
        0, 0, 0, (0.26, 0.02, 0.14), INK, front=Surface("desktop 1", glows=True)
    )


def panel_picture(f: Frame, o: WorldObject, rng: Generator) -> None:
    w, d, h = o.size
    frame = timber(pick(rng, (WALNUT, OAK, (0.14, 0.14, 0.14))), 0.3)
    names = ("painting 0", "painting 1", "painting 2", "scenery")
    f.box(0, 0, 0, (w, d, h), frame, skip=("back",))
    f.box(
        0,
        -d / 2 - 0.005,
        0.025,
        (w - 0.05, 0.002, h - 0.05),
        frame,
        front=Surface(names[int(rng.integers(4))]),
        skip=("back",),
    )


def whiteboard(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.box(0, 0, 0, (w, d, h), CHROME, skip=("back",))
    f.box(0, -d / 2 - 0.006, 0.03, (w - 0.06, 0.002, h - 0.06), CHROME, front=Surface("whiteboard"), skip=("back",))
    f.box(0, -d / 2 - 0.03, 0.0, (w * 0.5, 0.06, 0.015), CHROME, skip=())


def wall_clock(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r = o.size[0] / 2
    face = f.at(0, o.size[1] / 2 - 0.005, r, pitch=-math.pi / 2)
    face.tube(0, 0, 0, [(r, 0.0), (r, 0.035), (r * 0.9, 0.04)], DARK, sides=20)
    s = r * 0.64
    f.quad([(-s, -0.02, r - s), (s, -0.02, r - s), (s, -0.02, r + s), (-s, -0.02, r + s)], Surface("clock"))
    face.tube(0, 0, 0.035, [(r * 0.92, 0.0), (0.0, 0.001)], Surface("plain", (0.96, 0.96, 0.95)), sides=20)


def mirror(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.box(0, 0, 0, (w, d, h), timber(OAK, 0.4), skip=("back",))
    f.box(
        0,
        -d / 2 - 0.006,
        0.03,
        (w - 0.06, 0.002, h - 0.06),
        DARK,
        front=Surface("steel", (0.82, 0.86, 0.88)),
        skip=("back",),
    )


def monitor(f: Frame, o: WorldObject, rng: Generator) -> None:
    w, _d, h = o.size
    f.box(0, 0.02, 0, (0.22, 0.16, 0.012), INK)
    f.box(0, 0.05, 0, (0.05, 0.03, 0.26), INK)
    screen = Surface(f"desktop {int(rng.integers(2))}", glows=True)
    f.box(0, 0.0, h - 0.35, (w, 0.035, 0.35), INK, skip=())
    f.box(0, -0.019, h - 0.337, (w - 0.024, 0.002, 0.324), INK, front=screen, skip=("back",))


def keyboard(f: Frame, o: WorldObject, _rng: Generator) -> None:
    f.box(0, 0, 0, o.size, DARK, top=Surface("keys"))
    f.blob(o.size[0] / 2 + 0.09, 0, 0, (0.03, 0.05, 0.015), DARK)


def paper_tray(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, _h = o.size
    for z in (0.0, 0.075):
        f.box(0, 0, z, (w, d, 0.008), Surface("plain", (0.35, 0.36, 0.37)), skip=())
        f.box(0.005, 0, z + 0.008, (w - 0.04, d - 0.03, 0.022), Surface("plain", (0.95, 0.95, 0.94)))
    for x in (-1.0, 1.0):
        f.box(x * (w / 2 - 0.005), d / 2 - 0.03, 0, (0.01, 0.05, 0.12), DARK, skip=())


def divider(f: Frame, o: WorldObject, _rng: Generator) -> None:
    f.box(0, 0, 0, o.size, Surface("fabric", (0.50, 0.55, 0.54), 0.3), skip=())


def waste_bin(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    f.tube(0, 0, 0, [(r * 0.78, 0.0), (r, h), (r * 0.92, h), (r * 0.75, 0.04), (0.0, 0.03)], DARK, sides=14)


def coat_rack(f: Frame, o: WorldObject, rng: Generator) -> None:
    h = o.size[2]
    f.tube(
        0, 0, 0, [(0.19, 0.0), (0.18, 0.03), (0.025, 0.05), (0.022, h), (0.0, h + 0.02)], timber(WALNUT, 0.3), sides=12
    )
    coats: tuple[Colour, ...] = ((0.30, 0.31, 0.36), (0.50, 0.47, 0.43), (0.36, 0.41, 0.37))
    for hook in range(5):
        turned = f.at(yaw=hook * math.tau / 5)
        turned.at(0, -0.02, h - 0.12, pitch=0.8).box(0, 0, 0, (0.02, 0.02, 0.14), timber(WALNUT, 0.3), skip=())
        if hook < 3:
            cloth = Surface("fabric", coats[hook], 0.3)
            turned.blob(0, -0.13, h - 0.95 + 0.1 * float(rng.random()), (0.14, 0.07, 0.42), cloth, power=0.6)


def floor_lamp(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    f.tube(0, 0, 0, [(r * 0.9, 0.0), (r * 0.85, 0.025), (0.015, 0.035), (0.013, h - 0.2)], CHROME, sides=14)
    _lampshade(f, h - 0.34, r, 0.32)


def table_lamp(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    f.tube(
        0, 0, 0, [(r * 0.5, 0.0), (r * 0.55, 0.05), (r * 0.2, 0.12), (0.015, 0.2)], Surface("stone", (0.8, 0.8, 0.8))
    )
    _lampshade(f, h - 0.22, r, 0.22)


def _lampshade(f: Frame, z: float, r: float, tall: float) -> None:
    outside = Surface("fabric", (0.99, 0.95, 0.87), 0.2, glows=True)
    f.tube(0, 0, z, [(r, 0.0), (r * 0.72, tall)], outside, sides=16)
    f.tube(0, 0, z, [(r * 0.7, tall - 0.01), (r * 0.98, 0.0)], Surface("plain", (1.0, 0.97, 0.9), glows=True), sides=16)


def book_pile(f: Frame, o: WorldObject, rng: Generator) -> None:
    z = 0.0
    cover: tuple[Colour, ...] = ((0.34, 0.37, 0.42), (0.55, 0.50, 0.44), (0.40, 0.46, 0.41), (0.75, 0.74, 0.72))
    for index in range(4):
        tall, skew = 0.025 + 0.012 * float(rng.random()), float(rng.uniform(-0.25, 0.25))
        w, d = o.size[0] - 0.03 * float(rng.random()), o.size[1] - 0.02 * float(rng.random())
        pile = f.at(z=z, yaw=skew)
        pile.box(0, 0, 0, (w, d, tall), Surface("plain", cover[index]), skip=())
        pile.box(0, -d / 2 - 0.0005, 0.004, (w - 0.01, 0.001, tall - 0.008), Surface("plain", (0.92, 0.91, 0.87)))
        z += tall


def fruit_bowl(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r = o.size[0] / 2
    f.tube(
        0,
        0,
        0,
        [(r * 0.4, 0.0), (r, 0.09), (r * 0.95, 0.09), (0.0, 0.03)],
        Surface("plain", (0.88, 0.88, 0.87)),
        sides=18,
    )
    for index in range(5):
        a = index * math.tau / 5
        f.blob(0.07 * math.cos(a), 0.07 * math.sin(a), 0.05, (0.04, 0.04, 0.038), Surface("plain", (0.55, 0.64, 0.43)))


def mug(f: Frame, o: WorldObject, rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    glaze = Surface("plain", pick(rng, ((0.92, 0.92, 0.91), (0.42, 0.46, 0.48), (0.60, 0.62, 0.56))))
    f.tube(0, 0, 0, [(r * 0.9, 0.0), (r, h), (r * 0.9, h), (r * 0.85, 0.01), (0.0, 0.01)], glaze, sides=12)
    f.box(r + 0.015, 0, h * 0.2, (0.03, 0.012, h * 0.6), glaze, skip=())


def flat_rug(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.sheet((-w / 2, -d / 2, h), (w, 0, 0), (0, d, 0), Surface("rug", (1.0, 1.0, 1.0)), steps=(6, 4), whole=True)


def backpack(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    body, dark, light = paint("backpack", 0.93), paint("backpack", 0.55, 0.95), paint("backpack", 1.0, 0.86)
    lean = f.at(0, 0.03, 0, pitch=0.06)
    lean.blob(0, 0, 0, (w / 2, d * 0.36, h / 2), body, power=0.55)
    lean.blob(0, -d * 0.30, 0.03, (w * 0.38, d * 0.22, h * 0.21), light, power=0.5)
    lean.blob(0, -d * 0.24, h * 0.50, (w * 0.36, d * 0.18, h * 0.14), light, power=0.5)
    for z, wide in ((h * 0.45, 0.60), (h * 0.79, 0.62)):
        lean.box(0, -d * 0.40, z, (w * wide, 0.012, 0.012), dark, skip=())
    for side in (-1.0, 1.0):
        lean.at(side * w * 0.34, -d * 0.30, h * 0.1).box(0, 0.02, 0, (0.03, 0.02, h * 0.72), dark, skip=())
        lean.blob(side * w * 0.49, 0, 0.05, (0.035, d * 0.2, h * 0.16), dark, power=0.6)
        lean.at(side * w * 0.22, d * 0.36, h * 0.1).box(0, 0, 0, (0.055, 0.03, h * 0.75), dark, skip=())
    lean.at(0, 0.02, h - 0.02).box(0, 0, 0, (0.10, 0.02, 0.045), dark, skip=())


def laptop(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    metal = Surface("plain", PAINTED_LAPTOP)
    deck = d * 0.76
    back = -d / 2 + deck
    f.box(0, -d / 2 + deck / 2, 0, (w, deck, 0.016), metal)
    f.quad([(-w * 0.43, back - deck * 0.6, 0.0165), (w * 0.43, back - deck * 0.6, 0.0165),
            (w * 0.43, back - 0.02, 0.0165), (-w * 0.43, back - 0.02, 0.0165)], Surface("keys"))  # fmt: skip
    lid = f.at(0, back, 0.012, pitch=0.28)
    tall = (h - 0.012) / math.cos(0.28)
    lid.box(
        0, 0.005, 0, (w, 0.010, tall), Surface("laptop lid", glows=True), front=Surface("laptop lid"), skip=("back",)
    )
    lid.sheet((w / 2, 0.0101, 0), (-w, 0, 0), (0, 0, tall), Surface("laptop lid"), whole=True)
    m = 0.008
    lid.sheet(
        (-w / 2 + m, -0.001, m),
        (w - 2 * m, 0, 0),
        (0, 0, tall - 2 * m),
        Surface("laptop screen", glows=True),
        whole=True,
    )


PAINTED_LAPTOP: Colour = hsv(PAINT["laptop"], 0.88, 0.72)


def bottle(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    glass, band = paint("bottle", 0.88, 0.88), paint("bottle", 0.62, 0.95)
    f.tube(0, 0, 0, [(0.0, 0.0), (r, 0.0), (r, h * 0.22)], glass)
    f.tube(0, 0, h * 0.22, [(r * 1.01, 0.0), (r * 1.01, h * 0.26)], band)
    f.tube(0, 0, h * 0.48, [(r, 0.0), (r, h * 0.14), (r * 0.42, h * 0.34), (r * 0.42, h * 0.42)], glass)
    f.tube(0, 0, h * 0.89, [(r * 0.5, 0.0), (r * 0.5, h * 0.11), (0.0, h * 0.111)], band)


def television(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    standing = o.z < 0.7
    low = 0.06 if standing else 0.0
    if standing:
        for side in (-1.0, 1.0):
            f.box(side * w * 0.32, 0, 0, (0.03, 0.22, 0.015), INK)
            f.box(side * w * 0.32, 0, 0.01, (0.03, 0.03, low), INK)
    f.box(0, 0.01, low, (w, d * 0.5, h - low), INK, skip=())
    face = Surface("television", glows=True)
    f.box(0, -d * 0.22 - 0.005, low + 0.022, (w - 0.03, 0.004, h - low - 0.034), INK, front=face, skip=("back",))


def potted_plant(f: Frame, o: WorldObject, rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    pot = Surface("plain", pick(rng, ((0.90, 0.90, 0.89), (0.34, 0.35, 0.36), (0.62, 0.60, 0.58))))
    tall = 0.34
    f.tube(0, 0, 0, [(r * 0.72, 0.0), (r, tall), (r * 0.9, tall), (r * 0.86, tall - 0.04)], pot, sides=16)
    f.tube(0, 0, tall - 0.04, [(r * 0.88, 0.0), (0.0, 0.01)], Surface("carpet", (0.26, 0.235, 0.21), 0.2), sides=16)
    for index in range(46):
        up = index / 45
        lift = math.radians(float(rng.uniform(5, 50)) + 35 * up)
        length = (0.36 - 0.10 * up) * float(rng.uniform(0.8, 1.15))
        base = tall + (h - tall) * 0.78 * up
        surface = paint("potted plant", float(rng.uniform(0.36, 0.70)), float(rng.uniform(0.74, 0.86)))
        _leaf(f.at(0, 0, base, yaw=index * 2.399963), length, lift, surface)
    f.tube(0, 0, tall - 0.03, [(0.022, 0.0), (0.012, (h - tall) * 0.8)], paint("potted plant", 0.30), sides=6)


def _leaf(f: Frame, length: float, lift: float, surface: Surface) -> None:
    """A folded leaf that rises at `lift` and bends down, towards -y; seen from both sides."""
    spine = [(0.0, 0.0, 0.0)]
    bend = lift
    for share in (0.4, 0.35, 0.25):
        _, y, z = spine[-1]
        spine.append((0.0, y - length * share * math.cos(bend), z + length * share * math.sin(bend)))
        bend -= math.radians(38)
    widths = [0.012, 0.19 * length, 0.15 * length, 0.0]
    for side in (-1.0, 1.0):
        for (a, b), (wa, wb) in zip(pairwise(spine), pairwise(widths), strict=True):
            corners = [a, (side * wa, a[1], a[2] + 0.35 * wa), (side * wb, b[1], b[2] + 0.35 * wb), b]
            f.quad(corners, surface)
            f.quad(corners[::-1], surface)


def vase(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    glaze = paint("vase", 0.95, 0.90)
    outline = [(0.0, 0.0), (0.55, 0.0), (0.95, 0.28), (0.98, 0.42), (0.5, 0.78), (0.46, 0.86), (0.66, 1.0), (0.56, 1.0)]
    f.tube(0, 0, 0, [(r * wide, h * high) for wide, high in [*outline, (0.36, 0.85)]], glaze, sides=16)


def suitcase(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    shell, dark = paint("suitcase", 0.85, 0.88), paint("suitcase", 0.55, 0.92)
    tall = h - 0.05
    f.blob(0, 0, 0.05, (w / 2, d / 2, tall / 2), shell, power=0.28)
    for x in (-0.3, -0.1, 0.1, 0.3):
        f.box(x * w, -d / 2 - 0.003, 0.05 + tall * 0.14, (0.018, 0.012, tall * 0.72), dark, skip=())
        f.box(x * w, d / 2 + 0.003, 0.05 + tall * 0.14, (0.018, 0.012, tall * 0.72), dark, skip=())
    for x in (-1.0, 1.0):
        for y in (-1.0, 1.0):
            f.tube(x * (w / 2 - 0.05), y * (d / 2 - 0.05), 0, [(0.0, 0.0), (0.025, 0.01), (0.025, 0.06)], INK, sides=8)
        f.box(x * 0.08, d / 2 - 0.04, h, (0.014, 0.014, 0.16), CHROME)
    f.box(0, d / 2 - 0.04, h + 0.15, (0.20, 0.03, 0.025), INK, skip=())


def cushion(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.at(pitch=0.22).blob(0, 0, 0, (w / 2, d / 2, h / 2), paint("cushion", 0.86, 0.84), power=0.62)


BUILDERS: dict[str, Builder] = {
    "backpack": backpack, "laptop": laptop, "bottle": bottle, "television": television,
    "potted plant": potted_plant, "vase": vase, "suitcase": suitcase, "cushion": cushion,
    "desk": desk, "executive desk": desk, "office chair": office_chair, "meeting table": table,
    "filing cabinet": cabinet, "copier": copier, "whiteboard": whiteboard, "monitor": monitor,
    "keyboard": keyboard, "paper tray": paper_tray, "desk divider": divider, "waste bin": waste_bin,
    "round table": round_table, "coat rack": coat_rack, "wall clock": wall_clock, "sofa": sofa,
    "armchair": sofa, "coffee table": table, "tv stand": cabinet, "sideboard": cabinet,
    "bookshelf": bookshelf, "dining table": table, "chair": chair, "kitchen unit": kitchen_unit,
    "stove": kitchen_unit, "sink unit": kitchen_unit, "wall cabinet": wall_cabinet, "fridge": fridge,
    "bed": bed, "nightstand": cabinet, "wardrobe": wardrobe, "shoe bench": cabinet,
    "floor lamp": floor_lamp, "table lamp": table_lamp, "book pile": book_pile, "fruit bowl": fruit_bowl,
    "mug": mug, "rug": flat_rug, "picture": panel_picture, "mirror": mirror,
}  # fmt: skip


ALIKE = frozenset({"chair", "office chair", "desk", "bookshelf", "filing cabinet"})
"""Kinds that are bought as a set: all of a room look the same."""


def add_thing(frame: Frame, item: WorldObject, seed: int, room: str) -> None:
    """The model of one thing; other kinds than the `ALIKE` ones differ from place to place."""
    own = (*room.encode(), *item.name.encode()) if item.name in ALIKE else (round(item.x * 100), round(item.y * 100))
    rng = np.random.default_rng([seed, *own])
    BUILDERS[item.name](frame, item, rng)


def add_shadow(ground: Frame, item: WorldObject) -> None:
    """What a standing thing takes from the light of the floor or table under it."""
    spread = min(0.22, 0.05 + 0.25 * item.size[2], 0.6 * max(item.size[:2]))
    w, d = item.size[0] + 2 * spread, item.size[1] + 2 * spread
    surface = Surface("spot" if item.round else "shadow", (0.0, 0.0, 0.0), alpha=0.36, glows=True)
    ground.sheet((-w / 2, -d / 2, 0.006), (w, 0, 0), (0, d, 0), surface, whole=True)
