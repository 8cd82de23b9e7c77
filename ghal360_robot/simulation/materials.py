"""What furniture is made of, and the fronts that cabinets share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ghal360_robot.simulation.meshes import Colour, Frame, Surface
from ghal360_robot.simulation.paint import PAINT
from ghal360_robot.simulation.pixels import hsv

if TYPE_CHECKING:
    from numpy.random import Generator

    from ghal360_robot.simulation.objects import WorldObject

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


def fronts(
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


def television_feet(f: Frame, o: WorldObject) -> float:
    """Two feet under a flat television that stands on something; returns the height of its lower edge."""
    if o.z >= 0.7:
        return 0.0
    low, aside = 0.06, o.size[0] * 0.32
    for x in (-aside, aside):
        f.box(x, 0, 0, (0.03, 0.22, 0.015), INK)
        f.box(x, 0, 0.01, (0.03, 0.03, low), INK)
    return low
