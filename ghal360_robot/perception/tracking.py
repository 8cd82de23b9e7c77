"""What is believed to be around: detections of many pictures made into objects. Pure.

Sightings of one class in about one direction of the world are one object. Their scores add up and fade, so that one
strong sighting or a few weak ones make it believed, and it stays so until much less is left (hysteresis). Where it
stands follows from directions and lidar ranges; an object whose place is known is remembered while something hides it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import asin, atan2, cos, exp, hypot, pi, sin, sqrt, tan, tau
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.angles import wrap
from ghal360_robot.frames import place_of
from ghal360_robot.perception.bearing_out import AskSettings
from ghal360_robot.perception.names import canonical
from ghal360_robot.perception.place import Place

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import Detection, Detections, Pose2, Surroundings

NS = 1_000_000_000
MAX_REMEMBERED = 256
"""A detector that reports more than this is broken; the best are kept."""
BEAMS_ASIDE = 0.035
"""rad (2 degrees). The nearest return so close to a direction is what stands there."""
HIDDEN_BY_M = 0.5
"""A return so much nearer than the object is something in front of it."""
CAP = 2.0
"""Evidence does not grow beyond: what was seen for an hour has to be forgotten as fast as what was seen for seconds."""


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """How sightings become objects."""

    confirm: float = 0.5
    """Evidence (sum of faded scores) from which an object is believed."""
    release: float = 0.25
    """Evidence below which it no longer is, or half of what began it where that is less."""
    confirm_class: Mapping[str, float] = field(default_factory=dict)
    """Other values of `confirm` by class, for those that detectors get wrong."""
    fading_s: float = 2.0
    """Evidence falls to a third in so long without sightings."""
    memory_s: float = 1.0
    """How long an object in plain view is believed in after it was last seen: two or three pictures at 2-4 Hz."""
    permanence_s: float = 20.0
    """How long one is believed in that something hides, where its place is known."""
    same_object: float = 0.26
    """rad (15 degrees). Within this, the same class is the same object: 0.5 m of driving past it at 2 m."""
    camera: tuple[float, float, float] = (0.0, 0.0, 1.2)
    """The camera's place in the base frame, m."""
    asking: AskSettings = AskSettings()
    """Which sightings are good enough for a question to the operator."""


@dataclass(frozen=True, slots=True)
class Remembered:
    """One object: class, last score, direction in the odometry frame, and how sure it is to be there."""

    name: str
    score: float
    world_yaw: float
    pitch: float
    seen_ns: int
    evidence: float = 0.0
    """As of `judged_ns`."""
    judged_ns: int = 0
    believed: bool = False
    sightings: int = 1
    hidden: bool = False
    """Something stands in front of it."""
    well_seen_ns: int | None = None
    """When it was last seen well enough to be asked about."""
    place: Place = Place()

    def position(self) -> tuple[float, float] | None:
        """Where it stands in the odometry frame, m; None while that is not known."""
        return self.place.position()

    def yaw_from(self, camera: tuple[float, float]) -> float:
        """Its direction in the odometry frame from a place of the camera."""
        position = self.position()
        if position is None:
            return self.world_yaw
        return atan2(position[1] - camera[1], position[0] - camera[0])


@dataclass(frozen=True, slots=True)
class Standpoint:
    """Where the robot was when a picture was taken, and the newest scan with where the robot was then."""

    pose: Pose2
    surroundings: Surroundings | None = None
    scan_pose: Pose2 | None = None

    def returns(self, camera: tuple[float, float]) -> Returns:
        """What the scan met, as seen from the camera."""
        if self.surroundings is None or self.scan_pose is None:
            return Returns(np.empty(0), np.empty(0))
        pose, points = self.scan_pose, self.surroundings.points
        c, s = cos(pose.yaw), sin(pose.yaw)
        dx = pose.x - camera[0] + c * points[:, 0] - s * points[:, 1]
        dy = pose.y - camera[1] + s * points[:, 0] + c * points[:, 1]
        return Returns(np.arctan2(dy, dx), np.hypot(dx, dy))


@dataclass(frozen=True, slots=True, eq=False)
class Returns:
    """Direction in the odometry frame (n,) and distance (n,) of every return of a scan from one place."""

    yaw: NDArray[np.float64]
    distance: NDArray[np.float64]

    def along(self, yaw: float) -> float | None:
        """Metres to the nearest return in a direction, or None."""
        aside = np.abs(np.mod(self.yaw - yaw + pi, tau) - pi)
        near = self.distance[aside <= BEAMS_ASIDE]
        return float(near.min()) if near.size else None


def camera_at(pose: Pose2, mount: tuple[float, float, float]) -> tuple[float, float]:
    """The camera's place in the odometry frame, for a robot there."""
    return place_of(pose, mount[:2])


def step_objects(
    settings: TrackSettings, objects: tuple[Remembered, ...], detections: Detections, standpoint: Standpoint
) -> tuple[Remembered, ...]:
    """The objects after one more picture, seen ones first. Passing a picture twice counts it twice."""
    camera = camera_at(standpoint.pose, settings.camera)
    returns = standpoint.returns(camera)
    best_first = sorted(detections.objects, key=lambda found: -found.score)[:MAX_REMEMBERED]
    left = list(objects)
    seen: list[Remembered] = []
    for found in best_first:
        name, yaw = canonical(found.name), wrap(standpoint.pose.yaw + found.yaw)
        if any(item.name == name and _near(settings, item, yaw, found.pitch, camera) for item in seen):
            continue  # two boxes on one object: the better one counts
        close = [item for item in left if item.name == name and _near(settings, item, yaw, found.pitch, camera)]
        old = min(close, key=lambda item: abs(wrap(item.yaw_from(camera) - yaw)), default=None)
        range_m = returns.along(yaw)
        well = settings.asking.bears_out(name, found, range_m, measurable=standpoint.surroundings is not None)
        item = _sighted(settings, old, found, name, yaw, camera, range_m, detections.stamp_ns)
        before_ns = None if old is None else old.well_seen_ns
        seen.append(replace(item, well_seen_ns=detections.stamp_ns if well else before_ns))
        left = [item for item in left if item not in close]
    missed = [_missed(item, camera, returns, detections.stamp_ns) for item in left]
    return (*seen, *missed)[:MAX_REMEMBERED]


def current(settings: TrackSettings, objects: tuple[Remembered, ...], now_ns: int) -> tuple[Remembered, ...]:
    """The objects as believed now; what is neither believed nor has any evidence left is gone."""
    judged = (_judged(settings, item, now_ns) for item in objects)
    return tuple(item for item in judged if item.believed or item.evidence > settings.release / 4)


def _near(settings: TrackSettings, item: Remembered, yaw: float, pitch: float, camera: tuple[float, float]) -> bool:
    return apart(item.yaw_from(camera), item.pitch, yaw, pitch) <= settings.same_object


def apart(yaw_a: float, pitch_a: float, yaw_b: float, pitch_b: float) -> float:
    """Angle between two directions, radians: `sphere.angular_distance` for single numbers, much cheaper."""
    across = (sin((pitch_a - pitch_b) / 2)) ** 2 + cos(pitch_a) * cos(pitch_b) * sin((yaw_a - yaw_b) / 2) ** 2
    return 2 * asin(min(1.0, sqrt(across)))


def _sighted(
    settings: TrackSettings,
    old: Remembered | None,
    found: Detection,
    name: str,
    yaw: float,
    camera: tuple[float, float],
    range_m: float | None,
    stamp_ns: int,
) -> Remembered:
    place = (Place() if old is None else old.place).seen(camera, yaw, range_m)
    before = 0.0 if old is None else _faded(settings, old, stamp_ns)
    return Remembered(
        name=name,
        score=found.score,
        world_yaw=yaw,
        pitch=found.pitch,
        seen_ns=stamp_ns,
        evidence=min(CAP, before + found.score),
        judged_ns=stamp_ns,
        believed=old is not None and old.believed,
        sightings=1 if old is None else old.sightings + 1,
        place=place,
    )


def _missed(item: Remembered, camera: tuple[float, float], returns: Returns, stamp_ns: int) -> Remembered:
    """An object that the newest picture does not show: does something stand in front of it?"""
    position = item.position()
    if position is None:
        return item
    distance = hypot(position[0] - camera[0], position[1] - camera[1])
    met = returns.along(item.yaw_from(camera))
    hidden = met is not None and met < distance - HIDDEN_BY_M
    return replace(item, hidden=hidden, judged_ns=max(item.judged_ns, stamp_ns))


def _faded(settings: TrackSettings, item: Remembered, now_ns: int) -> float:
    # While something hides an object, nothing speaks against it.
    if item.hidden:
        return item.evidence
    return item.evidence * exp(-max(0, now_ns - item.judged_ns) / (settings.fading_s * NS))


def _judged(settings: TrackSettings, item: Remembered, now_ns: int) -> Remembered:
    evidence = _faded(settings, item, now_ns)
    limit_s = settings.permanence_s if item.hidden else settings.memory_s
    recent = now_ns - item.seen_ns <= limit_s * NS
    needed = settings.confirm_class.get(item.name, settings.confirm)
    if item.believed:
        needed = min(settings.release, needed / 2)
    return replace(
        item, evidence=evidence, judged_ns=max(now_ns, item.judged_ns), believed=recent and evidence >= needed
    )


def height_m(item: Remembered, camera: tuple[float, float, float]) -> float | None:
    """Height of its centre above the floor; None while its place is not known."""
    position = item.position()
    if position is None:
        return None
    return camera[2] + hypot(position[0] - camera[0], position[1] - camera[1]) * tan(item.pitch)
