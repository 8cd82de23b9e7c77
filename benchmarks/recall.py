"""How often detectors find what is searched for in rendered pictures, by distance.

    python benchmarks/recall.py --detectors centernet deimv2-femto yolox-nano

A view is one place with the thing in full sight (a television or laptop from within 60 degrees of its front), from
which the robot turns slowly for 2 s; its pictures go through the camera's encoder, the detector and the tracker as in
the robot. `single` is the share of pictures with the thing reported, `fused` the share of views after which it is
believed. `--write` saves the table for experiments without pictures. What else is taken for it, and asked about, is
counted by `benchmarks/patrol.py`. The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ghal360_robot.angles import wrap
from ghal360_robot.assembly import camera_view, detector_options, track_settings
from ghal360_robot.config import RobotConfig
from ghal360_robot.messages import (
    Detections,
    Pose2,
)
from ghal360_robot.perception.detectors.boxes import Boxes
from ghal360_robot.perception.detectors.network import Network
from ghal360_robot.perception.detectors.networks import make_network, plan_of
from ghal360_robot.perception.detectors.panoramic import PanoramaDetector
from ghal360_robot.perception.panorama import around_robot
from ghal360_robot.perception.sphere import PictureSize
from ghal360_robot.perception.tiles import EquirectTile, Tile, TilePlan, settled_yaw
from ghal360_robot.perception.tracking import Standpoint
from ghal360_robot.perception.wedges import Scene, SceneState, scene, step_scene
from ghal360_robot.simulation.encoder import ThetaEncoder
from ghal360_robot.simulation.placement import ROBOT_RADIUS_M
from ghal360_robot.simulation.raycast import Shapes
from ghal360_robot.simulation.recall_table import Row, as_text, config_hash, within
from ghal360_robot.simulation.renderer import PanoramaRenderer
from ghal360_robot.simulation.rooms import CEILING_M
from ghal360_robot.simulation.world import CAMERA_HEIGHT_M, LAYOUTS, TARGETS, World, WorldObject, build_world

EDGES_M = {
    "television": (0.8, 1.5, 2.5, 3.25, 4.0, 5.0, 6.0),
    "laptop": (0.6, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0),
    "bottle": (0.6, 1.0, 1.5, 2.0, 3.0),
    "backpack": (0.6, 1.0, 1.5, 2.0, 3.0, 4.0),
}
LIMIT_M = {"television": 4.0, "laptop": 2.5, "bottle": 1.5, "backpack": 2.0}
"""Within these distances the things have to be found."""
VIEW_S, PICTURE_HZ = 2.0, 2.0
"""A detector looks at least twice a second, so a view has four pictures."""
TURN_RAD_S = 0.25
"""The robot looks around while it waits; also keeps four pictures from being one."""
FRONT_COS = 0.5
AIM_RAD = math.radians(8.0)
"""A report within this and half the thing's width of its direction is of it."""
MARGIN_RAD = math.radians(20.0)
"""Half of what a wide television covers from nearby."""
CAMERA_FPS, BITRATE = 12.0, 6_000_000
NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class View:
    """A place to look from, and which way the robot turns meanwhile."""

    pose: Pose2
    distance_m: float
    turn: float


def views(world: World, near: float, far: float, rng: Generator, count: int) -> Iterator[View]:
    """Free places between two distances with the target in full sight; fewer where there are none."""
    item = world.target_object()
    found = 0
    for _ in range(3000):
        distance, bearing = float(rng.uniform(near, far)), float(rng.uniform(-math.pi, math.pi))
        x, y = item.x + distance * math.cos(bearing), item.y + distance * math.sin(bearing)
        front = (math.sin(item.yaw) * (x - item.x) - math.cos(item.yaw) * (y - item.y)) / distance
        faces = item.name not in {"television", "laptop"} or front >= FRONT_COS
        if faces and world.clearance(x, y) > ROBOT_RADIUS_M and in_full_sight(world, x, y, item):
            yield View(Pose2(x, y, float(rng.uniform(-math.pi, math.pi))), distance, float(rng.choice((-1.0, 1.0))))
            found += 1
        if found == count:
            return


def in_full_sight(world: World, x: float, y: float, item: WorldObject) -> bool:
    """Whether nothing hides the middle, the flanks, the foot or the top of a thing from the camera."""
    others = (other for other in world.objects if other is not item)
    shapes = Shapes.of(others, world.plan.wall_boxes(), CEILING_M)
    eye = np.array([[x, y, CAMERA_HEIGHT_M]])
    cos, sin = math.cos(item.yaw) * item.size[0], math.sin(item.yaw) * item.size[0]
    return all(
        shapes.sees(eye, (item.x + right * cos, item.y + right * sin, item.z + up * item.size[2]))[0]
        for right, up in itertools.product((-0.45, 0.0, 0.45), (0.2, 0.9))
    )


def photographed(renderer: PanoramaRenderer, poses: list[Pose2]) -> Iterator[NDArray[np.uint8]]:
    """What the robot decodes from the camera at these poses."""
    encoder = ThetaEncoder(renderer.width, renderer.height, CAMERA_FPS, BITRATE)
    decoder = av.CodecContext.create("h264", "r")
    for pose in poses:
        picture = renderer.render(pose.x, pose.y, pose.yaw, CAMERA_HEIGHT_M)
        (frame,) = decoder.decode(av.Packet(encoder.encode(picture)))
        yield np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)


class Blinkers:
    """A network that is only asked about the tiles which show one direction: the others cannot show the thing there."""

    def __init__(self, network: Network, plan: TilePlan) -> None:
        self._network, self._plan = network, plan
        self.name, self.class_names = network.name, network.class_names
        self.side, self.default_score = network.side, network.default_score
        self.yaw: float | None = None
        """Direction among the tiles as the plan has them; None looks everywhere."""

    def detect(self, pictures: Sequence[NDArray[np.uint8]], min_score: float) -> list[Boxes]:
        shown = [index for index, tile in enumerate(self._plan.tiles) if self._shows(tile)]
        found = dict(zip(shown, self._network.detect([pictures[i] for i in shown], min_score), strict=True))
        nothing = Boxes(np.empty((0, 4), np.float32), np.empty(0, np.float32), np.empty(0, np.intp))
        return [found.get(index, nothing) for index in range(len(pictures))]

    def _shows(self, tile: Tile) -> bool:
        width = tile.width if isinstance(tile, EquirectTile) else tile.fov
        return self.yaw is None or abs(wrap(self.yaw - tile.yaw)) <= width / 2 + MARGIN_RAD


class Watcher:
    """One detector with the robot's tracker behind it, for one target."""

    def __init__(self, config: RobotConfig, detector: PanoramaDetector, target: str) -> None:
        self._detector, self._target = detector, target
        self._view, self._tracks = camera_view(config), track_settings(config)
        self._state = SceneState()
        self._pictures = 0

    def look(self, picture: NDArray[np.uint8], pose: Pose2, stamp_ns: int) -> tuple[Detections, Scene]:
        """What is in this picture, and what is believed after it."""
        self._pictures += 1
        found = around_robot(
            self._detector.detect(picture),
            PictureSize(picture.shape[1], picture.shape[0]),
            self._view,
            stamp_ns=stamp_ns,
            picture=self._pictures,
            detector=self._detector.name,
        )
        self._state = step_scene(self._tracks, self._state, found, Standpoint(pose), stamp_ns)
        return found, scene(self._tracks, self._state, self._target, pose)


def at_target(item: WorldObject, pose: Pose2, yaw: float) -> bool:
    """Whether a direction in the base frame is that of the thing."""
    dx, dy = item.x - pose.x, item.y - pose.y
    half = math.atan2(max(item.size[:2]) / 2, math.hypot(dx, dy))
    return abs(wrap(math.atan2(dy, dx) - pose.yaw - yaw)) <= AIM_RAD + half


@dataclass(slots=True)
class Tally:
    views: int = 0
    pictures: int = 0
    seen: int = 0
    believed: int = 0
    scores: float = 0.0

    def row(self, detector: str, name: str, world: str, near: float, far: float) -> Row:
        return Row(
            detector, name, world, near, far, self.views,
            single=round(self.seen / self.pictures, 3),
            fused=round(self.believed / self.views, 3),
            score=round(self.scores / self.seen, 3) if self.seen else 0.0,
        )  # fmt: skip


Key = tuple[str, str, str, float, float]
"""Detector, class, world, nearest and farthest distance."""


def watch_view(
    config: RobotConfig,
    detectors: list[PanoramaDetector],
    renderer: PanoramaRenderer,
    view: View,
    tallies: dict[str, list[Tally]],
) -> None:
    """Two seconds from one place, by every detector."""
    item = renderer.world.target_object()
    count = round(VIEW_S * PICTURE_HZ)
    poses = [
        Pose2(view.pose.x, view.pose.y, wrap(view.pose.yaw + view.turn * TURN_RAD_S * index / PICTURE_HZ))
        for index in range(count)
    ]
    pictures = list(photographed(renderer, poses))
    for detector in detectors:
        watcher = Watcher(config, detector, item.name)
        believed = False
        for index, (picture, pose) in enumerate(zip(pictures, poses, strict=True)):
            if isinstance(detector.network, Blinkers):
                bearing = math.atan2(item.y - pose.y, item.x - pose.x) - pose.yaw
                # The tiles stand where the picture says: `Blinkers` knows them in their own places.
                detector.network.yaw = wrap(bearing - settled_yaw(picture, detector.plan.period))
            found, after = watcher.look(picture, pose, round(index / PICTURE_HZ * NS))
            own = [one.score for one in found.objects if one.name == item.name and at_target(item, pose, one.yaw)]
            believed = after.target_yaw is not None and at_target(item, pose, after.target_yaw)
            for tally in tallies[detector.name]:
                tally.pictures += 1
                tally.seen += bool(own)
                tally.scores += max(own, default=0.0)
        for tally in tallies[detector.name]:
            tally.views += 1
            tally.believed += believed


def measure(
    config: RobotConfig, detectors: list[PanoramaDetector], target: str, seeds: range, per_bin: int
) -> list[Row]:
    """Recall of every detector for one class by distance, in both worlds and together."""
    tallies: dict[Key, Tally] = {}
    for world_name, seed in itertools.product(LAYOUTS, seeds):
        renderer = PanoramaRenderer(build_world(world_name, seed, target))
        rng = np.random.default_rng([seed, TARGETS.index(target)])
        for near, far in itertools.pairwise(EDGES_M[target]):
            for view in views(renderer.world, near, far, rng, per_bin):
                mine = {
                    detector.name: [
                        tallies.setdefault((detector.name, target, name, near, far), Tally())
                        for name in (world_name, "all")
                    ]
                    for detector in detectors
                }
                watch_view(config, detectors, renderer, view, mine)
        renderer.close()
    order = sorted(tallies, key=lambda key: (key[2], key[3]))
    return [tallies[key].row(*key) for key in order]


def accepted(rows: list[Row]) -> dict[str, dict[str, Any]]:
    """Share of views within each class's limit after which the thing is believed, by detector and class."""
    shares: dict[str, dict[str, Any]] = {}
    for detector, name in dict.fromkeys((row.detector, row.name) for row in rows):
        shares.setdefault(detector, {})[name] = within(rows, detector, name, LIMIT_M[name]).to_json()
    return shares


def panorama_detector(name: str, config: RobotConfig) -> PanoramaDetector:
    """As the robot makes it, but with blinkers."""
    options = detector_options(config)
    plan = plan_of(options)
    network = Blinkers(make_network(name, options), plan)
    return PanoramaDetector(network, plan, min_score=options.min_score, thresholds=options.thresholds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--detectors", nargs="+", default=["centernet"])
    parser.add_argument("--targets", nargs="+", default=list(TARGETS), choices=TARGETS)
    parser.add_argument("--seeds", type=int, default=8, help="worlds of each kind and target")
    parser.add_argument("--views", type=int, default=1, help="views per world and distance")
    parser.add_argument("--write", type=Path, help="where the table goes, ghal360_robot/simulation/data/recall.json")
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    config = RobotConfig()
    detectors = [panorama_detector(name, config) for name in asked.detectors]
    began = time.monotonic()
    seeds = range(100, 100 + asked.seeds)
    rows: list[Row] = []
    for target in asked.targets:
        rows += measure(config, detectors, target, seeds, asked.views)
        print(as_text([row for row in rows if row.name == target]), file=sys.stderr, flush=True)
    print(as_text(rows))
    perception = config.perception.model_dump(
        mode="json", include={"plan", "score", "scores", "min_score", "believe", "memory_s"}
    )
    setup = {
        "perception": perception,
        "view": {"seconds": VIEW_S, "pictures_hz": PICTURE_HZ, "turn_rad_s": TURN_RAD_S, "bitrate": BITRATE},
        "seeds": [seeds.start, seeds.stop],
        "views_per_bin": asked.views,
        "detectors": asked.detectors,
        "command": f"python benchmarks/recall.py --seeds {asked.seeds} --views {asked.views} "
        f"--detectors {' '.join(asked.detectors)} --targets {' '.join(asked.targets)}",
    }
    document = {"config": setup, "config_hash": config_hash(setup), "rows": [asdict(row) for row in rows]}
    if asked.write is not None:
        asked.write.parent.mkdir(parents=True, exist_ok=True)
        asked.write.write_text(json.dumps(document, indent=1) + "\n", "utf-8")
    summary = {
        "within_limits": accepted(rows),
        "config_hash": document["config_hash"],
        "seconds": round(time.monotonic() - began),
    }
    print(json.dumps(summary))


if __name__ == "__main__":
    main()
