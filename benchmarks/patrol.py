"""How often the robot asks about something that is not what it searches for, on drives through furnished worlds.

    python benchmarks/patrol.py --seconds 3600
    python benchmarks/patrol.py --seconds 900 --tape patrol.tape
    python benchmarks/patrol.py --judge patrol.tape

A robot wanders from room to room, two pictures a second through the camera's encoder and the detector, a lidar with
20 mm of noise. Every drive is judged once for each of the four things that stand in every world. The operator is the
worst one: always looks at what is believed to be the target, wherever that is, and never says anything, so that
whatever can be asked about is. A question is wrong where the thing is not in that direction; one about a computer
monitor in a search for a television is counted by itself, as detectors know but one class of screens. Pictures take
nearly all the time; `--tape` keeps what was found in them, `--judge` thinks about it again with the code as it is now.
The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import math
import pickle
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.random import Generator
from recall import NS, PICTURE_HZ, at_target, panorama_detector, photographed

from drivers.tim571.geometry import BEAM_YAW
from ghal360_robot.angles import wrap
from ghal360_robot.assembly import camera_view, lidar_mount, make_brain
from ghal360_robot.brain import BrainState
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.logbook.errors import MADE_OF_FLIPPED_BITS
from ghal360_robot.messages import (
    STILL,
    BaseMode,
    BaseState,
    Cue,
    Detections,
    Freshness,
    HeadPose,
    Inputs,
    LidarScan,
    OperatorInput,
    Pose2,
    Surroundings,
)
from ghal360_robot.perception.panorama import around_robot
from ghal360_robot.perception.sphere import PictureSize
from ghal360_robot.simulation.renderer import PanoramaRenderer
from ghal360_robot.simulation.view import lidar_view
from ghal360_robot.simulation.world import LAYOUTS, TARGETS, World, build_world
from ghal360_robot.surroundings import look_around

FIRST_SEED = 1000
"""Not among those that recall is measured on."""
TOUR_S = 80.0
SPEED_M_S = 0.4
WAY_CLEAR_M = 0.45
TICKS = 5
"""Of the brain between two pictures: ten a second."""
SCAN_NOISE_M, NEAREST_M, FARTHEST_M = 0.02, 0.05, 25.0
"""Of the lidar."""
TAPE_DAMAGED = (EOFError, pickle.UnpicklingError, ImportError, *MADE_OF_FLIPPED_BITS)
FRESH = Freshness(alive=True, rate_ok=True, valid=True, age_s=0.1)


@dataclass(frozen=True, slots=True)
class Tour:
    """One drive: where, and what was seen from each place."""

    world: str
    seed: int
    target: str
    """What the world was furnished for; all four things are in it."""
    seen: list[tuple[Pose2, Detections, Surroundings]]


def drive(world: World, rng: Generator, seconds: float, step_s: float) -> Iterator[Pose2]:
    """Poses of a robot that wanders from room to room, one every `step_s`."""
    pose, left = world.start, int(seconds / step_s)
    goal = pose
    while left > 0:
        ahead = math.atan2(goal.y - pose.y, goal.x - pose.x)
        away = math.hypot(goal.x - pose.x, goal.y - pose.y)
        turn = wrap(ahead - pose.yaw)
        if away < 0.05:
            goal = next_goal(world, pose, rng)
            continue
        if abs(turn) > 0.1:
            pose = Pose2(pose.x, pose.y, wrap(pose.yaw + math.copysign(min(abs(turn), 0.6 * step_s), turn)))
        else:
            go = min(away, SPEED_M_S * step_s)
            pose = Pose2(pose.x + go * math.cos(ahead), pose.y + go * math.sin(ahead), ahead)
        yield pose
        left -= 1


def next_goal(world: World, pose: Pose2, rng: Generator) -> Pose2:
    """A random place that a straight way leads to, rather a far one."""
    best, farthest = pose, 0.0
    for _ in range(200):
        x, y = float(rng.uniform(0, world.plan.width)), float(rng.uniform(0, world.plan.depth))
        away = math.hypot(x - pose.x, y - pose.y)
        along = np.linspace(0.0, 1.0, 2 + int(away / 0.1))
        clear = world.clearances(pose.x + along * (x - pose.x), pose.y + along * (y - pose.y))
        if away > farthest * rng.uniform(0.5, 1.0) and (clear[1:] > WAY_CLEAR_M).all():
            best, farthest = Pose2(x, y), away
    return best


class Scanner:
    """A noisy lidar on the robot."""

    def __init__(self, world: World, config: RobotConfig, seed: int) -> None:
        self._rng, self._mount = np.random.default_rng(seed), lidar_mount(config)
        self._pose = world.start
        self._see = lidar_view(world, lambda: self._pose)

    def __call__(self, pose: Pose2, stamp_ns: int) -> Surroundings:
        self._pose = pose
        ranges = self._see(stamp_ns)[0] + self._rng.normal(0.0, SCAN_NOISE_M, len(BEAM_YAW))
        ranges[(ranges < NEAREST_M) | (ranges > FARTHEST_M)] = np.nan
        scan = LidarScan(stamp_ns, ranges.astype(np.float32), np.asarray(BEAM_YAW, np.float32), 0, 0, 0)
        return look_around(scan, self._mount)


def toured(config: RobotConfig, detector_name: str, seconds: float, tour_s: float, first_seed: int) -> Iterator[Tour]:
    """Drives of `tour_s` each, office and home by turns, `seconds` in all."""
    detector, view = panorama_detector(detector_name, config), camera_view(config)
    for number in range(max(1, round(seconds / tour_s))):
        seed, name = first_seed + number // len(LAYOUTS), tuple(LAYOUTS)[number % len(LAYOUTS)]
        world = build_world(name, seed, TARGETS[seed % len(TARGETS)])
        scan, renderer = Scanner(world, config, seed), PanoramaRenderer(world)
        detector.warm_up()
        poses = list(drive(world, np.random.default_rng(seed), tour_s, 1 / PICTURE_HZ))
        seen = []
        for index, (pose, picture) in enumerate(zip(poses, photographed(renderer, poses), strict=True)):
            stamp_ns = round((index + 1) / PICTURE_HZ * NS)
            size = PictureSize(picture.shape[1], picture.shape[0])
            boxes = detector.detect(picture)
            found = around_robot(boxes, size, view, stamp_ns=stamp_ns, picture=index + 1, detector=detector.name)
            seen.append((pose, found, scan(pose, stamp_ns)))
        renderer.close()
        yield Tour(name, seed, world.target, seen)


def taped(path: Path) -> Iterator[Tour]:
    """The drives of a tape. Raises SystemExit for one that is not there, is cut off, or is of another version."""
    try:
        tape = path.open("rb")
    except OSError as error:
        raise SystemExit(f"{path} cannot be read ({error.strerror}); --tape writes one.") from error
    with tape:
        while tape.peek(1):
            began = tape.tell()
            try:
                tour = Tour(*pickle.load(tape))  # noqa: S301 - written by this program
            except TAPE_DAMAGED as error:
                raise SystemExit(
                    f"{path}: the drive that begins at byte {began} is damaged, cut off or of another version"
                    f" ({error}); nothing of it and after it was judged. Cut the file there, or drive again."
                ) from error
            yield tour


def judged(config: RobotConfig, tour: Tour, target: str) -> Iterator[dict[str, Any]]:
    """Every question of one drive, searching for one thing."""
    world = build_world(tour.world, tour.seed, tour.target)
    item = next(each for each in world.objects if each.name == target)
    screens = [each for each in world.objects if each.name == "monitor"] if target == "television" else []
    brain, state = make_brain(with_overrides(config, {"perception": {"target": target}})), BrainState()
    at: float | None = None
    asked = False
    for number, (pose, found, around) in enumerate(tour.seen):
        for part in range(TICKS):
            stamp_ns = found.stamp_ns + round(part / TICKS / PICTURE_HZ * NS)
            inputs = Inputs(
                stamp_ns,
                number * TICKS + part,
                BaseState(stamp_ns, BaseMode.DRIVE, pose, STILL, 80.0),
                None,
                found,
                OperatorInput(stamp_ns, HeadPose(at or 0.0), deadman=False),
                dict.fromkeys(("theta", "tim571", "rmp110", "operator"), FRESH),
                surroundings=around,
            )
            state, decision = brain.step(state, inputs)
            at, before = decision.target_yaw, asked
            asked = decision.cue is Cue.CONFIRM
            if asked and not before and at is not None:
                right = at_target(item, pose, at)
                screen = not right and any(at_target(each, pose, at) for each in screens)
                yield {
                    "about": "target" if right else "screen" if screen else "other",
                    "world": f"{tour.world}-{tour.seed}",
                    "target": target,
                    "picture": number,
                    "x": round(pose.x, 2),
                    "y": round(pose.y, 2),
                    "bearing": round(math.atan2(math.sin(pose.yaw + at), math.cos(pose.yaw + at)), 2),
                }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--detector", default="centernet")
    parser.add_argument("--seconds", type=float, default=3600.0, help="simulated seconds of driving, in all")
    parser.add_argument("--tour-s", type=float, default=TOUR_S, help="simulated seconds in one world")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help="of the worlds; each is driven in once")
    parser.add_argument("--tape", type=Path, help="keep what was seen in this file")
    parser.add_argument("--judge", type=Path, help="judge this tape instead of driving")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    config, began = RobotConfig(), time.monotonic()
    tours = (
        taped(given.judge)
        if given.judge
        else toured(config, given.detector, given.seconds, given.tour_s, given.first_seed)
    )
    about: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    driven_s = 0.0
    for tour in tours:
        if given.tape is not None:
            with given.tape.open("ab") as tape:
                pickle.dump((tour.world, tour.seed, tour.target, tour.seen), tape)
        driven_s += len(tour.seen) / PICTURE_HZ
        for target in TARGETS:
            for question in judged(config, tour, target):
                about[question["about"]] += 1
                if question["about"] != "target":
                    wrong[f"{target}: {question['about']}"] += 1
                    print(question, file=sys.stderr)
        print(f"{driven_s:.0f} s driven, questions {dict(about)}", file=sys.stderr, flush=True)
    summary = {
        "driven_s": driven_s,
        "searched_s": driven_s * len(TARGETS),
        "questions": dict(about),
        "wrong": dict(wrong),
        "seconds": round(time.monotonic() - began),
    }
    print(json.dumps(summary))


if __name__ == "__main__":
    main()
