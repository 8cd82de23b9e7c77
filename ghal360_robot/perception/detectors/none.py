"""No detector: the robot drives and streams without finding anything."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.base import PixelDetection


class NoDetector:
    """Knows no class and finds nothing."""

    name = "none"
    class_names: tuple[str, ...] = ()

    def warm_up(self) -> None:
        """Nothing to prepare."""

    def detect(self, rgb: NDArray[np.uint8]) -> list[PixelDetection]:
        return []
