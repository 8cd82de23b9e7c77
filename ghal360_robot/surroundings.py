"""From a lidar scan to what is around the base, once per scan. Live, lockstep and replay call the same."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from calibration.mounting import LidarMount, beam_bearings, median_of_three
from ghal360_robot.messages import Surroundings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import LidarScan

    Floats = NDArray[np.float64]


def look_around(scan: LidarScan, mount: LidarMount) -> Surroundings:
    """The scan in the base frame: every range the median of itself and its neighbours, beams without one left out."""
    ranges = median_of_three(scan.ranges)
    bearings, directions = _rays(scan.yaw.tobytes(), mount)
    beam = np.flatnonzero(np.isfinite(ranges))
    points = ranges[beam, None].astype(np.float64) * directions[beam]
    points += (mount.x, mount.y)
    return Surroundings(scan.stamp_ns, points, beam, bearings, ranges, scan.ranges, (mount.x, mount.y))


@lru_cache(maxsize=4)
def _rays(yaw: bytes, mount: LidarMount) -> tuple[Floats, Floats]:
    """Bearings (n,) and unit vectors (n, 2) of the beams, which are the same in every scan of a lidar."""
    bearings = beam_bearings(np.frombuffer(yaw, np.float32), mount)
    directions = np.column_stack((np.cos(bearings), np.sin(bearings)))
    for shared in (bearings, directions):
        shared.setflags(write=False)
    return bearings, directions
