"""`ghal360 pictures`: rendered panoramas with boxes and cue, for the documentation."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import cv2
import typer

from ghal360_robot.errors import UsageError
from ghal360_robot.guidance.cueing import CueSettings, CueState, step_cue
from ghal360_robot.guidance.policy import make_policy
from ghal360_robot.messages import Pose2
from ghal360_robot.perception.detectors.base import make_detector
from ghal360_robot.perception.overlay import Annotation, draw
from ghal360_robot.perception.panorama import CameraView, around_robot
from ghal360_robot.perception.sphere import PictureSize
from ghal360_robot.perception.tracking import Standpoint, TrackSettings
from ghal360_robot.perception.wedges import SceneState, scene, step_scene
from ghal360_robot.simulation.vantage import vantage_pose
from ghal360_robot.simulation.world import CAMERA_HEIGHT_M, build_world

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SCENES = (("office", 1, "backpack", -1.9), ("home", 2, "television", 1.2), ("office", 4, "laptop", 0.1))
"""World, seed, target, and where the operator looks relative to the target."""


def pictures(folder: Annotated[Path, typer.Argument(help="Where the JPEG files go")]) -> None:
    """Render three panoramas and draw what the robot makes of them: boxes, wedge ring, field of view, cue.

    Example: ghal360 pictures docs
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"cannot make {folder}: {error.strerror}") from error
    for world, seed, target, aside in SCENES:
        path = folder / f"{world}-{target}.jpg"
        annotated = _annotated(world, seed, target, aside)
        if not cv2.imwrite(str(path), cv2.cvtColor(annotated, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 88]):
            raise UsageError(f"cannot write {path}")
        print(path)


def _annotated(world_name: str, seed: int, target: str, aside: float) -> NDArray[np.uint8]:
    """The same steps as in the robot, for one picture: detect, wedges, policy, cue."""
    from ghal360_robot.simulation.renderer import PanoramaRenderer  # noqa: PLC0415 - needs the extra [sim]

    world = build_world(world_name, seed, target)
    pose = vantage_pose(world)
    picture = PanoramaRenderer(world, painted=True).render(pose.x, pose.y, pose.yaw, CAMERA_HEIGHT_M)
    detector = make_detector("painted")
    size = PictureSize(picture.shape[1], picture.shape[0])
    found = around_robot(detector.detect(picture), size, CameraView(), stamp_ns=0, picture=0, detector=detector.name)
    tracks, here = TrackSettings(), Pose2()
    seen = scene(tracks, step_scene(tracks, SceneState(), found, Standpoint(here), 0), target, here)
    gaze = (seen.target_yaw or 0.0) + aside
    cue = step_cue(make_policy("plan"), CueSettings(), CueState(), seen.allocentric, gaze, 0)
    annotation = Annotation(found.objects, target, cue.wedges, gaze, cue=cue.cue)
    return draw(picture, annotation)
