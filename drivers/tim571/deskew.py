"""Taking a robot's own motion out of a scan: a revolution lasts 50 ms, in which a robot at 1 m/s moves 5 cm.

Pure geometry, vectorised over the beams. The twist is taken to be constant over the revolution.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


class Twist(NamedTuple):
    """Velocity of a body in its own frame, x forward, y to the left, counter-clockwise."""

    vx_mps: float
    vy_mps: float
    w_radps: float


def sensor_twist(
    v_mps: float, w_radps: float, x_m: float, y_m: float, yaw_rad: float = 0.0, upside_down: bool = False
) -> Twist:
    """The twist of a lidar mounted at x, y and yaw in the frame of a base that drives `v_mps` and turns `w_radps`.

    `upside_down` is a roll of 180 degrees: seen from the lidar, left and right are exchanged.
    """
    across, along = w_radps * x_m, v_mps - w_radps * y_m
    vx = math.cos(yaw_rad) * along + math.sin(yaw_rad) * across
    vy = math.cos(yaw_rad) * across - math.sin(yaw_rad) * along
    return Twist(vx, -vy, -w_radps) if upside_down else Twist(vx, vy, w_radps)


def deskew(ranges: Array, yaw: Array, offsets_s: Array, twist: Twist) -> NDArray[np.float64]:
    """Points (n, 2) in metres in the lidar's frame as it was at the scan's stamp; NaN where a range is NaN.

    `ranges` (n,) metres, `yaw` (n,) radians, `offsets_s` (n,) when each beam was measured, relative to the stamp;
    `twist` is the lidar's own (`sensor_twist`).
    """
    distance = ranges.astype(np.float64)
    x, y = distance * np.cos(yaw, dtype=np.float64), distance * np.sin(yaw, dtype=np.float64)
    turned = twist.w_radps * offsets_s.astype(np.float64)
    cos, sin = np.cos(turned), np.sin(turned)
    # Along an arc a body gets ahead by sin(turned)/w and aside by (1 - cos(turned))/w; sinc keeps both finite at w = 0.
    ahead = offsets_s * np.sinc(turned / np.pi)
    aside = offsets_s * turned / 2 * np.sinc(turned / (2 * np.pi)) ** 2
    moved_x = ahead * twist.vx_mps - aside * twist.vy_mps
    moved_y = aside * twist.vx_mps + ahead * twist.vy_mps
    return np.column_stack((cos * x - sin * y + moved_x, sin * x + cos * y + moved_y))
