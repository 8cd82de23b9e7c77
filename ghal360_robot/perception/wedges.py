"""The scene around the robot as eight wedge values, with a short memory of what was seen. Pure.

What was detected is remembered by its direction in the odometry frame, so that turning neither smears
nor loses it. Values are those of `guidance.egocentric`: 0 empty, 1 clutter, 2 target, 3 both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.angles import wrap
from ghal360_robot.guidance.egocentric import CLUTTER, EMPTY, N_WEDGES, TARGET, egocentric, wedge_of
from ghal360_robot.perception.sphere import angular_distance

if TYPE_CHECKING:
    from ghal360_robot.messages import Detection, Detections

NS = 1_000_000_000
MAX_REMEMBERED = 256
"""A detector that reports more than this is broken; the best-scored are kept."""


@dataclass(frozen=True, slots=True)
class SceneSettings:
    """How detections become a scene."""

    min_score: float = 0.5
    """Detections below are not there."""
    memory_s: float = 1.0
    """How long an object is believed in after it was last seen: two or three detections at 2-4 Hz."""
    same_object: float = 0.26
    """rad (15 degrees). Within this, the same name is the same object: 0.5 m of driving past it at 2 m."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """One object: direction in the odometry frame and when it was last seen."""

    name: str
    score: float
    world_yaw: float
    pitch: float
    seen_ns: int


@dataclass(frozen=True, slots=True)
class SceneState:
    """What is believed to be around; `stamp_ns` is that of the newest detections taken in."""

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

    def egocentric(self, gaze_world_yaw: float) -> tuple[int, ...]:
        """(8,) values clockwise from the wedge that a gaze (odometry frame, radians CCW) rests on."""
        return egocentric(self.allocentric, wedge_of(-gaze_world_yaw))


def step_scene(
    settings: SceneSettings,
    state: SceneState,
    detections: Detections | None,
    base_yaw: float,
    now_ns: int,
) -> SceneState:
    """Take in the newest detections, once, and forget what has not been seen for long.

    `base_yaw` is the odometry's yaw at the time of the picture. Passing the same detections again
    changes nothing but the time.
    """
    objects = state.objects
    stamp_ns = state.stamp_ns
    if detections is not None and (stamp_ns is None or detections.stamp_ns > stamp_ns):
        stamp_ns = detections.stamp_ns
        seen = _seen(settings, detections, base_yaw)
        objects = (*seen, *(old for old in objects if not _seen_again(old, seen, settings.same_object)))
    horizon_ns = now_ns - round(settings.memory_s * NS)
    kept = tuple(item for item in objects if item.seen_ns >= horizon_ns)[:MAX_REMEMBERED]
    return SceneState(kept, stamp_ns)


def scene(state: SceneState, target: str, base_yaw: float) -> Scene:
    """The wedge values for a search for `target`; `base_yaw` is the odometry's yaw now.

    One target wedge at most: that of the centre of the target seen last, the best-scored of one picture.
    Every object of another name is clutter in the wedge of its own centre.
    """
    values = [EMPTY] * N_WEDGES
    targets = [item for item in state.objects if item.name == target]
    for item in state.objects:
        if item.name != target:
            values[wedge_of(-item.world_yaw)] |= CLUTTER
    if not targets:
        return Scene(tuple(values), None, 0.0)
    best = max(targets, key=lambda item: (item.seen_ns, item.score))
    values[wedge_of(-best.world_yaw)] |= TARGET
    return Scene(tuple(values), wrap(best.world_yaw - base_yaw), best.score)


def _seen(settings: SceneSettings, detections: Detections, base_yaw: float) -> tuple[Remembered, ...]:
    good = (found for found in detections.objects if found.score >= settings.min_score)
    best_first: list[Detection] = sorted(good, key=lambda found: -found.score)[:MAX_REMEMBERED]
    return tuple(
        Remembered(found.name, found.score, wrap(base_yaw + found.yaw), found.pitch, detections.stamp_ns)
        for found in best_first
    )


def _seen_again(old: Remembered, seen: tuple[Remembered, ...], same_object: float) -> bool:
    return any(
        new.name == old.name and angular_distance(old.world_yaw, old.pitch, new.world_yaw, new.pitch) <= same_object
        for new in seen
    )
