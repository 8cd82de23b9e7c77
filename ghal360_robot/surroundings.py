"""From a lidar scan to what is around the base, once per scan. Live, lockstep and replay call the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibration.mounting import beam_bearings, median_of_three
from ghal360_robot.messages import Surroundings

if TYPE_CHECKING:
    from calibration.mounting import LidarMount
    from ghal360_robot.messages import LidarScan


def look_around(scan: LidarScan, mount: LidarMount) -> Surroundings:
    """The scan in the base frame: every range the median of itself and its neighbours, beams without one left out."""
    ranges = median_of_three(scan.ranges)
    bearings = beam_bearings(scan.yaw, mount)
    beam = np.flatnonzero(np.isfinite(ranges))
    distance, bearing = ranges[beam].astype(np.float64), bearings[beam]
    points = np.column_stack((mount.x + distance * np.cos(bearing), mount.y + distance * np.sin(bearing)))
    return Surroundings(scan.stamp_ns, points, beam, bearings, ranges, scan.ranges, (mount.x, mount.y))
