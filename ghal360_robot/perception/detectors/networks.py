"""From a name and what was added under it to a network, and from that to a detector of panoramas."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from ghal360_robot.errors import UsageError
from ghal360_robot.perception.detectors import store
from ghal360_robot.perception.detectors.base import CENTERNET, DETECTORS, DetectorOptions
from ghal360_robot.perception.detectors.errors import WeightsError
from ghal360_robot.perception.detectors.panoramic import PanoramaDetector
from ghal360_robot.perception.tiles import PLANS

if TYPE_CHECKING:
    from pathlib import Path

    from ghal360_robot.perception.detectors.boxes import Network


KINDS = {
    "centernet": "ghal360_robot.perception.detectors.centernet",
}
"""Where each kind of network is; the module's `load(entry, options)` makes it."""


def make(name: str, options: DetectorOptions, folder: Path | None = None) -> PanoramaDetector:
    """A detector of panoramas with this network. Raises UsageError or WeightsError."""
    if options.plan not in PLANS:
        raise UsageError(f"There is no tile plan {options.plan!r}; choose one of {', '.join(PLANS)}.")
    network = make_network(name, options, folder)
    return PanoramaDetector(network, PLANS[options.plan], min_score=options.min_score, thresholds=options.thresholds)


def make_network(name: str, options: DetectorOptions, folder: Path | None = None) -> Network:
    """The network that was added under this name. Raises UsageError or WeightsError."""
    found = store.entry(name, folder)
    if found is None and name == CENTERNET:
        raise WeightsError(
            "The weights of 'centernet' are not on this machine: run `ghal360 detectors add centernet` "
            "(fetches 29 MB with npm, keeps 4 MB), or choose another detector."
        )
    if found is None:
        known = ", ".join(dict.fromkeys((*DETECTORS, CENTERNET, *store.entries(folder))))
        raise UsageError(f"There is no detector {name!r}; choose one of {known}.")
    if found.kind not in KINDS:
        raise WeightsError(f"The detector '{name}' is of the unknown kind '{found.kind}': {store.again(name)}")
    # Imported when needed: onnxruntime is an extra, and torch is seconds of start for those who do without.
    return import_module(KINDS[found.kind]).load(found, options)  # type: ignore[no-any-return]
