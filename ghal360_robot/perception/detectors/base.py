"""What every detector offers, and how one is chosen by name."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Literal, Protocol, cast

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from ghal360_robot.perception.sphere import PixelBox


@dataclass(frozen=True, slots=True)
class PixelDetection:
    """One object in a picture: class name, score 0..1, box in pixels of that picture."""

    name: str
    score: float
    box: PixelBox


class Detector(Protocol):
    """Finds objects of known classes in equirectangular RGB pictures; used by one thread at a time."""

    @property
    def name(self) -> str: ...

    @property
    def class_names(self) -> tuple[str, ...]:
        """Every name that `detect` can return."""
        ...

    def warm_up(self) -> None:
        """Do at once what only the first search has to do; called on the thread that searches."""
        ...

    def detect(self, rgb: NDArray[np.uint8]) -> list[PixelDetection]:
        """Objects in a picture (height, width, 3). Boxes may cross the seam (see `sphere.PixelBox`)."""
        ...


DETECTORS = {
    "none": "ghal360_robot.perception.detectors.none:NoDetector",
    "painted": "ghal360_robot.perception.detectors.painted:PaintedDetector",
}
"""Detectors without weights, and where their classes are; imported when chosen."""

CENTERNET = "centernet"
"""The detector whose weights the set-up fetches; all others are what `ghal360 detectors add` was given."""


@dataclass(frozen=True, slots=True)
class DetectorOptions:
    """How a network is run; detectors without weights take none of it."""

    plan: str = "default"
    """One of `tiles.PLANS`."""
    min_score: float | None = None
    """For classes that `thresholds` does not name; None takes the network's own."""
    thresholds: Mapping[str, float] = field(default_factory=dict)
    threads: int = 1
    """CPU threads; one more gains little where the other core is busy, and may cost much."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    precision: Literal["auto", "float32", "bfloat16", "float16"] = "auto"


def make_detector(name: str, options: DetectorOptions = DetectorOptions()) -> Detector:
    """The detector of that name. Raises UsageError for an unknown one, WeightsError where its weights are no good."""
    if name not in DETECTORS:
        # Networks bring torch or onnxruntime with them, which takes seconds to import.
        return import_module("ghal360_robot.perception.detectors.networks").make(name, options)  # type: ignore[no-any-return]
    module, _, kind = DETECTORS[name].partition(":")
    return cast("Detector", getattr(import_module(module), kind)())
