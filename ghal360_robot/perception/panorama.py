"""From boxes in a picture to directions around the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.messages import Detection, Detections
from ghal360_robot.perception.merge import area, intersection
from ghal360_robot.perception.sphere import (
    PictureSize,
    PixelBox,
    SphereBox,
    camera_rotation,
    pixel_box,
    sphere_box,
    turned_box,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from ghal360_robot.perception.detectors.base import PixelDetection

OWN_SHARE = 0.5
"""A box of which at least this share shows the robot's own body is not of anything around it."""


@dataclass(frozen=True, slots=True)
class CameraView:
    """How the camera looks in the base frame (rad), and where it sees the robot itself (boxes in the base frame)."""

    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0
    body: tuple[SphereBox, ...] = ()

    def upright(self) -> bool:
        return self.pitch == 0.0 and self.roll == 0.0

    def shows_body(self, box: SphereBox) -> bool:
        return any(intersection(box, part) >= OWN_SHARE * area(box) for part in self.body)


UPRIGHT = CameraView()
"""A camera that stands straight and looks ahead, on a robot it does not see."""


def in_picture(box: SphereBox, size: PictureSize, view: CameraView | float) -> PixelBox:
    """Where a box of the base frame lies in the picture; a number is an upright camera's yaw."""
    if not isinstance(view, CameraView):
        view = CameraView(view)
    if view.upright():
        return pixel_box(box, size, view.yaw)
    return pixel_box(turned_box(box, camera_rotation(view.yaw, view.pitch, view.roll).T), size)


def around_robot(
    found: Iterable[PixelDetection],
    size: PictureSize,
    view: CameraView | float,
    *,
    stamp_ns: int,
    picture: int,
    detector: str,
) -> Detections:
    """Detections in the base frame, without those of the robot itself; a number is an upright camera's yaw."""
    if not isinstance(view, CameraView):
        view = CameraView(view)
    rotation = None if view.upright() else camera_rotation(view.yaw, view.pitch, view.roll)
    objects = []
    for detection in found:
        if rotation is None:
            box = sphere_box(detection.box, size, view.yaw)
        else:
            box = turned_box(sphere_box(detection.box, size), rotation)
        if not view.shows_body(box):
            objects.append(Detection(detection.name, detection.score, box.yaw, box.pitch, box.width, box.height))
    return Detections(stamp_ns, picture, detector, tuple(objects))
