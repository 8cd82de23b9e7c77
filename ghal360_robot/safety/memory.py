"""What the safety chain remembers of the ground around: the last scan, a second of earlier ones, people, its own way.

All of it in the odometry frame, all of it bounded. When the odometry jumps, everything is forgotten.

A new scan is taken in at once, with those in it who are known to walk. What else moves is looked for in the tick
after, and whose it is in the next one, 40 ms later, so that no tick has to do it all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.angles import wrap
from ghal360_robot.safety import people as crowd
from ghal360_robot.safety.people import Person
from ghal360_robot.safety.sight import MIDDLE_NS, Look, look, seen_free
from ghal360_robot.safety.view import scan_fault, view_ahead
from ghal360_robot.safety.zones import Around
from ghal360_robot.trail import Trail, further

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import BaseState, Inputs, Pose2, Surroundings
    from ghal360_robot.safety.limits import SafetyLimits

    Floats = NDArray[np.float64]

LOOKS = 18
"""Scans kept: 1.2 s at the TiM571's 15 Hz."""

THIN = 2
"""Every second return is enough to see somebody by: a leg 3 m away is four of them wide."""

PAST_NS, PAST = 500_000_000, 16
"""Of older scans one in so long is kept, and so many of them: ground that was seen free."""

DRIVEN_M, DRIVEN_RAD, DRIVEN = 0.05, 0.1, 128
"""A place on the robot's own way is noted every so far, and so many of them are kept."""

JUMP_M, JUMP_RAD = 0.3, 0.5
"""No base moves so much further than it can between two states of its: its odometry has begun anew."""


NOTHING = np.zeros((0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The last scan: returns that matter, in the odometry frame.

    `points` (n, 2): first all that are close; from `resting` on those of people who have stopped for the moment,
    from `walking` on those of people who walk, near and far and thinned out.
    """

    stamp_ns: int
    points: Floats
    resting: int
    walking: int
    fault: str
    """Why the scan says nothing at all; empty where it does."""
    blind_ahead: str
    """Why it says nothing about the way ahead."""
    silent_ahead: str = ""
    """Why it says little enough about the way ahead to go slowly."""


@dataclass(frozen=True, slots=True, eq=False)
class Unsorted:
    """Returns (n, 2) of the last scan, odometry frame, and their beams (n,): who moves is still to be found out."""

    points: Floats
    beam: NDArray[np.intp]
    turning: float
    """rad/s of the base while they were measured."""
    moved: NDArray[np.bool_] | None = None
    """(n,): which of them stand where there was free ground; None before that was looked for."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where the robot was."""

    stamp_ns: int
    pose: Pose2


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """Everything remembered, oldest first."""

    trail: Trail = Trail()
    looks: tuple[Look, ...] = ()
    past: tuple[Look, ...] = ()
    """Every so often one of them, kept for longer."""
    people: tuple[Person, ...] = ()
    driven: tuple[Place, ...] = ()
    scene: Scene | None = None
    unsorted: Unsorted | None = None
    someone_ns: int | None = None
    """The newest scan with somebody about."""


def remember(memory: Memory, inputs: Inputs, limits: SafetyLimits) -> Memory:
    """One tick: the base's newest state, and the scan if it is a new one."""
    base, around = inputs.base, inputs.surroundings
    if base is None:
        return memory
    stamps = memory.trail.stamps
    if not stamps or base.stamp_ns != stamps[-1]:
        if stamps and _jumped(memory.trail, base, limits):
            memory = Memory(someone_ns=memory.someone_ns)
        driven = _driven(memory.driven, base, limits.ground_memory_s)
        memory = Memory(
            memory.trail.extended(base), memory.looks, memory.past, memory.people,
            driven, memory.scene, memory.unsorted, memory.someone_ns,
        )  # fmt: skip
    memory = _sorted_on(memory, limits)
    if around is None or (memory.scene is not None and around.stamp_ns == memory.scene.stamp_ns):
        return memory
    return _taken_in(_sorted_on(memory, limits), around, base.twist.w, limits)


def here(memory: Memory, now_ns: int) -> Around:
    """The last scan's returns in the base frame of this moment."""
    scene = memory.scene
    if scene is None:
        return Around(NOTHING, NOTHING, NOTHING)
    pose = memory.trail.at(now_ns)
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    points = (scene.points - (pose.x, pose.y)) @ np.array(((c, -s), (s, c)))
    return Around(points, points[scene.resting : scene.walking], points[scene.walking :])


def known_free(memory: Memory, points: Floats, radius: float, now_ns: int) -> NDArray[np.bool_]:
    """Which of `points` (n, 2), base frame, lie in ground that was driven over or seen free a short while ago."""
    pose = memory.trail.at(now_ns)
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    there = points @ np.array(((c, s), (-s, c))) + (pose.x, pose.y)
    places = np.array([(place.pose.x, place.pose.y) for place in memory.driven]).reshape(-1, 2)
    apart = np.hypot(there[:, :1] - places[:, 0], there[:, 1:] - places[:, 1])
    driven = apart.min(axis=1, initial=np.inf) <= radius
    return np.asarray(driven | seen_free((*memory.past, *memory.looks), there).any(axis=0))


def _taken_in(memory: Memory, around: Surroundings, turning: float, limits: SafetyLimits) -> Memory:
    pose, stamp_ns = memory.trail.at(around.stamp_ns - MIDDLE_NS), around.stamp_ns
    x, y = around.points[:, 0], around.points[:, 1]
    squared = x * x + y * y
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    to_odometry, here_x_y = np.array(((c, s), (-s, c))), (pose.x, pose.y)
    close = _rows(around.points, squared < limits.reach_m**2) @ to_odometry + here_x_y
    some = np.flatnonzero(squared < limits.people_reach_m**2)[::THIN]
    unsorted = Unsorted(around.points.take(some, axis=0) @ to_odometry + here_x_y, around.beam[some], turning)
    fault = scan_fault(around, limits.footprint)
    ahead, silent = ("", "") if fault else view_ahead(around)
    clear_of = [person for person in memory.people if person.counts(stamp_ns)]
    scene = Scene(stamp_ns, *_parts(close, unsorted.points, clear_of, stamp_ns), fault, ahead, silent)
    seen = look(around, pose, turning)
    past = tuple(old for old in memory.past if stamp_ns - old.stamp_ns <= limits.ground_memory_s * 1e9)
    if not past or stamp_ns - past[-1].stamp_ns >= PAST_NS:
        past = (*past[1 - PAST :], seen)
    looks = (*memory.looks[1 - LOOKS :], seen)
    someone_ns = stamp_ns if crowd.about(clear_of, stamp_ns) else memory.someone_ns
    return Memory(memory.trail, looks, past, memory.people, memory.driven, scene, unsorted, someone_ns)


def _sorted_on(memory: Memory, limits: SafetyLimits) -> Memory:
    """One more step towards knowing who moves in the last scan: first what, then who."""
    scene, unsorted = memory.scene, memory.unsorted
    if scene is None or unsorted is None:
        return memory
    points, beam, moved, stamp_ns = unsorted.points, unsorted.beam, unsorted.moved, scene.stamp_ns
    if moved is None:
        moved = crowd.moving(crowd.compared(memory.looks, stamp_ns), points, beam, unsorted.turning)
        return replace(memory, unsorted=replace(unsorted, moved=moved))
    scan = memory.looks[-1:]
    people = crowd.follow(memory.people, points, moved, beam, stamp_ns, limits.person_memory_s, scan)
    clear_of = [person for person in people if person.counts(stamp_ns)]
    parts = _parts(scene.points[: scene.resting], points, clear_of, stamp_ns)
    scene = Scene(stamp_ns, *parts, scene.fault, scene.blind_ahead, scene.silent_ahead)
    someone_ns = stamp_ns if crowd.about(clear_of, stamp_ns) else memory.someone_ns
    return replace(memory, people=people, scene=scene, unsorted=None, someone_ns=someone_ns)


def _parts(close: Floats, points: Floats, people: list[Person], stamp_ns: int) -> tuple[Floats, int, int]:
    """A scene's returns: all that are `close`, then of `points` those of people who rest, and of those who walk."""
    if not people:
        return close, len(close), len(close)
    theirs = crowd.near(points, people)
    walking = np.array([stamp_ns - person.moved_ns <= crowd.REST_NS for person in people], bool)
    walks = np.asarray(theirs[:, walking].any(axis=1))
    resting = _rows(points, np.asarray(theirs.any(axis=1) & ~walks))
    first = len(close)
    return np.concatenate((close, resting, _rows(points, walks))), first, first + len(resting)


def _rows(points: Floats, which: NDArray[np.bool_]) -> Floats:
    """`points[which]`, four times as fast."""
    return points.take(which.nonzero()[0], axis=0)


def _driven(driven: tuple[Place, ...], base: BaseState, driven_s: float) -> tuple[Place, ...]:
    if driven and base.stamp_ns - driven[0].stamp_ns > driven_s * 1e9:
        driven = driven[1:]
    if driven:
        last = driven[-1].pose
        away = math.hypot(base.pose.x - last.x, base.pose.y - last.y)
        if away < DRIVEN_M and abs(wrap(base.pose.yaw - last.yaw)) < DRIVEN_RAD:
            return (*driven[:-1], Place(base.stamp_ns, last))
    return (*driven[1 - DRIVEN :], Place(base.stamp_ns, base.pose))


def _jumped(trail: Trail, base: BaseState, limits: SafetyLimits) -> bool:
    dt_s = (base.stamp_ns - trail.stamps[-1]) / 1e9
    furthest_m, furthest_rad = JUMP_M + limits.v_max * dt_s, JUMP_RAD + limits.w_max * dt_s
    return dt_s < 0.0 or further(trail.poses[-1], base.pose, furthest_m, furthest_rad)
