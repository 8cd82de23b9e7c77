"""From boxes in a picture to directions around the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ghal360_robot.messages import Detection, Detections
from ghal360_robot.perception.sphere import PictureSize, sphere_box

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ghal360_robot.perception.detectors.base import PixelDetection


def around_robot(
    found: Iterable[PixelDetection],
    size: PictureSize,
    camera_yaw: float,
    *,
    stamp_ns: int,
    picture: int,
    detector: str,
) -> Detections:
    """Detections in the base frame, for a camera whose picture centre looks along `camera_yaw` (rad, CCW)."""
    objects = []
    for detection in found:
        box = sphere_box(detection.box, size, camera_yaw)
        objects.append(Detection(detection.name, detection.score, box.yaw, box.pitch, box.width, box.height))
    return Detections(stamp_ns, picture, detector, tuple(objects))
