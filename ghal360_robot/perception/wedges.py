"""The scene around the robot as eight wedge values, from what is believed to be there. Pure.

Objects are kept in the odometry frame, so that turning neither smears nor loses them. Values are those of
`guidance.egocentric`, the paper's w0..w3: 0 empty, 1 clutter, 2 target, 3 both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from typing import TYPE_CHECKING

from ghal360_robot.angles import wrap
from ghal360_robot.guidance.egocentric import CLUTTER, EMPTY, N_WEDGES, TARGET, egocentric, wedge_of
from ghal360_robot.perception.names import canonical
from ghal360_robot.perception.tracking import (
    Remembered,
    Standpoint,
    TrackSettings,
    camera_at,
    current,
    step_objects,
)

if TYPE_CHECKING:
    from ghal360_robot.messages import Detections, Pose2

Spot = tuple[float, float]
Refused = Callable[[float, Spot, Spot | None], bool]
"""Whether the operator said no to the thing in a direction from the camera, at a place if it is known (odometry)."""


def nothing_refused(_yaw: float, _camera: Spot, _place: Spot | None) -> bool:
    """Of an operator who was not asked yet."""
    return False


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
    well_seen_ns: int | None = None
    """When the target was last seen well enough to be asked about."""

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


def scene(
    settings: TrackSettings, state: SceneState, target: str, pose: Pose2, refused: Refused = nothing_refused
) -> Scene:
    """The wedge values for a search for `target`; `pose` is the odometry's now.

    One target wedge at most: that of the centre of the target seen last; of those in one picture the one seen well, or
    with the best score.
    Every object of another name is clutter in the wedge of its own centre, and so is what the operator `refused`.
    """
    camera, wanted = camera_at(pose, settings.camera), canonical(target)
    values, targets = [EMPTY] * N_WEDGES, []
    for item in state.objects:
        if not item.believed:
            continue
        yaw = item.yaw_from(camera)
        if item.name == wanted and not refused(yaw, camera, item.position()):
            targets.append(item)
        else:
            values[wedge_of(-yaw)] |= CLUTTER
    if not targets:
        return Scene(tuple(values), None, 0.0)
    best = max(targets, key=lambda item: (item.seen_ns, item.well_seen_ns == item.seen_ns, item.score))
    yaw = best.yaw_from(camera)
    values[wedge_of(-yaw)] |= TARGET
    return Scene(tuple(values), wrap(yaw - pose.yaw), best.score, best.position(), best.well_seen_ns)


def reports(
    settings: TrackSettings, state: SceneState, target: str, pose: Pose2, refused: Refused = nothing_refused
) -> tuple[float, ...]:
    """(8,) 1 where the newest picture reports the target in a world wedge well enough to ask about it, 0 where it does
    not report it.

    NaN where it says nothing: it reports the target too weakly, or that is hidden. What the operator `refused` counts
    as not reported. `state` is the scene after that picture, `pose` the odometry's when it was taken.
    """
    wanted, camera = canonical(target), camera_at(pose, settings.camera)
    seen = [0.0] * N_WEDGES
    for item in state.objects:
        shown = item.seen_ns == state.stamp_ns
        if item.name != wanted or not (shown or (item.believed and item.hidden)):
            continue
        yaw = item.world_yaw if shown else item.yaw_from(camera)
        if refused(yaw, camera, item.position()):
            continue
        wedge = wedge_of(-yaw)
        if shown and item.well_seen_ns == state.stamp_ns:
            seen[wedge] = 1.0
        elif not seen[wedge]:
            seen[wedge] = nan
    return tuple(seen)
