"""The things that are searched for, as they look in the field: what a detector trained on photographs knows."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from ghal360_robot.simulation.materials import pick, shade, television_feet
from ghal360_robot.simulation.meshes import Colour, Frame, Section, Surface
from ghal360_robot.simulation.pixels import hsv

if TYPE_CHECKING:
    from numpy.random import Generator

    from ghal360_robot.simulation.objects import WorldObject

    Outline = tuple[tuple[float, float], ...]
    """Share of the height and share of the radius, from the bottom up."""

BEZEL = Surface("plain", (0.035, 0.035, 0.04))
ALUMINIUM: Colour = (0.70, 0.71, 0.73)
PROGRAMMES, DESKTOPS = 4, 3
LID_LEAN = 0.45
"""A laptop's lid leans 26 degrees back, as it does before someone who stands."""
LEAF_M, LEAF_WIDER = 0.27, 1.10
"""Depth of a laptop's deck and lid, and how much wider than the footprint they are: a 17 inch one, 0.40 x 0.27 m.

It reaches some centimetres beyond the footprint; each pixel more makes it be found from further away."""


def television(f: Frame, o: WorldObject, rng: Generator) -> None:
    """A flat set that shows a programme, on feet if it stands on something."""
    w, d, h = o.size
    low = television_feet(f, o)
    face = Surface(f"programme {int(rng.integers(PROGRAMMES))}", glows=True)
    f.box(0, -d * 0.1, low, (w, d * 0.4, h - low), BEZEL, front=face, skip=())
    f.box(0, d * 0.2, low + 0.06, (w * 0.8, d * 0.4, h * 0.6), BEZEL, skip=())


def laptop(f: Frame, o: WorldObject, rng: Generator) -> None:
    """An open laptop at work: deck with keys and touch pad, hinge, a bright screen in a black frame."""
    w, d = o.size[0] * LEAF_WIDER, o.size[1]
    metal = pick(rng, (ALUMINIUM, shade(ALUMINIUM, 1.15), shade(ALUMINIUM, 0.85)))
    shell = Surface("plain", metal)
    hinge = -d / 2 + LEAF_M - 0.03
    f.box(0, hinge - LEAF_M / 2, 0, (w, LEAF_M, 0.016), shell, top=Surface("laptop deck", metal))
    lid = f.at(0, hinge, 0.014, pitch=LID_LEAN)
    face = Surface(f"laptop {int(rng.integers(DESKTOPS))}", glows=True)
    lid.box(0, 0.005, 0, (w, 0.010, LEAF_M), shell, front=face, skip=())
    sign = [(0.03, 0.0145, 0.11), (-0.03, 0.0145, 0.11), (-0.03, 0.0145, 0.15), (0.03, 0.0145, 0.15)]
    lid.quad(sign, Surface("plain", shade(metal, 1.25)))


def bottle(f: Frame, o: WorldObject, rng: Generator) -> None:
    """A bottle of wine or of water: body, shoulder, neck, cap and label."""
    r, h = o.size[0] / 2, o.size[2]
    lower: Outline
    upper: Outline
    crown: Outline
    if rng.random() < 0.5:
        cap = pick(rng, ((0.45, 0.06, 0.08), (0.12, 0.12, 0.13), (0.72, 0.58, 0.25)))
        body, r = Surface(f"wine {int(rng.integers(2))}"), r * 0.86
        lower, label = ((0.0, 0.90), (0.015, 1.0), (0.16, 1.0)), (0.16, 0.46)
        upper = ((0.46, 1.0), (0.58, 1.0), (0.66, 0.92), (0.76, 0.47), (0.82, 0.37))
        crown = ((0.82, 0.38), (0.96, 0.37), (0.965, 0.42), (0.99, 0.42), (1.0, 0.0))
    else:
        cap = pick(rng, ((0.10, 0.25, 0.70), (0.92, 0.93, 0.94), (0.10, 0.50, 0.28)))
        body, r = Surface(f"water {int(rng.integers(2))}"), r * 0.92
        lower, label = ((0.0, 0.88), (0.02, 1.0), (0.34, 1.0), (0.38, 0.93), (0.42, 1.0)), (0.42, 0.64)
        upper = ((0.64, 1.0), (0.80, 0.72), (0.88, 0.36), (0.92, 0.33))
        crown = ((0.92, 0.33), (0.921, 0.42), (0.985, 0.42), (1.0, 0.0))
    turned = f.at(yaw=float(rng.uniform(-0.5, 0.5)))
    for part, surface in (
        (lower, body),
        (((label[0], 1.0), (label[1], 1.0)), Surface("label")),
        (upper, body),
        (crown, Surface("glass", cap)),
    ):
        sections = [Section(h * z, r * wide, r * wide, power=1.0) for z, wide in part]
        turned.loft(sections, surface, sides=16)


CLOTHS: tuple[Colour, ...] = (
    hsv(218, 0.62, 0.42), (0.16, 0.165, 0.18), hsv(2, 0.80, 0.62), hsv(150, 0.50, 0.34), (0.42, 0.43, 0.45),
)  # fmt: skip


def backpack(f: Frame, o: WorldObject, rng: Generator) -> None:
    """A day pack that stands on the floor: arched body, front pocket, side pockets, handle, straps beside it."""
    w, d, h = o.size
    cloth = pick(rng, CLOTHS)
    body, trim = Surface("bag", cloth), Surface("canvas", shade(cloth, 0.42), 0.4)
    webbing = Surface("canvas", (0.09, 0.09, 0.10), 0.4)
    lean = f.at(0, 0.02, 0, pitch=0.05)
    outline = (
        (0.0, 0.86),
        (0.02, 0.95),
        (0.10, 1.0),
        (0.35, 1.0),
        (0.60, 0.96),
        (0.76, 0.86),
        (0.87, 0.68),
        (0.94, 0.42),
        (0.97, 0.0),
    )
    half = w * 0.47
    lean.loft([Section(h * z, half * x, d * 0.30 * (0.55 + 0.45 * x), d * 0.06, 0.62) for z, x in outline], body)
    low = ((0.0, 0.90), (0.03, 1.0), (0.24, 1.0), (0.36, 0.94), (0.42, 0.72), (0.44, 0.0))
    lean.loft([Section(h * z + 0.01, half * 0.82 * x, d * 0.22 * (0.4 + 0.6 * x), -d * 0.20, 0.6) for z, x in low],
              Surface("bag pocket", cloth))  # fmt: skip
    for side in (-1.0, 1.0):
        lean.at(side * half * 0.96, d * 0.06).blob(0, 0, 0.02, (0.035, d * 0.24, h * 0.17), trim, power=0.55)
        strap = [(0.78, 0.34, 0.30), (0.86, 0.30, 0.42), (0.70, 0.42, 0.52), (0.40, 0.60, 0.50), (0.12, 0.72, 0.40)]
        for (za, xa, ya), (zb, xb, yb) in pairwise(strap):
            a = (side * w * xa, d * ya, h * za)
            b = (side * w * xb, d * yb, h * zb)
            _strap(lean, a, b, 0.03, webbing)
    lean.at(0, d * 0.16, h * 0.95).tube(0, 0, 0, [(0.012, 0.0), (0.012, 0.03)], webbing, sides=6)
    for (xa, za), (xb, zb) in (
        ((-0.05, 0.94), (-0.035, 1.0)),
        ((-0.035, 1.0), (0.035, 1.0)),
        ((0.035, 1.0), (0.05, 0.94)),
    ):
        _strap(lean, (xa, d * 0.16, h * za), (xb, d * 0.16, h * zb), 0.02, webbing)


def _strap(
    f: Frame, a: tuple[float, float, float], b: tuple[float, float, float], wide: float, surface: Surface
) -> None:
    """A flat band from a to b, seen from both sides."""
    across = (wide, 0.0, 0.0) if abs(a[2] - b[2]) > abs(a[0] - b[0]) else (0.0, 0.0, wide)
    corners = [
        (a[0] - across[0] / 2, a[1], a[2] - across[2] / 2),
        (a[0] + across[0] / 2, a[1], a[2] + across[2] / 2),
        (b[0] + across[0] / 2, b[1], b[2] + across[2] / 2),
        (b[0] - across[0] / 2, b[1], b[2] - across[2] / 2),
    ]
    f.quad(corners, surface)
    f.quad(corners[::-1], surface)
