"""What is on natural screens: television programmes and laptop desktops."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.simulation.pixels import blend, filled, hsv, noise

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    from ghal360_robot.simulation.pixels import Rgb

    Picture = NDArray[np.float64]
    Painter = Callable[[Generator], Picture]

WIDE = (256, 512)
"""Height and width of a television's front; powers of two, stretched to the screen's own shape."""
DESKTOP = (256, 256)
BLACK: Rgb = (0.035, 0.035, 0.04)


def framed(picture: Picture, sides: int, above: int, below: int) -> Picture:
    """The picture shrunk into the black frame of its screen, whose borders are given in texels."""
    height, width = picture.shape[:2]
    screen = filled((height, width), BLACK)
    inner = (width - 2 * sides, height - above - below)
    screen[above : height - below, sides : width - sides] = _small(picture, *inner)
    return screen


def _small(picture: Picture, width: int, height: int) -> Picture:
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA).astype(np.float64, copy=False)


def television(programme: Painter) -> Painter:
    """A television's whole front: its frame, wider below, around a programme."""
    return lambda rng: framed(programme(rng), 14, 14, 22)


def laptop(desktop: Painter) -> Painter:
    """The inner side of a laptop's lid around what its screen shows."""
    return lambda rng: framed(desktop(rng), 9, 10, 18)


def news(rng: Generator) -> Picture:
    """A news channel: a studio with a weather map, headline and ticker."""
    panel = filled((132, 236), hsv(205, 0.55, 0.72))
    blend(panel, (noise(rng, (132, 236), 1.6) > 0.2).astype(float), hsv(95, 0.45, 0.58))
    blend(panel, np.clip(noise(rng, (132, 236), 1.5, 0.5) - 0.6, 0, 1), (1.0, 1.0, 1.0))
    return _captions(_shown(_studio(), panel, int(rng.integers(24, 230)), 24), rng)


def sports_news(rng: Generator) -> Picture:
    """A sports channel: the studio, goals of a match beside it, headline and ticker."""
    return _captions(_shown(_studio(), _small(match(rng), 272, 144), int(rng.integers(24, 200)), 20), rng)


def reef(rng: Generator) -> Picture:
    """A film under water with a caption: blue depth, corals in warm colours and a shoal of fish."""
    return _captions(underwater(rng), rng)


def travel(rng: Generator) -> Picture:
    """A travel programme: a lake between mountains shown in the studio."""
    return _captions(_shown(_studio(), _small(mountains(rng), 300, 150), int(rng.integers(24, 180)), 18), rng)


def _studio() -> Picture:
    height, width = WIDE
    u, v = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    picture = filled(WIDE, hsv(220, 0.85, 0.34))
    blend(picture, np.exp(-(((u - 0.3) / 0.3) ** 2) - ((v - 0.35) / 0.4) ** 2), hsv(205, 0.75, 0.85))
    return picture


def _shown(picture: Picture, panel: Picture, left: int, top: int) -> Picture:
    height, width = panel.shape[:2]
    picture[top : top + height, left : left + width] = panel
    cv2.rectangle(picture, (left, top), (left + width, top + height), (0.92, 0.94, 0.97), 3)
    return picture


def _captions(picture: Picture, rng: Generator) -> Picture:
    """The channel's sign, a headline and a ticker."""
    height, width = WIDE
    accent = hsv(float(rng.choice((2.0, 28.0, 48.0, 180.0))), 0.9, 0.86)
    cv2.rectangle(picture, (0, 186), (width, 224), accent, -1)
    cv2.rectangle(picture, (0, 224), (width, height), (0.95, 0.95, 0.96), -1)
    for row, ink in ((205, (1.0, 1.0, 1.0)), (240, (0.12, 0.12, 0.16))):
        x = 20
        while x < width - 60:
            wide = int(rng.integers(20, 70))
            cv2.line(picture, (x, row), (x + wide, row), ink, 9)
            x += wide + 12
    cv2.rectangle(picture, (width - 78, 14), (width - 18, 38), accent, -1)
    return np.clip(picture, 0, 1)


def mountains(rng: Generator) -> Picture:
    """Sky, snow on mountains, woods and a lake that mirrors them."""
    height, width = WIDE
    v = np.linspace(0.0, 1.0, height)[:, None] * np.ones((1, width))
    picture = filled(WIDE, hsv(208, 0.62, 0.92))
    blend(picture, np.clip(v * 2.2, 0, 1), hsv(float(rng.uniform(25, 205)), 0.22, 0.98))
    blend(picture, np.clip(noise(rng, WIDE, 1.6, 0.4) - 0.3, 0, 1) * (v < 0.5), (1.0, 1.0, 1.0))
    shore = 0.62
    for base, tall, rough, colour in (
        (0.40, 0.13, 1.3, hsv(218, 0.42, 0.62)),
        (0.50, 0.06, 1.2, hsv(215, 0.48, 0.40)),
        (0.58, 0.025, 0.6, hsv(130, 0.60, 0.26)),
    ):
        ridge = base - tall * np.maximum(noise(rng, (1, width), rough)[0], -1.0)
        blend(picture, ((v > ridge) & (v < shore)).astype(float), colour)
        if base < 0.45:
            crumbled = ridge + 0.05 + 0.04 * noise(rng, WIDE, 1.0)
            blend(picture, 0.85 * ((v > ridge) & (v < crumbled)), (0.97, 0.98, 1.0))
    rows = np.clip((2 * shore - np.linspace(0, 1, height)) * (height - 1), 0, height - 1).round().astype(int)
    lake = np.linspace(0, 1, height) >= shore
    picture[lake] = picture[rows[lake]] * np.array((0.62, 0.78, 0.86))
    picture *= (1.0 + 0.05 * noise(rng, WIDE, 0.7, 0.1))[..., None]
    return np.clip(picture, 0, 1)


def match(rng: Generator) -> Picture:
    """A football match from the stand: mown stripes, lines, a crowd, small players and the score."""
    height, width = WIDE
    u, v = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    stripes = 0.5 + 0.5 * np.sign(np.sin((u - 0.5) / (0.35 + v) * 28))
    picture = filled(WIDE, hsv(112, 0.72, 0.50)) + 0.07 * stripes[..., None]
    crowd = 0.34 + 0.28 * rng.random(WIDE)
    blend(picture, (v < 0.28).astype(float), hsv(225, 0.45, 0.34))
    picture += ((v < 0.25) * (crowd - 0.45) * 0.9)[..., None] * np.array((1.0, 0.85, 0.8))
    cv2.rectangle(picture, (0, 72), (width, 82), hsv(float(rng.uniform(0, 360)), 0.8, 0.85), -1)
    white = (0.92, 0.95, 0.92)
    cv2.line(picture, (0, 96), (width, 96), white, 2, cv2.LINE_AA)
    cv2.line(picture, (256, 96), (int(rng.integers(216, 296)), height), white, 3, cv2.LINE_AA)
    cv2.ellipse(picture, (256, 168), (92, 34), 0, 0, 360, white, 2, cv2.LINE_AA)
    shirts = (hsv(float(rng.uniform(340, 380)) % 360, 0.9, 0.85), hsv(float(rng.uniform(200, 240)), 0.8, 0.9))
    for index in range(14):
        x, y = int(rng.integers(30, width - 30)), int(rng.integers(110, height - 30))
        tall = 8 + y // 16
        cv2.line(picture, (x, y + tall), (x + 3, y), shirts[index % 2], 5, cv2.LINE_AA)
        cv2.circle(picture, (x + 3, y - 3), 3, hsv(25, 0.5, 0.6), -1, cv2.LINE_AA)
    return np.clip(picture, 0, 1)


def underwater(rng: Generator) -> Picture:
    """Blue depth, corals in warm colours and a shoal of fish."""
    height, width = WIDE
    v = np.linspace(0.0, 1.0, height)[:, None] * np.ones((1, width))
    picture = filled(WIDE, hsv(198, 0.70, 0.88))
    blend(picture, np.clip(v * 1.3, 0, 1), hsv(216, 0.90, 0.38))
    for _ in range(26):
        at, axes = (
            (int(rng.integers(0, width)), int(rng.integers(190, 270))),
            (int(rng.integers(14, 46)), int(rng.integers(20, 70))),
        )
        colour = hsv(
            float(rng.choice((350, 12, 30, 45, 300))), float(rng.uniform(0.5, 0.85)), float(rng.uniform(0.5, 0.95))
        )
        cv2.ellipse(picture, at, axes, 0, 0, 360, colour, -1, cv2.LINE_AA)
    for _ in range(22):
        x, y, long = int(rng.integers(20, width - 20)), int(rng.integers(30, 170)), int(rng.integers(6, 15))
        colour = hsv(float(rng.choice((28, 45, 55, 205))), 0.8, 0.98)
        cv2.ellipse(picture, (x, y), (long, long // 2), 0, 0, 360, colour, -1, cv2.LINE_AA)
        tail = np.array([(x + long - 2, y), (x + 2 * long - 2, y - long // 2), (x + 2 * long - 2, y + long // 2)])
        cv2.fillConvexPoly(picture, tail, colour, cv2.LINE_AA)
    picture *= (1.0 + 0.10 * noise(rng, WIDE, 1.3))[..., None]
    return np.clip(picture, 0, 1)


def letter(rng: Generator) -> Picture:
    """A laptop's desktop with a page of text."""
    picture = _desktop(rng)
    left, top = int(rng.integers(50, 100)), int(rng.integers(24, 60))
    _window(picture, left, top, 136, 136)
    _text(picture, rng, left + 10, top + 26, 116, 104, (0.25, 0.26, 0.30))
    return picture


def browser(rng: Generator) -> Picture:
    """A laptop's desktop with a web page: a wide photograph over columns of text."""
    picture = _desktop(rng)
    left, top = int(rng.integers(46, 66)), int(rng.integers(14, 36))
    _window(picture, left, top, 176, 180)
    photo = mountains(rng) if rng.random() < 0.5 else underwater(rng)
    picture[top + 22 : top + 92, left + 10 : left + 166] = _small(photo, 156, 70)
    _text(picture, rng, left + 10, top + 104, 90, 66, (0.28, 0.29, 0.33))
    accent = hsv(float(rng.uniform(0, 360)), 0.65, 0.85)
    cv2.rectangle(picture, (left + 112, top + 102), (left + 164, top + 140), accent, -1)
    return picture


def editor(rng: Generator) -> Picture:
    """A laptop's desktop with a program text on dark ground, and a page beside it."""
    picture = _desktop(rng)
    left, top = int(rng.integers(44, 60)), int(rng.integers(20, 50))
    _window(picture, left + 70, top - 12, 120, 150)
    _text(picture, rng, left + 120, top + 12, 60, 110, (0.25, 0.26, 0.30))
    cv2.rectangle(picture, (left, top + 14), (left + 110, top + 150), (0.13, 0.14, 0.18), -1)
    for row in range(top + 26, top + 144, 9):
        x = left + 8 + 9 * int(rng.integers(0, 3))
        while x < left + 84:
            wide = int(rng.integers(8, 26))
            colour = hsv(float(rng.choice((30, 95, 190, 210, 285))), float(rng.uniform(0.1, 0.6)), 0.92)
            cv2.line(picture, (x, row), (x + wide, row), colour, 3)
            x += wide + int(rng.integers(6, 40))
    return picture


def _desktop(rng: Generator) -> Picture:
    """Waves of colour, icons, and the bar below."""
    height, width = DESKTOP
    u, v = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    hue = float(rng.choice((200, 207, 214, 221)))
    picture = filled(DESKTOP, hsv(hue, 0.75, 0.80))
    for index in range(4):
        edge = 0.25 + 0.2 * index + 0.10 * np.sin(u * 5 + float(rng.uniform(0, 6)))
        wave = hsv((hue + 18 * index) % 360, 0.7 - 0.1 * index, 0.55 + 0.13 * index)
        blend(picture, 0.7 * (v > edge).astype(float), wave)
    for row in range(5):
        _icon(picture, rng, 12, 16 + 40 * row, 22)
    cv2.rectangle(picture, (0, 238), (width, height), (0.10, 0.11, 0.14), -1)
    for column in range(7):
        _icon(picture, rng, 70 + 18 * column, 241, 12)
    return np.clip(picture, 0, 1)


def _icon(picture: Picture, rng: Generator, x: int, y: int, size: int) -> None:
    colour = hsv(float(rng.uniform(0, 360)), 0.65, 0.92)
    cv2.rectangle(picture, (x, y), (x + size, y + size), colour, -1)


def _window(picture: Picture, x: int, y: int, wide: int, tall: int) -> None:
    cv2.rectangle(picture, (x, y), (x + wide, y + tall), (0.97, 0.97, 0.98), -1)
    cv2.rectangle(picture, (x, y), (x + wide, y + 14), (0.80, 0.82, 0.85), -1)


def _text(picture: Picture, rng: Generator, x: int, y: int, wide: int, tall: int, ink: Rgb) -> None:
    for row in range(y, y + tall, 9):
        cv2.line(picture, (x, row), (x + int(wide * rng.uniform(0.5, 1.0)), row), ink, 2)


def laptop_deck(_rng: Generator) -> Picture:
    """A laptop's deck from above, hinge on top, to be tinted: keys in a dark well, a touch pad in front."""
    height, width = 128, 256
    picture = filled((height, width), (1.0, 1.0, 1.0))
    cv2.rectangle(picture, (14, 8), (241, 76), (0.20, 0.20, 0.21), -1)
    for row in range(5):
        column = 17
        while column < 236:
            wide = 18 if row and column == 17 else 13
            if row == 4 and 78 < column < 100:
                wide = 76
            right = min(column + wide, 238)
            cv2.rectangle(picture, (column, 11 + 13 * row), (right, 20 + 13 * row), (0.055, 0.055, 0.06), -1)
            cv2.line(picture, (column + 3, 14 + 13 * row), (column + 6, 14 + 13 * row), (0.62, 0.62, 0.64), 2)
            column = right + 3
    cv2.rectangle(picture, (90, 84), (166, 122), (0.86, 0.86, 0.87), -1)
    cv2.rectangle(picture, (90, 84), (166, 122), (0.70, 0.70, 0.71), 1)
    return picture
