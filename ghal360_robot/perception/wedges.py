"""The scene around the robot as eight wedge values, from what is believed to be there. Pure.

Objects are kept in the odometry frame, so that turning neither smears nor loses them. Values are those of
`guidance.egocentric`, the paper's w0..w3: 0 empty, 1 clutter, 2 target, 3 both.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING

from ghal360_robot.angles import wrap
from ghal360_robot.guidance.egocentric import CLUTTER, EMPTY, N_WEDGES, TARGET, egocentric, wedge_of
from ghal360_robot.perception.names import canonical
from ghal360_robot.perception.tracking import Remembered, Standpoint, TrackSettings, camera_at, current, step_objects

if TYPE_CHECKING:
    from ghal360_robot.messages import Detections, Pose2


@dataclass(frozen=True, slots=True)
class SceneState:
    """What is believed to be around, or may be; `stamp_ns` is that of the newest detections taken in."""

    objects: tuple[Remembered, ...] = ()
    stamp_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Scene:
    """What the guidance sees of the surroundings."""

    allocentric: tuple[int, ...]
    """(8,) values of the world wedges, clockwise from the odometry's x."""
    target_yaw: float | None
    """Direction of the target in the base frame, or None."""
    target_score: float
    target_place: tuple[float, float] | None = None
    """Where it stands in the odometry frame, m; None while that is not known."""

    def egocentric(self, gaze_world_yaw: float) -> tuple[int, ...]:
        """(8,) values clockwise from the wedge that a gaze (odometry frame, radians CCW) rests on."""
        return egocentric(self.allocentric, wedge_of(-gaze_world_yaw))


def step_scene(
    settings: TrackSettings, state: SceneState, detections: Detections | None, standpoint: Standpoint, now_ns: int
) -> SceneState:
    """Take in the newest detections, once, and let everything else fade.

    `standpoint` is where the robot was when the picture was taken. Passing the same detections again changes nothing
    but the time.
    """
    objects, stamp_ns = state.objects, state.stamp_ns
    if detections is not None and (stamp_ns is None or detections.stamp_ns > stamp_ns):
        stamp_ns = detections.stamp_ns
        objects = step_objects(settings, objects, detections, standpoint)
    return SceneState(current(settings, objects, now_ns), stamp_ns)


def scene(settings: TrackSettings, state: SceneState, target: str, pose: Pose2) -> Scene:
    """The wedge values for a search for `target`; `pose` is the odometry's now.

    One target wedge at most: that of the centre of the target seen last, the best-scored of one picture.
    Every object of another name is clutter in the wedge of its own centre.
    """
    camera, wanted = camera_at(pose, settings.camera), canonical(target)
    values, targets = [EMPTY] * N_WEDGES, []
    for item in state.objects:
        wedge = wedge_of(-item.yaw_from(camera))
        if not item.believed:
            continue
        if item.name == wanted:
            targets.append(item)
        else:
            values[wedge] |= CLUTTER
    if not targets:
        return Scene(tuple(values), None, 0.0)
    best = max(targets, key=lambda item: (item.seen_ns, item.score))
    yaw = best.yaw_from(camera)
    values[wedge_of(-yaw)] |= TARGET
    return Scene(tuple(values), wrap(yaw - pose.yaw), best.score, best.position())


def reports(
    settings: TrackSettings, state: SceneState, detections: Detections, target: str, pose: Pose2
) -> tuple[float, ...]:
    """(8,) 1 where one picture reports the target in a world wedge, whatever the score, 0 where it does not.

    NaN where the tracked target is hidden, of which a picture without it says nothing. `state` is the scene after that
    picture, `pose` the odometry's when it was taken.
    """
    wanted, camera = canonical(target), camera_at(pose, settings.camera)
    seen = [0.0] * N_WEDGES
    for item in state.objects:
        if item.name == wanted and item.believed and item.hidden:
            seen[wedge_of(-item.yaw_from(camera))] = nan
    for found in detections.objects:
        if canonical(found.name) == wanted:
            seen[wedge_of(-wrap(pose.yaw + found.yaw))] = 1.0
    return tuple(seen)
