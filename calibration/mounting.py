"""Mounting transforms of lidar and camera in the base frame (REP-103: x forward, y left, z up).

The base frame's origin is the midpoint between the driven wheels, on the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class LidarMount:
    """Pose of the lidar's scan plane. `upside_down` mirrors the scan (roll of 180 deg)."""

    x: float = 0.20
    y: float = 0.0
    z: float = 0.25
    yaw: float = 0.0
    upside_down: bool = False


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Position of the camera's centre; `yaw` is where the picture's centre column looks in the base frame."""

    x: float = 0.0
    y: float = 0.0
    z: float = 1.20
    yaw: float = 0.0


def scan_points(ranges: NDArray[np.float32], yaw: NDArray[np.float32], mount: LidarMount) -> NDArray[np.float64]:
    """Valid beams as points (m, 2) in the base frame, metres.

    `ranges` (n,) metres with NaN where nothing was seen, `yaw` (n,) radians in the lidar frame.
    """
    valid = np.isfinite(ranges)
    distance = ranges[valid].astype(np.float64)
    sign = -1.0 if mount.upside_down else 1.0
    bearing = mount.yaw + sign * yaw[valid].astype(np.float64)
    return np.column_stack((mount.x + distance * np.cos(bearing), mount.y + distance * np.sin(bearing)))


def wrap(angle: float) -> float:
    """The same direction in (-pi, pi]."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped
