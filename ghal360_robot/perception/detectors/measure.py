"""How good and how fast a detector is: average precision on COCO photographs, time per panorama."""

from __future__ import annotations

import contextlib
import io
import json
import os
import platform
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import torch

from ghal360_robot.errors import UsageError
from ghal360_robot.perception.detectors.errors import DetectorError
from ghal360_robot.perception.detectors.network import Network, SquareNetwork
from ghal360_robot.perception.detectors.networks import make_network, plan_of
from ghal360_robot.perception.detectors.panoramic import PanoramaDetector
from ghal360_robot.perception.names import canonical

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.base import DetectorOptions

    Picture = NDArray[np.uint8]

LEAST_SCORE = 0.01
"""Average precision asks for the whole ranking, down to what nobody would act on."""
REPEATS = 12


@dataclass(frozen=True, slots=True)
class Accuracy:
    """COCO's figures (pycocotools) over all classes of the annotations, and how many pictures they are from."""

    ap: float
    ap50: float
    ap75: float
    pictures: int


@dataclass(frozen=True, slots=True)
class Speed:
    """Milliseconds for one panorama: least and median of everything, least of the bare network on the same tiles."""

    threads: int
    least_ms: float
    median_ms: float
    bare_ms: float
    cpu_ms: float
    """Processor time of all threads: what it costs where others want the cores as well."""

    def to_json(self) -> dict[str, Any]:
        return {**{key: round(value, 1) for key, value in asdict(self).items()}, "ratio": round(self.ratio, 3)}

    @property
    def ratio(self) -> float:
        return self.least_ms / self.bare_ms


def accuracy(network: Network, folder: Path, least_score: float = LEAST_SCORE) -> Accuracy:
    """On the photographs of a COCO folder (`annotations/instances_val2017.json`, `val2017/`).

    Raises UsageError where that is no such folder, DetectorError without pycocotools.
    """
    try:
        from pycocotools.coco import COCO  # noqa: PLC0415 - a dependency of development only
        from pycocotools.cocoeval import COCOeval  # noqa: PLC0415
    except ImportError:
        raise DetectorError("Average precision needs pycocotools: pip install pycocotools.") from None
    annotations = folder / "annotations" / "instances_val2017.json"
    if not annotations.is_file():
        raise UsageError(f"{folder} is no COCO folder: {annotations} is missing")
    with contextlib.redirect_stdout(io.StringIO()):  # pycocotools talks a lot
        truth = COCO(str(annotations))
        category = {canonical(item["name"]): item["id"] for item in truth.loadCats(truth.getCatIds())}
        results = [
            row
            for image in truth.loadImgs(truth.getImgIds())
            for row in _rows(network, folder, image, category, least_score)
        ]
        if not results:
            return Accuracy(0.0, 0.0, 0.0, len(truth.getImgIds()))
        judge = COCOeval(truth, truth.loadRes(json.loads(json.dumps(results))), "bbox")
        judge.evaluate()
        judge.accumulate()
        judge.summarize()
    ap, ap50, ap75 = (round(float(value), 4) for value in judge.stats[:3])
    return Accuracy(ap, ap50, ap75, len(truth.getImgIds()))


def speed(name: str, options: DetectorOptions, panorama: Picture, repeats: int = REPEATS) -> Speed:
    """Of a detector and the bare network in it, taken in turns so that other load hits both alike."""
    network = make_network(name, options)
    if not isinstance(network, SquareNetwork):
        raise UsageError(f"the detector '{name}' has no network to be compared with")
    detector = PanoramaDetector(network, plan_of(options))
    batch, _ = network.prepare([tile.cut(panorama) for tile in detector.plan.tiles])
    detector.warm_up()
    everything: list[float] = []
    bare: list[float] = []
    for _ in range(repeats):
        everything.append(_timed(lambda: detector.detect(panorama)))
        bare.append(_timed(lambda: list(network.run(batch))))
    before = time.process_time()
    detector.detect(panorama)
    cpu_ms = (time.process_time() - before) * 1e3
    return Speed(options.threads, min(everything), float(np.median(everything)), min(bare), cpu_ms)


def mosaic(coco: Path | None) -> Picture:
    """A panorama of 1920 x 960 with something to find in it: photographs side by side, or noise without any."""
    canvas = np.random.default_rng(0).integers(0, 255, (960, 1920, 3), np.uint8)
    photographs = sorted((coco / "val2017").glob("*.jpg"))[:8] if coco is not None else ()
    for index, path in enumerate(photographs):
        picture = cv2.imread(str(path))
        if picture is not None:
            left, top = 480 * (index % 4), 160 + 320 * (index // 4)
            canvas[top : top + 320, left : left + 480] = cv2.resize(picture, (480, 320))[:, :, ::-1]
    return canvas


def machine() -> dict[str, Any]:
    """What the figures were taken on."""
    cuda = torch.cuda.get_device_name() if torch.cuda.is_available() else None
    return {"system": platform.platform(), "cpus": os.cpu_count(), "torch": torch.__version__, "cuda": cuda}


def _timed(act: Callable[[], object]) -> float:
    begin = time.perf_counter()
    act()
    return (time.perf_counter() - begin) * 1e3


def _rows(
    network: Network, folder: Path, image: dict[str, Any], category: dict[str, int], least_score: float
) -> list[dict[str, Any]]:
    picture = cv2.imread(str(folder / "val2017" / image["file_name"]))
    if picture is None:
        raise UsageError(f"cannot read the picture {image['file_name']} in {folder / 'val2017'}")
    (found,) = network.detect([cv2.cvtColor(picture, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)], least_score)
    rows = []
    for (left, top, right, bottom), score, kind in zip(
        found.xyxy.tolist(), found.score.tolist(), found.kind, strict=True
    ):
        known = category.get(canonical(network.class_names[kind]))
        if known is not None:
            box = [left, top, right - left, bottom - top]
            rows.append({"image_id": image["id"], "category_id": known, "bbox": box, "score": score})
    return rows
