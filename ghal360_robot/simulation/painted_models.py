"""The things a detector knows, in the paint of their class."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

from ghal360_robot.simulation.materials import CHROME, INK, paint, pick, television_feet
from ghal360_robot.simulation.meshes import Colour, Frame, Surface
from ghal360_robot.simulation.paint import PAINT
from ghal360_robot.simulation.pixels import hsv

if TYPE_CHECKING:
    from numpy.random import Generator

    from ghal360_robot.simulation.objects import WorldObject

PAINTED_LAPTOP: Colour = hsv(PAINT["laptop"], 0.88, 0.72)


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


def bottle(f: Frame, o: WorldObject, _rng: Generator) -> None:
    r, h = o.size[0] / 2, o.size[2]
    glass, band = paint("bottle", 0.88, 0.88), paint("bottle", 0.62, 0.95)
    f.tube(0, 0, 0, [(0.0, 0.0), (r, 0.0), (r, h * 0.22)], glass)
    f.tube(0, 0, h * 0.22, [(r * 1.01, 0.0), (r * 1.01, h * 0.26)], band)
    f.tube(0, 0, h * 0.48, [(r, 0.0), (r, h * 0.14), (r * 0.42, h * 0.34), (r * 0.42, h * 0.42)], glass)
    f.tube(0, 0, h * 0.89, [(r * 0.5, 0.0), (r * 0.5, h * 0.11), (0.0, h * 0.111)], band)


def television(f: Frame, o: WorldObject, _rng: Generator) -> None:
    w, d, h = o.size
    low = television_feet(f, o)
    f.box(0, 0.01, low, (w, d * 0.5, h - low), INK, skip=())
    face = Surface("television", glows=True)
    f.box(0, -d * 0.22 - 0.005, low + 0.022, (w - 0.03, 0.004, h - low - 0.034), INK, front=face, skip=("back",))


def potted_plant(f: Frame, o: WorldObject, rng: Generator) -> None:
    def leaf(rng: Generator) -> Surface:
        return paint("potted plant", float(rng.uniform(0.36, 0.70)), float(rng.uniform(0.74, 0.86)))

    plant(f, o, rng, leaf, paint("potted plant", 0.30))


def plant(f: Frame, o: WorldObject, rng: Generator, leaf: Callable[[Generator], Surface], stem: Surface) -> None:
    """A pot with a stem and leaves that turn around it."""
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
        surface = leaf(rng)
        add_leaf(f.at(0, 0, base, yaw=index * 2.399963), length, lift, surface)
    f.tube(0, 0, tall - 0.03, [(0.022, 0.0), (0.012, (h - tall) * 0.8)], stem, sides=6)


def add_leaf(f: Frame, length: float, lift: float, surface: Surface) -> None:
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
    trolley(f, o, paint("suitcase", 0.85, 0.88), paint("suitcase", 0.55, 0.92))


def trolley(f: Frame, o: WorldObject, shell: Surface, dark: Surface) -> None:
    """A suitcase on wheels with its handle drawn out."""
    w, d, h = o.size
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
    pillow(f, o, paint("cushion", 0.86, 0.84))


def pillow(f: Frame, o: WorldObject, cloth: Surface) -> None:
    w, d, h = o.size
    f.at(pitch=0.22).blob(0, 0, 0, (w / 2, d / 2, h / 2), cloth, power=0.62)
