"""Whole searches in lockstep: world, ideal detector, guidance, intent, steering and the virtual operator."""

from __future__ import annotations

import math
import statistics
import time
from dataclasses import dataclass

import numpy as np
import pytest

from ghal360_robot.guidance.cueing import CueSettings, CueState, step_cue
from ghal360_robot.guidance.policy import RulePolicy
from ghal360_robot.intent.controller import DriveSettings, DriveState, step_drive
from ghal360_robot.intent.exact import ExactFilter, IntentState
from ghal360_robot.intent.head_motion import HeadSettings, HeadState, step_head
from ghal360_robot.messages import Cue, Detection, Detections, Pose2, Twist
from ghal360_robot.perception.tracking import Standpoint, TrackSettings
from ghal360_robot.perception.wedges import SceneState, scene, step_scene
from ghal360_robot.simulation.eyes import Eyes, Sight
from ghal360_robot.simulation.virtual_operator import Temper, start, step
from ghal360_robot.simulation.world import CAMERA_HEIGHT_M, ROBOT_RADIUS_M, Role, World, build_world

TICK_S = 0.02
TICK_NS = 20_000_000
LIMIT_S = 300.0
V_RAMP, W_RAMP = 0.5, 2.0
W_MAX = 1.0
SCAN_YAWS = np.radians(np.arange(-135.0, 136.0, 2.0))
DETECTED_M = 6.0
STOP_M = ROBOT_RADIUS_M + 0.10


@dataclass(frozen=True)
class Search:
    found: bool
    time_s: float
    driven_m: float
    collisions: int
    least_clearance_m: float
    cpu_s: float
    path: tuple[tuple[float, float], ...]


def ideal_detections(world: World, pose: Pose2, stamp_ns: int) -> Detections:
    """Every detectable object in line of sight within reach, at its true direction."""
    found = []
    for item in world.objects:
        if item.role not in {Role.TARGET, Role.CLUTTER}:
            continue
        dx, dy = item.x - pose.x, item.y - pose.y
        if math.hypot(dx, dy) <= DETECTED_M and world.visible(pose.x, pose.y, CAMERA_HEIGHT_M, item):
            yaw = math.remainder(math.atan2(dy, dx) - pose.yaw, math.tau)
            found.append(Detection(item.name, 0.9, yaw, 0.0, 0.05, 0.05))
    return Detections(stamp_ns, 0, "ideal", tuple(found))


def ramped(now: float, wanted: float, rate: float) -> float:
    return now + max(-rate * TICK_S, min(rate * TICK_S, wanted - now))


def stopped_before(points: np.ndarray, twist: Twist) -> Twist:
    """A simple stop: no forward motion with something in the corridor within braking distance."""
    reach = STOP_M + twist.v**2 / (2 * V_RAMP) + 0.05
    ahead = (points[:, 0] > 0) & (np.abs(points[:, 1]) < ROBOT_RADIUS_M + 0.04) & (points[:, 0] < reach)
    return Twist(0.0, twist.w) if ahead.any() else twist


def search(world: World, seed: int) -> Search:
    """One search from start to the operator's press of "found", 50 ticks a second of simulated time."""
    began = time.thread_time()
    pose, twist = world.start, Twist()
    operator = start(Temper(seed=seed), pose, 0)
    head, belief, drive, cue, seen = HeadState(), IntentState(), DriveState(), CueState(), SceneState()
    eyes, intent_filter, armed, head_yaw, presses = Eyes(world), ExactFilter(), False, 0.0, 0
    points = np.empty((0, 2))
    driven, collisions, least, path = 0.0, 0, math.inf, []
    detections = None
    for tick in range(round(LIMIT_S / TICK_S)):
        now_ns = tick * TICK_NS
        if tick % 12 == 0:
            detections = ideal_detections(world, pose, now_ns)
        if tick % 4 == 0:
            ranges = world.ranges(pose.x, pose.y, pose.yaw + SCAN_YAWS)
            points = ranges[:, None] * np.column_stack((np.cos(SCAN_YAWS), np.sin(SCAN_YAWS)))
            points = points[np.isfinite(ranges)]
        if tick * 20 // 50 != (tick - 1) * 20 // 50:
            if len(path) % 2 == 0:
                view = eyes.look(pose, head_yaw, operator.temper.fov)
            operator, message = step(operator, Sight(view, cue.cue, armed, ready=not armed), now_ns)
            head_yaw = message.head.yaw
            armed = armed or message.arm_presses > presses
            presses = message.arm_presses
            head = step_head(HeadSettings(), head, head_yaw + pose.yaw, now_ns)
            belief = intent_filter.step(belief, head.evidence, 0.05)
            if message.found_presses:
                assert view.target_yaw is not None
                break
            path.append((pose.x, pose.y))
        seen = step_scene(TrackSettings(), seen, detections, Standpoint(pose), now_ns)
        allocentric = scene(TrackSettings(), seen, world.target, pose).allocentric
        cue = step_cue(RulePolicy(), CueSettings(seed=seed), cue, allocentric, head_yaw + pose.yaw, now_ns)
        if tick % 2 == 0:
            drive = step_drive(
                DriveSettings(),
                drive,
                intention=intent_filter.intention(belief) if armed else None,
                gaze=head_yaw + pose.yaw,
                pose=pose,
                measured=twist,
                cue_shown=cue.cue is not Cue.NONE,
                points=points,
            )
        safe = stopped_before(points, drive.twist)
        twist = Twist(
            ramped(twist.v, min(safe.v, 0.5), V_RAMP), ramped(twist.w, max(-W_MAX, min(W_MAX, safe.w)), W_RAMP)
        )
        yaw = pose.yaw + twist.w * TICK_S / 2
        pose = Pose2(
            pose.x + twist.v * TICK_S * math.cos(yaw),
            pose.y + twist.v * TICK_S * math.sin(yaw),
            math.remainder(pose.yaw + twist.w * TICK_S, math.tau),
        )
        driven += abs(twist.v) * TICK_S
        if tick % 5 == 0:
            clearance = world.clearance(pose.x, pose.y)
            least = min(least, clearance)
            collisions += clearance < ROBOT_RADIUS_M
    else:
        return Search(False, LIMIT_S, driven, collisions, least, time.thread_time() - began, tuple(path))
    return Search(True, now_ns / 1e9, driven, collisions, least, time.thread_time() - began, tuple(path))


@pytest.mark.parametrize("name", ["office", "home"])
@pytest.mark.parametrize("seed", [0, 3, 4, 6])
def test_a_search_ends_with_the_target_found_and_nothing_touched(name: str, seed: int) -> None:
    result = search(build_world(name, seed), seed)
    assert result.found
    assert result.collisions == 0
    assert result.time_s < 200


def test_the_same_seed_gives_the_same_search() -> None:
    world = build_world("home", 8)
    assert search(world, 8).path == search(world, 8).path


@pytest.mark.campaign
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("name", "median_s"), [("office", 100.0), ("home", 80.0)])
def test_twenty_seeds_of_each_world_are_all_found_without_touching_anything(name: str, median_s: float) -> None:
    results = [search(build_world(name, seed), seed) for seed in range(20)]
    assert all(result.found for result in results)
    assert sum(result.collisions for result in results) == 0
    assert statistics.median(result.time_s for result in results) <= median_s
