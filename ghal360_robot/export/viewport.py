"""A flat picture of what lies in one direction, cut out of the panorama (gnomonic projection). Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.perception.sphere import PictureSize, direction_of_vector, pixel_of_direction

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import HeadPose

MAX_FOV = math.radians(140)
"""Wider flat pictures are mostly stretched edge."""


@dataclass(frozen=True, slots=True)
class ViewportSize:
    width: int
    height: int


def viewport(
    panorama: NDArray[np.uint8], head: HeadPose, size: ViewportSize, camera_yaw: float = 0.0
) -> NDArray[np.uint8]:
    """The view (height, width, 3) along `head`, whose field of view is the horizontal one."""
    source = PictureSize(panorama.shape[1], panorama.shape[0])
    yaw, pitch = _directions(size, min(head.fov, MAX_FOV), head.pitch)
    u, v = pixel_of_direction(yaw + head.yaw, pitch, source, camera_yaw)
    # Pixel centres lie at half numbers; one column of the other edge closes the seam.
    wide = cv2.copyMakeBorder(panorama, 0, 0, 1, 1, cv2.BORDER_WRAP)
    x, y = (u + 0.5).astype(np.float32), np.clip(v - 0.5, 0, source.height - 1).astype(np.float32)
    return np.asarray(cv2.remap(wide, x, y, cv2.INTER_LINEAR), np.uint8)


@lru_cache(maxsize=4)
def _directions(size: ViewportSize, fov: float, pitch: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Yaw from the view's own and pitch of every pixel; a head that only turns needs them once."""
    half_width = math.tan(fov / 2)
    across = (np.arange(size.width) + 0.5) / size.width * 2 - 1
    down = (np.arange(size.height) + 0.5) / size.height * 2 - 1
    left, up = np.meshgrid(-across * half_width, -down * half_width * size.height / size.width)
    forward, above = math.cos(pitch) - up * math.sin(pitch), math.sin(pitch) + up * math.cos(pitch)
    return direction_of_vector(np.stack((forward, left, above), axis=-1))
