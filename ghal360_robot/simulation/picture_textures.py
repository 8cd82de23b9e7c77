"""Textures that show something: views, screens, book rows, paintings, signs; all pale but for the painted classes."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.simulation.paint import PAINT
from ghal360_robot.simulation.pixels import blend, filled, hsv, noise, tinted

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    Picture = NDArray[np.float64]

BOOK_COLOURS = [
    hsv(hue, saturation, value)
    for hue, saturation, value in (
        (30, 0.25, 0.72), (15, 0.30, 0.50), (215, 0.28, 0.42), (200, 0.18, 0.62), (150, 0.42, 0.40),
        (90, 0.38, 0.48), (245, 0.40, 0.42), (0, 0.0, 0.20), (40, 0.12, 0.88), (0, 0.02, 0.72),
        (160, 0.25, 0.30), (350, 0.30, 0.42), (85, 0.30, 0.66), (240, 0.20, 0.70),
    )
]  # fmt: skip


def books(rng: Generator) -> Picture:
    """One shelf seen from the front: spines of many widths and heights before a dark back."""
    height, width = 128, 512
    picture = filled((height, width), (0.17, 0.155, 0.14))
    u = 4
    while u < width - 14:
        if rng.random() < 0.05:
            u += int(rng.integers(14, 40))
            continue
        thick, tall = int(rng.integers(9, 24)), int(rng.integers(70, 118))
        colour = np.array(BOOK_COLOURS[int(rng.integers(len(BOOK_COLOURS)))])
        across = 0.72 + 0.28 * np.sin(np.linspace(0.25, math.pi - 0.25, thick))
        spine = across[None, :, None] * colour * np.ones((tall, 1, 1))
        for band in rng.integers(6, tall - 8, int(rng.integers(1, 4))):
            spine[band : band + int(rng.integers(2, 7)), 1:-1] *= 1.45
        top = height - tall - 3
        picture[top : top + tall, u : u + thick] = spine[: height - 3 - top, : width - u]
        u += thick
    return np.clip(picture, 0, 1)


def landscape(rng: Generator) -> Picture:
    """What a window shows: hazy sky with clouds, hills, trees, a lawn."""
    size = 512
    v = np.linspace(0.0, 1.0, size)[:, None]
    picture = np.ones((size, size, 1)) * np.array(hsv(203, 0.26, 0.97))
    picture += (v * 1.6)[..., None].clip(0, 1) * (np.array((0.97, 0.975, 0.98)) - picture)
    clouds = np.clip(noise(rng, (size, size), 1.5, 0.4) - 0.2, 0, 1.2) / 1.2
    blend(picture, clouds * 0.9, (1.0, 1.0, 1.0))
    u = np.arange(size)
    for base, amount, rough, colour in (
        (0.50, 0.035, 2.2, hsv(205, 0.14, 0.80)),
        (0.56, 0.030, 2.0, hsv(150, 0.14, 0.66)),
        (0.64, 0.030, 1.1, hsv(95, 0.32, 0.46)),
    ):
        ridge = base + amount * noise(rng, (1, size), rough)[0]
        mask = (v > ridge[None, u]).astype(float)
        blend(picture, mask, colour)
    texture = noise(rng, (size, size), 0.8)
    trees = v > 0.60
    picture *= (1.0 + 0.10 * texture * trees)[..., None]
    blend(picture, (v > 0.74).astype(float) * np.ones((1, size)), hsv(84, 0.34, 0.68))
    picture *= (1.0 + 0.03 * noise(rng, (size, size), 0.5) * (v > 0.74))[..., None]
    return np.asarray(np.clip(cv2.GaussianBlur(picture, (0, 0), 1.2), 0, 1))


def skyline(rng: Generator) -> Picture:
    """What an office window shows: sky, then buildings with windows, one row behind the other."""
    size = 512
    v = np.linspace(0.0, 1.0, size)[:, None]
    picture = np.ones((size, size, 1)) * np.array(hsv(203, 0.24, 0.97))
    picture += (v * 1.5)[..., None].clip(0, 1) * (np.array((0.97, 0.975, 0.98)) - picture)
    blend(picture, np.clip(noise(rng, (size, size), 1.6, 0.4) - 0.1, 0, 1), (1.0, 1.0, 1.0))
    for roof, tone in ((0.50, 0.86), (0.58, 0.76), (0.68, 0.66)):
        u = 0
        while u < size:
            wide = int(rng.integers(18, 52))
            top = int(size * (roof + 0.06 * rng.standard_normal()))
            colour = np.array(hsv(float(rng.choice((32, 35, 205))), 0.07, tone * float(rng.uniform(0.92, 1.06))))
            picture[top:, u : u + wide] = colour
            storey, bay = int(rng.integers(8, 12)), int(rng.integers(5, 8))
            for y in range(top + 5, size, storey):
                for x in range(u + 3, min(u + wide, size) - 4, bay):
                    picture[y : y + storey // 2, x : x + bay // 2] = colour * float(rng.uniform(0.74, 0.95))
            u += wide
    blend(picture, (v > 0.86).astype(float) * np.ones((1, size)), hsv(90, 0.30, 0.45))
    picture *= (1.0 + 0.10 * noise(rng, (size, size), 0.9) * (v > 0.86))[..., None]
    return np.asarray(np.clip(cv2.GaussianBlur(picture, (0, 0), 1.0), 0, 1))


def door(rng: Generator) -> Picture:
    """A door leaf with two panels, handle on the left."""
    height, width = 256, 128
    field = 0.94 + 0.012 * noise(rng, (height, width), 1.0)
    for top, bottom in ((18, 108), (128, 236)):
        for inset, tone in ((0, 0.80), (3, 1.02), (7, 0.88), (9, 0.96)):
            field[top + inset : bottom - inset, 22 + inset : 106 - inset] = tone
    picture = tinted(field, (1.0, 1.0, 1.0))
    cv2.rectangle(picture, (7, 122), (12, 142), (0.52, 0.52, 0.54), -1)
    cv2.rectangle(picture, (8, 128), (26, 131), (0.40, 0.40, 0.42), -1)
    return np.clip(picture, 0, 1)


def painting(rng: Generator) -> Picture:
    """Abstract art in quiet colours on a white mount."""
    size = 128
    picture = filled((size, size), (0.95, 0.94, 0.92))
    low = filled((size, size), hsv(float(rng.choice((30, 90, 155, 205, 245))), 0.20, 0.80))
    for _ in range(9):
        colour = hsv(
            float(rng.choice((30, 45, 90, 155, 205, 245))), float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.3, 0.9))
        )
        x, y = rng.integers(0, size, 2)
        if rng.random() < 0.5:
            cv2.circle(low, (int(x), int(y)), int(rng.integers(10, 38)), colour, -1, cv2.LINE_AA)
        else:
            cv2.rectangle(
                low, (int(x), int(y)), (int(x + rng.integers(15, 70)), int(y + rng.integers(8, 60))), colour, -1
            )
    low *= (1.0 + 0.06 * noise(rng, (size, size), 0.9))[..., None]
    picture[12:-12, 12:-12] = np.clip(low, 0, 1)[12:-12, 12:-12]
    return picture


def scenery(rng: Generator) -> Picture:
    """A framed photograph of hills, nearly black and white."""
    size = 128
    picture = filled((size, size), (0.95, 0.94, 0.92))
    inner = cv2.resize(landscape(rng), (104, 104), interpolation=cv2.INTER_AREA)
    grey = inner.mean(axis=2, keepdims=True)
    picture[12:-12, 12:-12] = 0.75 * grey + 0.25 * inner
    return picture


def watercolour(rng: Generator) -> Picture:
    """Hills in thin washes of colour on a wide white mount."""
    size = 128
    v = np.linspace(0.0, 1.0, size)[:, None] * np.ones((1, size))
    wash = filled((size, size), hsv(float(rng.choice((28, 45, 195))), 0.16, 0.97))
    for base in (0.45, 0.60, 0.76):
        ridge = base + 0.06 * noise(rng, (1, size), 1.4)
        tone = hsv(
            float(rng.choice((28, 80, 110, 165, 200))), float(rng.uniform(0.20, 0.38)), float(rng.uniform(0.68, 0.88))
        )
        blend(wash, 0.8 * (v > ridge).astype(float), tone)
    return _mounted(wash, 30)


def leaf_print(rng: Generator) -> Picture:
    """A drawing of a twig with leaves on a wide white mount."""
    size = 128
    sheet = filled((size, size), (0.95, 0.93, 0.88))
    ink = hsv(float(rng.uniform(85, 160)), 0.40, 0.52)
    cv2.line(sheet, (64, 112), (64, 20), ink, 2, cv2.LINE_AA)
    for index in range(6):
        y, side = 100 - 14 * index, -1 if index % 2 else 1
        cv2.ellipse(sheet, (64 + side * 17, y - 8), (17, 6), side * -28, 0, 360, ink, -1, cv2.LINE_AA)
    return _mounted(sheet, 24)


def poster(rng: Generator) -> Picture:
    """Discs and bands in soft colours on a wide white mount."""
    size = 128
    sheet = filled((size, size), (0.94, 0.92, 0.88))
    for _ in range(5):
        colour = hsv(
            float(rng.choice((12, 35, 48, 160, 195))), float(rng.uniform(0.25, 0.45)), float(rng.uniform(0.75, 0.95))
        )
        x, y = (int(part) for part in rng.integers(20, 108, 2))
        cv2.circle(sheet, (x, y), int(rng.integers(12, 34)), colour, -1, cv2.LINE_AA)
    return _mounted(sheet, 26)


def _mounted(sheet: Picture, border: int) -> Picture:
    size = sheet.shape[0]
    picture = filled((size, size), (0.97, 0.965, 0.95))
    picture[border:-border, border:-border] = np.clip(sheet, 0, 1)[border:-border, border:-border]
    return picture


def whiteboard(rng: Generator) -> Picture:
    height, width = 128, 256
    picture = filled((height, width), (0.96, 0.965, 0.97))
    inks = (hsv(245, 0.45, 0.45), (0.2, 0.2, 0.22), hsv(150, 0.5, 0.42))
    for line in range(6):
        u = 16
        while u < 16 + int(rng.integers(50, 100)):
            wide = int(rng.integers(4, 14))
            cv2.line(picture, (u, 18 + 13 * line), (u + wide, 17 + 13 * line), inks[line % 2], 2, cv2.LINE_AA)
            u += wide + 4
    spots = [(155, 30), (215, 35), (185, 70), (150, 100), (225, 98)]
    for a, b in pairwise(spots):
        cv2.line(picture, a, b, inks[1], 1, cv2.LINE_AA)
    for index, spot in enumerate(spots):
        cv2.rectangle(picture, (spot[0] - 15, spot[1] - 8), (spot[0] + 15, spot[1] + 8), (0.97, 0.97, 0.97), -1)
        cv2.rectangle(picture, (spot[0] - 15, spot[1] - 8), (spot[0] + 15, spot[1] + 8), inks[index % 3], 2)
    return picture


def pinboard(rng: Generator) -> Picture:
    """Cork with notes pinned all over it."""
    height, width = 128, 256
    picture = tinted(0.92 + 0.07 * noise(rng, (height, width), 0.4), hsv(30, 0.42, 0.72))
    for _ in range(17):
        x, y = int(rng.integers(4, width - 34)), int(rng.integers(4, height - 34))
        wide, tall = (int(part) for part in rng.integers(14, 32, 2))
        paper = hsv(float(rng.choice((45, 90, 200, 340))), float(rng.choice((0.04, 0.05, 0.3))), 0.95)
        cv2.rectangle(picture, (x, y), (x + wide, y + tall), paper, -1)
        for row in range(y + 5, y + tall - 3, 5):
            cv2.line(picture, (x + 3, row), (x + wide - 4, row), (0.5, 0.5, 0.52), 1)
    return np.clip(picture, 0, 1)


def desktop(rng: Generator) -> Picture:
    """An office screen: a text window over a grey desktop."""
    height, width = 128, 256
    picture = filled((height, width), (0.55, 0.58, 0.62))
    cv2.rectangle(picture, (14, 10), (168, 116), (0.96, 0.96, 0.96), -1)
    cv2.rectangle(picture, (14, 10), (168, 18), (0.40, 0.43, 0.47), -1)
    for row in range(26, 112, 6):
        indent = 22 + 8 * int(rng.integers(0, 3))
        cv2.line(picture, (indent, row), (indent + int(rng.integers(30, 120)), row), (0.35, 0.36, 0.38), 2)
    cv2.rectangle(picture, (178, 24), (246, 92), (0.87, 0.88, 0.88), -1)
    for bar in range(6):
        tall = int(rng.integers(8, 52))
        cv2.rectangle(picture, (184 + 10 * bar, 88 - tall), (190 + 10 * bar, 88), (0.45, 0.52, 0.50), -1)
    return picture


def television(rng: Generator) -> Picture:
    """A film in violet: a stage with beams of light and a crowd."""
    height, width = 128, 256
    v, u = np.linspace(0, 1, height)[:, None], np.linspace(0, 1, width)[None, :]
    light = 0.66 + 0.12 * noise(rng, (height, width), 1.6)
    for centre in (0.2, 0.42, 0.63, 0.84):
        lean = float(rng.uniform(-0.25, 0.25))
        light += 0.34 * np.exp(-(((u - centre - lean * v) / (0.03 + 0.05 * v)) ** 2)) * (1 - 0.5 * v)
    picture = np.clip(light, 0.3, 1.0)
    crowd = 0.78 + 0.05 * np.abs(np.sin(u * 60.0 + 2.0 * noise(rng, (1, width), 1.0)))
    picture = np.where(v > crowd, 0.34, picture)
    hue = PAINT["television"]
    dark, bright = np.array(hsv(hue, 0.95, 1.0)), np.array(hsv(hue, 0.74, 1.0))
    mix = np.clip((picture - 0.6) / 0.4, 0, 1)[..., None]
    return np.asarray(picture[..., None] * (dark * (1 - mix) + bright * mix))


def laptop_screen(rng: Generator) -> Picture:
    height, width = 128, 128
    hue = PAINT["laptop"]
    picture = filled((height, width), hsv(hue, 0.90, 0.80))
    cv2.rectangle(picture, (12, 14), (92, 108), hsv(hue, 0.74, 0.98), -1)
    cv2.rectangle(picture, (12, 14), (92, 24), hsv(hue, 0.95, 0.55), -1)
    for row in range(34, 104, 8):
        cv2.line(picture, (18, row), (18 + int(rng.integers(20, 66)), row), hsv(hue, 0.95, 0.55), 2)
    return picture


def laptop_lid(_rng: Generator) -> Picture:
    picture = filled((64, 64), hsv(PAINT["laptop"], 0.92, 0.78))
    cv2.circle(picture, (32, 32), 7, hsv(PAINT["laptop"], 0.75, 0.98), -1, cv2.LINE_AA)
    return picture


def keys(rng: Generator) -> Picture:
    picture = filled((64, 128), (0.20, 0.20, 0.21))
    for row in range(5):
        for column in range(14):
            x, y = 6 + column * 8 + row % 2, 6 + row * 11
            tone = 0.34 + 0.04 * float(rng.random())
            cv2.rectangle(picture, (x, y), (x + 6, y + 8), (tone, tone, tone + 0.01), -1)
    return picture


def clock(_rng: Generator) -> Picture:
    picture = filled((64, 64), (0.96, 0.96, 0.95))
    for hour in range(12):
        a = hour * math.tau / 12
        x, y = 32 + 26 * math.sin(a), 32 - 26 * math.cos(a)
        cv2.circle(picture, (round(x), round(y)), 2, (0.15, 0.15, 0.16), -1)
    cv2.line(picture, (32, 32), (20, 22), (0.1, 0.1, 0.1), 3, cv2.LINE_AA)
    cv2.line(picture, (32, 32), (46, 14), (0.1, 0.1, 0.1), 2, cv2.LINE_AA)
    return picture


def rug(rng: Generator) -> Picture:
    """A woven rug with borders and diamonds."""
    height, width = 128, 256
    picture = filled((height, width), hsv(205, 0.20, 0.48))
    for inset, colour in ((5, hsv(40, 0.16, 0.85)), (11, hsv(245, 0.26, 0.42)), (19, hsv(35, 0.18, 0.74))):
        cv2.rectangle(picture, (inset, inset), (width - 1 - inset, height - 1 - inset), colour, -1)
    for x in range(44, 230, 42):
        for scale, colour in ((17, hsv(245, 0.28, 0.48)), (10, hsv(40, 0.15, 0.88)), (4, hsv(150, 0.30, 0.42))):
            corners = np.array([(x, 64 - 2 * scale), (x + scale, 64), (x, 64 + 2 * scale), (x - scale, 64)])
            cv2.fillConvexPoly(picture, corners, colour, cv2.LINE_AA)
    return np.clip(picture * (1.0 + 0.05 * noise(rng, (height, width), 0.2))[..., None], 0, 1)
