"""The other things as they look in the field, and stand-ins for those that look like the one searched for."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ghal360_robot.simulation.materials import LACQUER, OAK, pick, shade, timber
from ghal360_robot.simulation.meshes import Colour, Frame, Section, Surface
from ghal360_robot.simulation.natural_models import ALUMINIUM, LEAF_M
from ghal360_robot.simulation.painted_models import add_leaf, pillow, plant, trolley
from ghal360_robot.simulation.pixels import hsv

if TYPE_CHECKING:
    from numpy.random import Generator

    from ghal360_robot.simulation.objects import WorldObject

GREEN = Surface("canvas", hsv(105, 0.60, 0.32), 0.4)


def potted_plant(f: Frame, o: WorldObject, rng: Generator) -> None:
    plant(f, o, rng, _leaf, GREEN)


def _leaf(rng: Generator) -> Surface:
    return Surface("canvas", hsv(float(rng.uniform(92, 118)), 0.58, float(rng.uniform(0.30, 0.58))), 0.4)


def vase(f: Frame, o: WorldObject, rng: Generator) -> None:
    """A round bowl full of flowers: a slim vase is a bottle to every detector."""
    r, h = o.size[0] / 2, o.size[2] * 0.45
    glaze = pick(rng, (hsv(210, 0.55, 0.55), (0.90, 0.88, 0.84), hsv(18, 0.55, 0.62), hsv(165, 0.40, 0.55)))
    outline = ((0.0, 0.60), (0.10, 0.80), (0.45, 1.0), (0.75, 0.94), (1.0, 0.78), (1.0, 0.70), (0.9, 0.0))
    f.loft([Section(h * z, r * x, r * x, power=1.0) for z, x in outline], Surface("glass", glaze), sides=16)
    petals = pick(rng, (hsv(350, 0.62, 0.88), hsv(48, 0.75, 0.95), hsv(290, 0.40, 0.85), (0.95, 0.94, 0.92)))
    for index in range(15):
        lean = math.radians(float(rng.uniform(15, 80)))
        length = float(rng.uniform(0.12, 0.18))
        spray = f.at(0, 0, h * 0.92, yaw=index * 2.399963)
        add_leaf(spray, length, lean, GREEN)
        spray.blob(0, -length * math.cos(lean), length * math.sin(lean), (0.03, 0.03, 0.022), Surface("plain", petals))


SHELLS: tuple[Colour, ...] = ((0.50, 0.53, 0.57), hsv(205, 0.35, 0.62), (0.80, 0.78, 0.74))


def suitcase(f: Frame, o: WorldObject, rng: Generator) -> None:
    shell = pick(rng, SHELLS)
    trolley(f, o, Surface("plain", shell), Surface("plain", shade(shell, 0.72)))


def cushion(f: Frame, o: WorldObject, rng: Generator) -> None:
    covers = (hsv(42, 0.62, 0.80), hsv(190, 0.40, 0.58), hsv(12, 0.48, 0.70), (0.88, 0.86, 0.81))
    pillow(f, o, Surface("fabric", pick(rng, covers), 0.3))


def picture(f: Frame, o: WorldObject, rng: Generator) -> None:
    """A print on a wide mount in a pale frame: in a black one it would be a television to every detector."""
    w, d, h = o.size
    frame = timber(pick(rng, (OAK, shade(OAK, 0.9), LACQUER)), 0.3)
    f.box(0, 0, 0, (w, d, h), frame, skip=("back",))
    sheet = Surface(f"print {int(rng.integers(3))}")
    f.box(0, -d / 2 - 0.006, 0.025, (w - 0.05, 0.002, h - 0.05), frame, front=sheet, skip=("back",))


def shut_laptop(f: Frame, o: WorldObject, _rng: Generator) -> None:
    """A laptop that nobody uses: only a slab."""
    f.box(0, 0.01, 0, (o.size[0], LEAF_M, 0.022), Surface("plain", ALUMINIUM), skip=())


def desk_lamp(f: Frame, o: WorldObject, rng: Generator) -> None:
    """What stands on a desk instead of a screen: a lamp on an arm, and books."""
    steel = Surface("plain", pick(rng, ((0.82, 0.82, 0.80), hsv(200, 0.30, 0.55), (0.62, 0.60, 0.56))))
    base = f.at(-0.12, 0.08)
    base.tube(0, 0, 0, [(0.08, 0.0), (0.075, 0.015), (0.012, 0.02), (0.010, 0.36)], steel, sides=14)
    head = base.at(0, 0, 0.35, pitch=-1.1)
    head.tube(0, 0, 0, [(0.010, 0.0), (0.010, 0.15)], steel, sides=8)
    shade_at = base.at(0, -0.14, 0.36)
    shade_at.tube(0, 0, 0, [(0.075, 0.0), (0.045, 0.07), (0.0, 0.09)], steel, sides=14)
    shade_at.tube(0, 0, 0.004, [(0.0, 0.002), (0.07, 0.0)], Surface("plain", (1.0, 0.97, 0.88), glows=True), sides=14)
    for index, cover in enumerate((hsv(205, 0.35, 0.45), hsv(20, 0.35, 0.60), (0.80, 0.79, 0.76))):
        f.at(0.14, 0.02, 0.035 * index, yaw=0.2 * index).box(
            0, 0, 0, (0.17, 0.23, 0.03), Surface("plain", cover), skip=()
        )


def pinboard(f: Frame, o: WorldObject, _rng: Generator) -> None:
    """A board of cork with notes: a white one is a bright screen from afar."""
    w, d, h = o.size
    frame = timber(OAK, 0.3)
    f.box(0, 0, 0, (w, d, h), frame, skip=("back",))
    f.box(0, -d / 2 - 0.006, 0.03, (w - 0.06, 0.002, h - 0.06), frame, front=Surface("pinboard"), skip=("back",))
