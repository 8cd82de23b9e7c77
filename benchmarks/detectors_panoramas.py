"""Detectors on panoramas: photographs composed into spheres, a real corridor without objects, and turned panoramas.

    python benchmarks/detectors_panoramas.py composed|corridor|turned [--detector centernet] [--plan default] ...

Composed: five COCO photographs, each 60 degrees wide, at known directions of a grey sphere; average precision on boxes
of yaw and pitch, and recall by wedge and by pitch at the detector's own threshold. Corridor: pictures in which nothing
is to be found. Turned: how many of the objects found are found again (same class, overlap 0.5) when the panorama is
turned by every multiple of 15 degrees.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from math import pi, radians, tau
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from ghal360_robot.guidance.egocentric import wedge_of
from ghal360_robot.perception.detectors.base import DetectorOptions
from ghal360_robot.perception.detectors.centernet import CenterNet
from ghal360_robot.perception.detectors.compute import Compute
from ghal360_robot.perception.detectors.network import Network
from ghal360_robot.perception.detectors.networks import make_network
from ghal360_robot.perception.detectors.panoramic import PanoramaDetector
from ghal360_robot.perception.detectors.store import entry
from ghal360_robot.perception.merge import overlap
from ghal360_robot.perception.names import canonical
from ghal360_robot.perception.sphere import PictureSize, SphereBox, sphere_box
from ghal360_robot.perception.tiles import PLANS

SIZE = (1920, 960)
PHOTO_WIDTH = radians(60)
LEAST_SCORE = 0.05
WIDE = "full-wide"
"""The bare panorama on an input of twice the side, so that its shape costs no pixels: CenterNet only."""
DATA = Path(__file__).parent.parent.parent / "shared" / "data"


@dataclass(frozen=True)
class Scene:
    """A panorama and what is in it."""

    picture: np.ndarray
    truth: list[tuple[str, SphereBox]]


def composed(coco: Path, pitch: float, size: tuple[int, int], shift: int = 0) -> list[Scene]:
    """All photographs of a COCO folder, five to a panorama."""
    data = json.loads((coco / "annotations" / "instances_val2017.json").read_text())
    names = {item["id"]: canonical(item["name"]) for item in data["categories"]}
    images = sorted(data["images"], key=lambda item: item["id"])
    scenes = []
    for first in range(0, len(images) - 4, 5):
        canvas = np.full((size[1], size[0], 3), 110, np.uint8)
        truth: list[tuple[str, SphereBox]] = []
        for place, image in enumerate(images[first : first + 5]):
            yaw = tau * place / 5 + radians(7 * first + shift)
            picture = cv2.imread(str(coco / "val2017" / image["file_name"]))[:, :, ::-1]
            paste(canvas, picture, yaw, pitch)
            for item in data["annotations"]:
                if item["image_id"] == image["id"] and not item.get("iscrowd"):
                    box = seen_as(item["bbox"], picture.shape[1], picture.shape[0], yaw, pitch)
                    truth.append((names[item["category_id"]], box))
        scenes.append(Scene(canvas, truth))
    return scenes


def paste(canvas: np.ndarray, picture: np.ndarray, yaw: float, pitch: float) -> None:
    """Draw a photograph as a flat picture that hangs in a direction, at right angles to it."""
    height, width = canvas.shape[:2]
    lon = pi - (np.arange(width) + 0.5) * tau / width - yaw
    lat = pi / 2 - (np.arange(height) + 0.5) * pi / height
    lon, lat = np.meshgrid(lon, lat)
    x, y, z = np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)
    depth = np.maximum(np.cos(pitch) * x + np.sin(pitch) * z, 1e-6)
    focal = picture.shape[1] / 2 / np.tan(PHOTO_WIDTH / 2)
    u = picture.shape[1] / 2 - focal * y / depth
    v = picture.shape[0] / 2 - focal * (np.cos(pitch) * z - np.sin(pitch) * x) / depth
    inside = (depth > 1e-3) & (u >= 0) & (u < picture.shape[1]) & (v >= 0) & (v < picture.shape[0])
    # The photographs have more pixels per degree than the panorama: blur what could alias.
    sigma = max(0.0, focal / (width / tau) - 1) / 2
    soft = cv2.GaussianBlur(picture, (0, 0), sigma) if sigma > 0.1 else picture
    drawn = cv2.remap(soft, (u - 0.5).astype(np.float32), (v - 0.5).astype(np.float32), cv2.INTER_LINEAR)
    canvas[inside] = drawn[inside]


def seen_as(bbox: list[float], width: int, height: int, yaw: float, pitch: float) -> SphereBox:
    """The directions around a box (left, top, width, height) of a photograph, from points along its border."""
    focal = width / 2 / np.tan(PHOTO_WIDTH / 2)
    left, top, across, down = bbox
    t = np.linspace(0, 1, 50)
    u = np.concatenate((left + t * across, left + t * across, np.full(50, left), np.full(50, left + across)))
    v = np.concatenate((np.full(50, top), np.full(50, top + down), top + t * down, top + t * down))
    right, up = (u - width / 2) / focal, (height / 2 - v) / focal
    ahead, lift = np.cos(pitch) - up * np.sin(pitch), np.sin(pitch) + up * np.cos(pitch)
    lon, lat = np.arctan2(-right, ahead), np.arctan2(lift, np.hypot(ahead, right))
    middle = (lon.max() + lon.min()) / 2
    return SphereBox(
        float((yaw + middle + pi) % tau - pi),
        float((lat.max() + lat.min()) / 2),
        float(lon.max() - lon.min()),
        float(lat.max() - lat.min()),
    )


def found_in(detector: PanoramaDetector, picture: np.ndarray) -> list[tuple[str, float, SphereBox]]:
    size = PictureSize(picture.shape[1], picture.shape[0])
    return [(item.name, item.score, sphere_box(item.box, size)) for item in detector.detect(picture)]


def average_precision(results: list[list[tuple[str, float, SphereBox]]], scenes: list[Scene]) -> tuple[float, float]:
    """COCO's AP and AP50 (101 recalls, classes that occur) with overlap in yaw and pitch."""
    classes = sorted({name for scene in scenes for name, _ in scene.truth})
    steps = np.arange(0.5, 0.96, 0.05)
    table = np.zeros((len(classes), len(steps)))
    for row, name in enumerate(classes):
        total = sum(each == name for scene in scenes for each, _ in scene.truth)
        for column, step in enumerate(steps):
            hits: list[tuple[float, bool]] = []
            for found, scene in zip(results, scenes, strict=True):
                open_ = [box for each, box in scene.truth if each == name]
                for each, score, box in sorted(found, key=lambda item: -item[1]):
                    if each != name:
                        continue
                    best = max(open_, key=lambda other: overlap(box, other), default=None)
                    hit = best is not None and overlap(box, best) >= step
                    if hit and best is not None:
                        open_.remove(best)
                    hits.append((score, hit))
            table[row, column] = _interpolated(hits, total)
    return float(table.mean()), float(table[:, 0].mean())


def _interpolated(hits: list[tuple[float, bool]], total: int) -> float:
    hits.sort(key=lambda item: -item[0])
    right = np.cumsum([hit for _, hit in hits])
    if not len(right):
        return 0.0
    precision = np.maximum.accumulate((right / np.arange(1, len(right) + 1))[::-1])[::-1]
    at = np.searchsorted(right / total, np.linspace(0, 1, 101), side="left")
    return float(np.mean([precision[i] if i < len(precision) else 0.0 for i in at]))


def recall(results: list[list[tuple[str, float, SphereBox]]], scenes: list[Scene], score: float) -> dict[str, Any]:
    """Share of objects of at least 4 degrees found (same class, overlap 0.5) at a threshold, by world wedge."""
    hits, totals = np.zeros(8), np.zeros(8)
    for found, scene in zip(results, scenes, strict=True):
        for name, box in scene.truth:
            if min(box.width, box.height) < radians(4):
                continue
            wedge = wedge_of(-box.yaw)
            totals[wedge] += 1
            hits[wedge] += any(n == name and s >= score and overlap(b, box) >= 0.5 for n, s, b in found)
    by_wedge = [round(float(hit / max(total, 1)), 3) for hit, total in zip(hits, totals, strict=True)]
    return {"all": round(float(hits.sum() / totals.sum()), 3), "by_wedge": by_wedge, "objects": int(totals.sum())}


def run_composed(arguments: argparse.Namespace, network: Network) -> dict[str, Any]:
    report: dict[str, Any] = {}
    for pitch_deg in (0, -30):
        scenes = composed(arguments.coco, radians(pitch_deg), tuple(arguments.size))
        for plan in arguments.plan:
            used, chosen = (wide(network), PLANS["full"]) if plan == WIDE else (network, PLANS[plan])
            detectors = [PanoramaDetector(used, chosen, min_score=LEAST_SCORE) for _ in scenes]
            results = [found_in(each, scene.picture) for each, scene in zip(detectors, scenes, strict=True)]
            ap, ap50 = average_precision(results, scenes)
            report[f"{plan} pitch {pitch_deg}"] = {
                "ap": round(ap, 4),
                "ap50": round(ap50, 4),
                "recall": recall(results, scenes, network.default_score),
            }
            print(plan, pitch_deg, json.dumps(report[f"{plan} pitch {pitch_deg}"]), flush=True)
    return report


def wide(network: Network) -> Network:
    found = entry("centernet")
    if not isinstance(network, CenterNet) or found is None:
        return network
    return CenterNet(found.read("json"), found.read("bin"), Compute(), 2 * network.side)


def run_corridor(arguments: argparse.Namespace, network: Network) -> dict[str, Any]:
    report = {}
    for path in sorted((arguments.panoramas / "theta_v").glob("*.jpg")):
        picture = cv2.cvtColor(cv2.resize(cv2.imread(str(path)), SIZE, interpolation=cv2.INTER_AREA), cv2.COLOR_BGR2RGB)
        for plan in arguments.plan:
            found = found_in(PanoramaDetector(network, PLANS[plan]), picture)
            report[f"{plan} {path.stem[:8]}"] = [f"{name} {score:.2f}" for name, score, _ in found]
    return report


def run_turned(arguments: argparse.Namespace, network: Network) -> dict[str, Any]:
    """Share of the objects of the first picture that each of the 23 turned ones shows as well.

    `kept`: the detector sees the turns one after the other, as a robot does that turns on the spot. `kept_alone`: each
    turned picture is the first that a detector sees.
    """
    panoramas = [
        cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
        for path in sorted((arguments.panoramas / "polyhaven").glob("*.jpg"))
    ]
    panoramas += [scene.picture for scene in composed(arguments.coco, 0.0, tuple(arguments.size))]
    report: dict[str, Any] = {}
    for plan in arguments.plan:
        total, kept = 0, {"kept": 0, "kept_alone": 0}
        for picture in panoramas[: arguments.limit]:
            going_on = PanoramaDetector(network, PLANS[plan])
            first = turned(going_on, picture, 0)
            for step in range(1, 24):
                alone = PanoramaDetector(network, PLANS[plan])
                for which, detector in (("kept", going_on), ("kept_alone", alone)):
                    found = turned(detector, picture, step)
                    kept[which] += sum(
                        any(n == name and overlap(b, box) >= 0.5 for n, _, b in found) for name, _, box in first
                    )
                total += len(first)
        report[plan] = {**{key: round(value / total, 4) for key, value in kept.items()}, "objects": total // 23}
        print(plan, json.dumps(report[plan]), flush=True)
    return report


def turned(detector: PanoramaDetector, picture: np.ndarray, step: int) -> list[tuple[str, float, SphereBox]]:
    """What is found in the panorama turned by so many times 15 degrees, turned back."""
    pixels = step * picture.shape[1] // 24
    yaw = pixels * tau / picture.shape[1]
    found = found_in(detector, np.roll(picture, pixels, axis=1))
    return [(name, score, replace(box, yaw=(box.yaw + yaw + pi) % tau - pi)) for name, score, box in found]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("composed", "corridor", "turned"))
    parser.add_argument("--detector", default="centernet")
    parser.add_argument("--plan", nargs="+", default=["default"], choices=(*PLANS, WIDE))
    parser.add_argument("--coco", type=Path, default=DATA / "coco50")
    parser.add_argument("--panoramas", type=Path, default=DATA / "panoramas")
    parser.add_argument("--size", type=int, nargs=2, default=SIZE)
    parser.add_argument("--limit", type=int, default=1000)
    parser.add_argument("--precision", default="auto")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    network = make_network(arguments.detector, DetectorOptions(precision=arguments.precision))
    report = {"composed": run_composed, "corridor": run_corridor, "turned": run_turned}[arguments.what](
        arguments, network
    )
    print(json.dumps({"what": arguments.what, "detector": arguments.detector, "results": report}))


if __name__ == "__main__":
    main()
