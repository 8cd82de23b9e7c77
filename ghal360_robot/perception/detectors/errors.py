"""What can be wrong with a detector; every text is for the person at the robot."""

from __future__ import annotations

from ghal360_robot.errors import GhalError


class DetectorError(GhalError, RuntimeError):
    """A detector cannot be made or cannot work."""


class WeightsError(DetectorError, ValueError):
    """Weights are missing, damaged, or not of the network they are given to."""


class PictureError(DetectorError, ValueError):
    """A picture that no detector can search."""
