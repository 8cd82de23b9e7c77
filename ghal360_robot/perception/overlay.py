"""What the robot knows, drawn over the panorama: boxes, target, wedge ring, gaze and cue. Pure: draws on a copy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ghal360_robot.guidance.egocentric import CLUTTER, N_WEDGES, TARGET, WEDGE_WIDTH, wedge_centre
from ghal360_robot.messages import Cue
from ghal360_robot.perception.panorama import UPRIGHT, CameraView, in_picture
from ghal360_robot.perception.sphere import PictureSize, SphereBox, parts_of_box, pixel_box, pixel_of_direction

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ghal360_robot.messages import Detection

    Picture = NDArray[np.uint8]

WHITE = (255, 255, 255)
DARK = (25, 25, 30)
TARGET_COLOUR = (255, 200, 40)
OBJECT_COLOUR = (120, 220, 255)
CUE_COLOUR = (70, 230, 120)
WEDGE_COLOURS = {0: (150, 150, 150), CLUTTER: (120, 220, 255), TARGET: (255, 200, 40), TARGET | CLUTTER: (255, 120, 40)}
"""Distinct in lightness as well as in hue, for the colour-blind."""

RING_HEIGHT = 0.035
"""Share of the picture's height that the wedge ring takes at its lower edge."""


@dataclass(frozen=True, slots=True)
class Annotation:
    """What to draw; yaws in the base frame, wedges egocentric from the gaze."""

    objects: Sequence[Detection] = ()
    target: str = ""
    wedges: Sequence[int] = ()
    gaze_yaw: float = 0.0
    fov: float = math.pi / 2
    cue: Cue = Cue.NONE


def draw(picture: Picture, annotation: Annotation, camera: CameraView = UPRIGHT) -> Picture:
    """The panorama (height, width, 3) RGB with its annotation; the input is left as it is."""
    canvas = picture.copy()
    size, camera_yaw = PictureSize(canvas.shape[1], canvas.shape[0]), camera.yaw
    for found in annotation.objects:
        _draw_object(canvas, found, size, camera, is_target=found.name == annotation.target)
    if annotation.wedges:
        _draw_ring(canvas, annotation, size, camera_yaw)
    _draw_view(canvas, annotation, size, camera_yaw)
    _draw_cue(canvas, annotation, size, camera_yaw)
    return canvas


def _draw_object(canvas: Picture, found: Detection, size: PictureSize, camera: CameraView, *, is_target: bool) -> None:
    colour = TARGET_COLOUR if is_target else OBJECT_COLOUR
    box = in_picture(SphereBox(found.yaw, found.pitch, found.width, found.height), size, camera)
    for part in parts_of_box(box, size):
        corner = (round(part.left), round(part.top))
        opposite = (round(part.left + part.width), round(part.top + part.height))
        cv2.rectangle(canvas, corner, opposite, DARK, 5 if is_target else 4)
        cv2.rectangle(canvas, corner, opposite, colour, 3 if is_target else 2)
    _label(canvas, f"{found.name} {found.score:.2f}", (round(box.left), round(box.top) - 8), colour)


def _draw_ring(canvas: Picture, annotation: Annotation, size: PictureSize, camera_yaw: float) -> None:
    """Eight coloured sectors at the lower edge, W0 where the gaze rests."""
    top = round(size.height * (1.0 - RING_HEIGHT))
    for index in range(N_WEDGES):
        centre = annotation.gaze_yaw - wedge_centre(index)  # wedges are clockwise, yaws are not
        box = pixel_box(SphereBox(centre, 0.0, WEDGE_WIDTH, 0.1), size, camera_yaw)
        colour = WEDGE_COLOURS[annotation.wedges[index]]
        for part in parts_of_box(box, size):
            left, right = round(part.left), round(part.left + part.width)
            cv2.rectangle(canvas, (left + 2, top), (right - 2, size.height - 2), colour, cv2.FILLED)
        u = float(pixel_of_direction(centre, 0.0, size, camera_yaw)[0])
        text = f"W{index} w{annotation.wedges[index]}"
        _text(canvas, text, (round(u) - 40, size.height - 9), DARK, 0.62)


def _draw_view(canvas: Picture, annotation: Annotation, size: PictureSize, camera_yaw: float) -> None:
    """Brackets at the two edges of the operator's field of view."""
    for side in (1.0, -1.0):
        yaw = annotation.gaze_yaw + side * annotation.fov / 2
        u = round(float(pixel_of_direction(yaw, 0.0, size, camera_yaw)[0]))
        inward = round(size.width / 60 * side)
        for v in (round(size.height * 0.22), round(size.height * 0.78)):
            cv2.line(canvas, (u, v), (u + inward, v), WHITE, 3)
        cv2.line(canvas, (u, round(size.height * 0.22)), (u, round(size.height * 0.78)), WHITE, 2)


def _draw_cue(canvas: Picture, annotation: Annotation, size: PictureSize, camera_yaw: float) -> None:
    u, v = (float(value) for value in pixel_of_direction(annotation.gaze_yaw, 0.45, size, camera_yaw))
    reach = size.width / 24
    if annotation.cue is Cue.CONFIRM:
        cv2.circle(canvas, (round(u), round(v)), round(reach * 0.6), DARK, 14)
        cv2.circle(canvas, (round(u), round(v)), round(reach * 0.6), CUE_COLOUR, 8)
        _label(canvas, "confirm", (round(u) - 45, round(v) + 8), CUE_COLOUR)
    elif annotation.cue in {Cue.LEFT, Cue.RIGHT}:
        ahead = -1.0 if annotation.cue is Cue.LEFT else 1.0
        shape = np.array([(-1, -0.2), (0.2, -0.2), (0.2, -0.55), (1, 0), (0.2, 0.55), (0.2, 0.2), (-1, 0.2)])
        points = np.round(shape * (ahead * reach, reach) + (u, v)).astype(np.int32)
        cv2.fillPoly(canvas, [points], CUE_COLOUR)
        cv2.polylines(canvas, [points], isClosed=True, color=DARK, thickness=4)


def _label(canvas: Picture, text: str, at: tuple[int, int], colour: tuple[int, int, int]) -> None:
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 2)
    x = min(max(at[0], 2), canvas.shape[1] - width - 4)
    y = max(at[1], height + 6)
    cv2.rectangle(canvas, (x - 3, y - height - 4), (x + width + 3, y + 5), DARK, cv2.FILLED)
    _text(canvas, text, (x, y), colour, 0.6)


def _text(canvas: Picture, text: str, at: tuple[int, int], colour: tuple[int, int, int], scale: float) -> None:
    cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 2, cv2.LINE_AA)
