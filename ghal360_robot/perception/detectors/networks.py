"""From a name and what was added under it to a network, and from that to a detector of panoramas."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from ghal360_robot.errors import UsageError
from ghal360_robot.perception.detectors import store
from ghal360_robot.perception.detectors.base import CENTERNET, DETECTORS, DetectorOptions, make_detector
from ghal360_robot.perception.detectors.coco import CLASSES
from ghal360_robot.perception.detectors.errors import WeightsError
from ghal360_robot.perception.detectors.names_file import class_names
from ghal360_robot.perception.detectors.panoramic import PanoramaDetector
from ghal360_robot.perception.names import canonical
from ghal360_robot.perception.tiles import PLANS, TilePlan

if TYPE_CHECKING:
    from pathlib import Path

    from ghal360_robot.perception.detectors.network import Network
    from ghal360_robot.perception.detectors.store import Entry, Proposed


KINDS = {
    "centernet": "ghal360_robot.perception.detectors.centernet",
    "darknet": "ghal360_robot.perception.detectors.darknet",
    "onnx": "ghal360_robot.perception.detectors.onnx",
}
"""Where each kind of network is; the module's `load(entry, options)` makes it."""


def make(name: str, options: DetectorOptions, folder: Path | None = None) -> PanoramaDetector:
    """A detector of panoramas with this network. Raises UsageError or WeightsError."""
    plan = plan_of(options)
    network = make_network(name, options, folder)
    return PanoramaDetector(network, plan, min_score=options.min_score, thresholds=options.thresholds)


def plan_of(options: DetectorOptions) -> TilePlan:
    """Raises UsageError where there is no such plan."""
    if options.plan not in PLANS:
        raise UsageError(f"There is no tile plan {options.plan!r}; choose one of {', '.join(PLANS)}.")
    return PLANS[options.plan]


def make_network(name: str, options: DetectorOptions, folder: Path | None = None) -> Network:
    """The network that was added under this name. Raises UsageError or WeightsError."""
    return load_network(added(name, folder), options)


def class_names_of(name: str, folder: Path | None = None) -> tuple[str, ...]:
    """Every name that the detector can return, without loading a network. Raises UsageError or WeightsError."""
    if name in DETECTORS:
        return make_detector(name).class_names
    found = added(name, folder)
    names = class_names(found.read("names")) if found.has("names") else CLASSES
    return tuple(dict.fromkeys(canonical(each) for each in names))


def added(name: str, folder: Path | None = None) -> Entry:
    """What was added under this name. Raises UsageError or WeightsError."""
    found = store.entry(name, folder)
    if found is None and name == CENTERNET:
        raise WeightsError(
            "The weights of 'centernet' are not on this machine: run `ghal360 detectors add centernet` "
            "(fetches 29 MB with npm, keeps 4 MB), or choose another detector."
        )
    if found is None:
        known = ", ".join(dict.fromkeys((*DETECTORS, CENTERNET, *store.entries(folder))))
        raise UsageError(f"There is no detector {name!r}; choose one of {known}.")
    return found


def load_network(entry: Entry | Proposed, options: DetectorOptions) -> Network:
    """The network of these files. Raises DetectorError, WeightsError."""
    if entry.kind not in KINDS:
        raise WeightsError(
            f"The detector '{entry.name}' is of the unknown kind '{entry.kind}': {store.again(entry.name)}"
        )
    # Imported when needed: onnxruntime is an extra, and torch is seconds of start for those who do without.
    return import_module(KINDS[entry.kind]).load(entry, options)  # type: ignore[no-any-return]
