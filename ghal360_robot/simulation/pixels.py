"""Colours and noise that all procedural textures are made from."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.random import Generator
    from numpy.typing import NDArray

    Picture = NDArray[np.float64]

Rgb = tuple[float, float, float]


def hsv(hue: float, saturation: float, value: float) -> Rgb:
    """RGB in 0..1 of a hue in degrees."""
    sector = hue / 60.0
    chroma = value * saturation
    middle = chroma * (1 - abs(sector % 2 - 1))
    low = value - chroma
    r, g, b = [
        (chroma, middle, 0.0),
        (middle, chroma, 0.0),
        (0.0, chroma, middle),
        (0.0, middle, chroma),
        (middle, 0.0, chroma),
        (chroma, 0.0, middle),
    ][int(sector) % 6]
    return r + low, g + low, b + low


def noise(rng: Generator, shape: tuple[int, int], rough: float, stretch: float = 1.0) -> Picture:
    """Tileable noise of mean 0 and deviation 1; larger `rough` is smoother, `stretch` below 1 draws it out along u."""
    fy, fx = np.fft.fftfreq(shape[0])[:, None] * stretch, np.fft.fftfreq(shape[1])[None, :]
    radius = np.hypot(fx, fy)
    radius[0, 0] = np.inf
    spectrum = np.fft.fft2(rng.standard_normal(shape)) * radius**-rough
    field = np.real(np.fft.ifft2(spectrum))
    return np.asarray(field / field.std())


def tinted(field: Picture, colour: Rgb) -> Picture:
    """A brightness field (h, w) in one colour."""
    return np.asarray(field[..., None] * np.array(colour))


def filled(shape: tuple[int, int], colour: Rgb) -> Picture:
    return tinted(np.ones(shape), colour)


def blend(picture: Picture, mask: Picture, colour: Rgb) -> None:
    """Mix a colour into a picture in place by a mask of 0..1."""
    picture += mask[..., None] * (np.array(colour) - picture)
