"""What every detector offers, and how one is chosen by name."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, cast

from ghal360_robot.errors import UsageError

if TYPE_CHECKING:
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

    def detect(self, rgb: NDArray[np.uint8]) -> list[PixelDetection]:
        """Objects in a picture (height, width, 3). Boxes may cross the seam (see `sphere.PixelBox`)."""
        ...


DETECTORS = {
    "none": "ghal360_robot.perception.detectors.none:NoDetector",
    "painted": "ghal360_robot.perception.detectors.painted:PaintedDetector",
}
"""Where each detector's class is; imported when chosen, because some bring heavy libraries."""


def make_detector(name: str) -> Detector:
    """The detector of that name. Raises UsageError, naming the known ones, for any other."""
    try:
        module, _, kind = DETECTORS[name].partition(":")
    except KeyError:
        known = ", ".join(DETECTORS)
        raise UsageError(f"There is no detector {name!r}; choose one of {known}.") from None
    return cast("Detector", getattr(import_module(module), kind)())
