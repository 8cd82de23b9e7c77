"""Where a direction lies in the equirectangular picture; only for drawing boxes over the video."""

from __future__ import annotations

import math

WIDTH, HEIGHT = 1920, 960
PIXELS_PER_RADIAN = WIDTH / math.tau


def boxes(
    yaw: float, pitch: float, width: float, height: float, *, camera_yaw: float = 0.0
) -> list[tuple[float, float, float, float]]:
    """Boxes (centre x, centre y, half width, half height) in pixels; two where one crosses the seam.

    The picture's centre column looks along the camera's x axis, which is turned by `camera_yaw` in the
    base frame; yaw grows to the left, pitch upwards.
    """
    x = (WIDTH / 2 - (yaw - camera_yaw) * PIXELS_PER_RADIAN) % WIDTH
    y = HEIGHT / 2 - pitch * PIXELS_PER_RADIAN
    half = (width * PIXELS_PER_RADIAN / 2, height * PIXELS_PER_RADIAN / 2)
    drawn = [(x, y, *half)]
    if x < half[0]:
        drawn.append((x + WIDTH, y, *half))
    elif x + half[0] > WIDTH:
        drawn.append((x - WIDTH, y, *half))
    return drawn
