"""What stands on its own feet: small models in the thing's own frame, front along -y, bottom at z = 0."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ghal360_robot.simulation.materials import (
    ASH,
    CHARCOAL,
    CHROME,
    DARK,
    FABRICS,
    INK,
    LACQUER,
    OAK,
    WALNUT,
    fronts,
    pick,
    shade,
    timber,
)
from ghal360_robot.simulation.meshes import Frame, Surface

if TYPE_CHECKING:
    from numpy.random import Generator

    from ghal360_robot.simulation.objects import WorldObject


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
    fronts(drawers, 0.40, d - 0.22, 0.05, h - 0.08, 1, 3, Surface("plain", (0.88, 0.88, 0.87)))


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
        body = Surface("plain", (0.74, 0.75, 0.76))
        face, columns, rows = Surface("plain", (0.83, 0.84, 0.85)), 1, 3
    else:
        colour = pick(rng, (OAK, WALNUT, ASH))
        body = timber(colour)
        face = timber(shade(colour, 1.05)) if rng.random() < 0.5 else Surface("plain", LACQUER)
        columns, rows = {"sideboard": (3, 1), "tv stand": (3, 1), "shoe bench": (2, 1)}.get(o.name, (1, 2))
    f.box(0, 0.01, 0.0, (w - 0.06, d - 0.06, 0.06), DARK)
    f.box(0, 0, 0.05, (w, d - 0.02, h - 0.05), body)
    f.box(0, -0.005, h - 0.02, (w + 0.01, d, 0.02), body, skip=())
    fronts(f, w - 0.02, d - 0.02, 0.06, h - 0.025, columns, rows, face)


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
    fronts(f, w - 0.02, d - 0.02, 0.08, h - 0.03, 2 if w < 1.4 else 3, 1, timber(shade(colour, 1.04)))


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
    steel = Surface("plain", (0.79, 0.80, 0.81))
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
    fronts(f, w, d - 0.04, 0.11, h - 0.05, 2 if w > 0.7 else 1, 1 if w > 0.7 else 2, front)
    if o.name == "sink unit":
        f.box(0, -0.02, h, (0.56, 0.42, 0.004), Surface("steel", (0.72, 0.73, 0.74), 0.4))
        f.box(0, -0.03, h + 0.004, (0.44, 0.32, 0.001), Surface("steel", (0.45, 0.46, 0.47), 0.4))
        f.tube(0, 0.20, h, [(0.02, 0.0), (0.016, 0.05), (0.014, 0.28)], CHROME, sides=8)
        f.box(0, 0.11, h + 0.26, (0.022, 0.2, 0.02), CHROME, skip=())


def wall_cabinet(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.box(0, 0, 0, (w, d - 0.02, h), Surface("plain", shade(LACQUER, 0.95)), skip=())
    fronts(f, w, d - 0.02, 0.0, h, 1, 1, Surface("plain", (0.87, 0.89, 0.88)))


def copier(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    f.box(0, 0, 0.04, (w, d, h * 0.72), Surface("plain", (0.80, 0.81, 0.82)))
    fronts(f, w - 0.02, d, 0.08, 0.58, 1, 3, Surface("plain", (0.88, 0.88, 0.88)))
    f.box(0, 0.02, h * 0.76, (w, d - 0.06, h * 0.14), Surface("plain", (0.45, 0.46, 0.48)))
    f.box(0, 0.03, h * 0.9, (w - 0.02, d - 0.08, h * 0.1), Surface("plain", (0.88, 0.88, 0.88)))
    f.at(0.12, -d / 2 + 0.04, h * 0.84, pitch=0.6).box(
        0, 0, 0, (0.26, 0.02, 0.14), INK, front=Surface("desktop 1", glows=True)
    )
