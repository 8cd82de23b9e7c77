"""Procedural textures of materials, and the list of all textures: power-of-two pictures, the same for the same seed.

Colours obey the paint rule: what is not a detectable thing stays pale (see `paint`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.simulation import picture_textures, screen_textures, ware_textures
from ghal360_robot.simulation.pixels import noise, tinted

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    Picture = NDArray[np.float64]


def plain(_rng: Generator) -> Picture:
    return np.ones((8, 8, 3))


def plaster(rng: Generator) -> Picture:
    return tinted(1.0 + 0.012 * noise(rng, (128, 128), 0.6) + 0.010 * noise(rng, (128, 128), 1.6), (1.0, 1.0, 1.0))


def wood(rng: Generator) -> Picture:
    """Furniture wood, grain along u, in grey levels to be tinted."""
    grain = noise(rng, (256, 256), 0.9, 0.05)
    rings = np.sin(6.0 * noise(rng, (256, 256), 1.8, 0.15) + 3.0 * grain)
    return tinted(0.93 + 0.035 * noise(rng, (256, 256), 0.7, 0.03) + 0.025 * rings, (1.0, 1.0, 1.0))


def planks(rng: Generator) -> Picture:
    """Floor boards, 12 rows of 0.2 m in 2.4 m, joints staggered."""
    size, rows = 512, 12
    field = np.empty((size, size))
    edges = np.linspace(0, size, rows + 1).astype(int)
    grain = noise(rng, (size, size), 0.8, 0.04)
    for low, high in pairwise(edges):
        shift, cuts = int(rng.integers(size)), sorted(rng.choice(np.arange(2, 14), 2, replace=False) * (size // 16))
        row = np.empty((high - low, size))
        for a, b in zip((0, *cuts), (*cuts, size), strict=True):
            tone = 1.0 + 0.075 * float(rng.standard_normal())
            row[:, a:b] = tone + 0.04 * np.roll(grain, int(rng.integers(size)), axis=0)[low:high, a:b]
            row[:, a : a + 2] *= 0.72
        row[:2] *= 0.74
        field[low:high] = np.roll(row, shift, axis=1)
    return tinted(np.clip(field, 0.5, 1.18) / 1.18, (1.0, 1.0, 1.0))


def carpet(rng: Generator) -> Picture:
    field = 0.86 + 0.055 * noise(rng, (256, 256), 0.15) + 0.02 * noise(rng, (256, 256), 1.4)
    return tinted(field, (1.0, 1.0, 1.0))


def tiles(rng: Generator) -> Picture:
    """Square floor or wall tiles, 4 x 4 per repeat."""
    size, count = 512, 4
    step = size // count
    field = np.repeat(np.repeat(1.0 + 0.025 * rng.standard_normal((count, count)), step, 0), step, 1)
    field += 0.012 * noise(rng, (size, size), 1.2)
    along = np.arange(size) % step
    grout = (along < 3).astype(float)
    field *= 1 - 0.22 * np.maximum(grout[:, None], grout[None, :])
    return tinted(np.clip(field * 0.94, 0, 1), (1.0, 1.0, 1.0))


def ceiling(rng: Generator) -> Picture:
    """Mineral fibre panels, 2 x 2 per repeat, in a thin metal grid."""
    size = 512
    field = 0.95 - 0.05 * (rng.random((size, size)) > 0.93) + 0.012 * noise(rng, (size, size), 0.5)
    line = (np.arange(size) % (size // 2)) < 5
    field[line], field[:, line] = 0.83, 0.83
    return tinted(field, (1.0, 1.0, 0.99))


def fabric(rng: Generator) -> Picture:
    size = 128
    u = np.arange(size)
    weave = np.sin(u[:, None] * math.tau / 4) * np.sin(u[None, :] * math.tau / 4)
    field = 0.90 + 0.04 * weave + 0.035 * noise(rng, (size, size), 0.4) + 0.02 * noise(rng, (size, size), 1.5)
    return tinted(field, (1.0, 1.0, 1.0))


def stone(rng: Generator) -> Picture:
    speckle = noise(rng, (256, 256), 0.3)
    return tinted(0.85 + 0.05 * speckle + 0.05 * noise(rng, (256, 256), 1.3), (0.98, 0.97, 0.95))


def steel(rng: Generator) -> Picture:
    return tinted(0.93 + 0.014 * noise(rng, (128, 128), 0.7, 0.03), (0.97, 0.99, 1.0))


def canvas(rng: Generator) -> Picture:
    """Strong cloth of bags and leaves, brightness only."""
    field = 0.93 + 0.05 * noise(rng, (128, 128), 0.3) + 0.04 * noise(rng, (128, 128), 1.5)
    return tinted(np.clip(field, 0, 1), (1.0, 1.0, 1.0))


def shadow(_rng: Generator) -> Picture:
    """Alpha of a soft rectangle: what light a thing takes from the floor around it (RGBA)."""
    ramp = np.clip(1.0 - np.abs(np.linspace(-1, 1, 64)), 0, 1)
    side = np.clip(ramp / 0.36, 0, 1) ** 2 * (3 - 2 * np.clip(ramp / 0.36, 0, 1))
    alpha = side[:, None] * side[None, :]
    return np.dstack((np.zeros((64, 64, 3)), alpha))


def spot(_rng: Generator) -> Picture:
    """Alpha of a soft disc (RGBA)."""
    along = np.linspace(-1, 1, 64)
    radius = np.hypot(along[:, None], along[None, :])
    soft = np.clip((1.0 - radius) / 0.45, 0, 1)
    return np.dstack((np.zeros((64, 64, 3)), soft * soft * (3 - 2 * soft)))


MAKERS: dict[str, Callable[[Generator], Picture]] = {
    "plain": plain,
    "plaster": plaster,
    "wood": wood,
    "planks": planks,
    "carpet": carpet,
    "tiles": tiles,
    "ceiling": ceiling,
    "fabric": fabric,
    "stone": stone,
    "steel": steel,
    "books 0": picture_textures.books,
    "books 1": picture_textures.books,
    "books 2": picture_textures.books,
    "landscape": picture_textures.landscape,
    "skyline": picture_textures.skyline,
    "door": picture_textures.door,
    "painting 0": picture_textures.painting,
    "painting 1": picture_textures.painting,
    "painting 2": picture_textures.painting,
    "scenery": picture_textures.scenery,
    "whiteboard": picture_textures.whiteboard,
    "desktop 0": picture_textures.desktop,
    "desktop 1": picture_textures.desktop,
    "television": picture_textures.television,
    "laptop screen": picture_textures.laptop_screen,
    "laptop lid": picture_textures.laptop_lid,
    "keys": picture_textures.keys,
    "clock": picture_textures.clock,
    "rug": picture_textures.rug,
    "canvas": canvas,
    "print 0": picture_textures.watercolour,
    "print 1": picture_textures.leaf_print,
    "print 2": picture_textures.poster,
    "pinboard": picture_textures.pinboard,
    "programme 0": screen_textures.television(screen_textures.news),
    "programme 1": screen_textures.television(screen_textures.sports_news),
    "programme 2": screen_textures.television(screen_textures.reef),
    "programme 3": screen_textures.television(screen_textures.travel),
    "laptop 0": screen_textures.laptop(screen_textures.letter),
    "laptop 1": screen_textures.laptop(screen_textures.browser),
    "laptop 2": screen_textures.laptop(screen_textures.editor),
    "laptop deck": screen_textures.laptop_deck,
    "glass": ware_textures.glass,
    "wine 0": ware_textures.wine,
    "wine 1": ware_textures.wine,
    "water 0": ware_textures.water,
    "water 1": ware_textures.water,
    "label": ware_textures.label,
    "bag": ware_textures.bag,
    "bag pocket": ware_textures.pocket,
    "shadow": shadow,
    "spot": spot,
}


def make_texture(name: str, seed: int) -> NDArray[np.uint8]:
    """The texture (h, w, 3 or 4) RGB(A), first row on top."""
    rng = np.random.default_rng([seed, *name.encode()])
    return np.round(np.clip(MAKERS[name](rng), 0.0, 1.0) * 255).astype(np.uint8)
