"""Skins of natural things: glass with its highlights, bottle labels, the sewn panels of a bag."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.simulation.pixels import filled, hsv, noise, tinted

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    Picture = NDArray[np.float64]


def glass(rng: Generator) -> Picture:
    """Light around something round and smooth (u is the angle), to be tinted."""
    return tinted(0.55 + 0.45 * np.clip(_gleams(rng), 0, 1), (1.0, 1.0, 1.0))


def wine(rng: Generator) -> Picture:
    """A bottle of dark green or brown glass: windows gleam in it."""
    colour = [(0.08, 0.20, 0.10), (0.20, 0.10, 0.04), (0.05, 0.11, 0.07)][int(rng.integers(3))]
    picture = filled((64, 128), colour)
    picture += 0.75 * _gleams(rng)[..., None] * np.array((0.9, 1.0, 0.95))
    return np.clip(picture, 0, 1)


def water(rng: Generator) -> Picture:
    """A bottle of clear plastic: paler in the middle of each side, with rings pressed into it."""
    colour = [(0.58, 0.78, 0.90), (0.45, 0.68, 0.92), (0.64, 0.84, 0.76)][int(rng.integers(3))]
    picture = filled((64, 128), colour)
    picture *= (0.86 + 0.14 * np.sin(np.linspace(0, 6 * np.pi, 64)))[:, None, None]
    picture += 0.55 * _gleams(rng)[..., None]
    return np.clip(picture, 0, 1)


def _gleams(rng: Generator) -> Picture:
    """Upright streaks of reflected windows (64, 128), 0..1."""
    u = np.linspace(0, 1, 128, endpoint=False)[None, :] * np.ones((64, 1))
    field = 0.10 + 0.10 * np.sin(u * 6 * np.pi + float(rng.uniform(0, 6)))
    for centre in np.arange(5) / 5 + rng.uniform(-0.06, 0.06, 5):
        away = np.abs((u - centre + 0.5) % 1.0 - 0.5)
        field += float(rng.uniform(0.5, 1.0)) * np.exp(-((away / float(rng.uniform(0.012, 0.025))) ** 2))
    return np.clip(field, 0, 1)


def label(rng: Generator) -> Picture:
    """A bottle's paper label, three times around: a frame, a crest, a name and small print."""
    height, width = 128, 256
    ground = [(0.93, 0.90, 0.82), (0.96, 0.96, 0.95), hsv(float(rng.uniform(0, 360)), 0.75, 0.70)][int(rng.integers(3))]
    ink = hsv(float(rng.choice((0, 15, 210, 130, 45))), 0.8, 0.35) if sum(ground) > 2.2 else (0.97, 0.96, 0.92)
    picture = filled((height, width), ground)
    accent = hsv(float(rng.choice((0, 40, 210, 140))), 0.8, 0.7)
    for left in (0, width // 2):
        centre = left + width // 4
        cv2.circle(picture, (centre, 34), 18, accent, -1, cv2.LINE_AA)
        cv2.line(picture, (centre - 40, 70), (centre + 40, 70), ink, 12)
        cv2.line(picture, (centre - 28, 88), (centre + 28, 88), ink, 5)
        cv2.line(picture, (centre - 34, 102), (centre + 34, 102), ink, 3)
    for row in (4, height - 6):
        cv2.line(picture, (0, row), (width, row), accent, 5)
    return picture


def bag(rng: Generator) -> Picture:
    """A backpack's cloth unrolled (front in the middle, top above), in greys to be tinted: seams, zips, folds."""
    size = 256
    v, u = np.mgrid[0:size, 0:size] / size
    field = 0.80 + 0.05 * noise(rng, (size, size), 0.4) + 0.07 * noise(rng, (size, size), 1.7)
    # Cloth sags: shallow folds that run across, stronger below.
    field += 0.05 * np.sin(v * 30 + 3 * np.sin(u * 9 + float(rng.uniform(0, 6)))) * v
    field *= 0.78 + 0.30 * (1 - v)
    picture = tinted(np.clip(field, 0, 1), (1.0, 1.0, 1.0))
    dark, bright = (0.16, 0.16, 0.17), (1.0, 1.0, 1.0)
    cv2.ellipse(picture, (128, 96), (56, 74), 0, 180, 360, dark, 3, cv2.LINE_AA)
    cv2.line(picture, (72, 96), (72, 250), dark, 3, cv2.LINE_AA)
    cv2.line(picture, (184, 96), (184, 250), dark, 3, cv2.LINE_AA)
    cv2.line(picture, (70, 94), (70, 250), bright, 1, cv2.LINE_AA)
    cv2.line(picture, (186, 94), (186, 250), bright, 1, cv2.LINE_AA)
    return np.clip(picture, 0, 1)


def pocket(rng: Generator) -> Picture:
    """A bag's front pocket unrolled (front in the middle), in greys to be tinted: a zip in an arch, a patch."""
    size = 128
    v = np.mgrid[0:size, 0:size][0] / size
    field = (0.84 + 0.05 * noise(rng, (size, size), 0.4) + 0.06 * noise(rng, (size, size), 1.6)) * (1.02 - 0.28 * v)
    picture = tinted(np.clip(field, 0, 1), (1.0, 1.0, 1.0))
    cv2.line(picture, (26, 30), (102, 30), (0.12, 0.12, 0.13), 4, cv2.LINE_AA)
    cv2.line(picture, (26, 34), (102, 34), (0.95, 0.95, 0.95), 1, cv2.LINE_AA)
    cv2.line(picture, (98, 31), (102, 46), (0.75, 0.75, 0.76), 3, cv2.LINE_AA)
    cv2.rectangle(picture, (52, 56), (76, 72), (1.0, 1.0, 1.0), -1)
    cv2.rectangle(picture, (55, 60), (73, 68), (0.25, 0.25, 0.27), -1)
    return np.clip(picture, 0, 1)
