"""From command-line words to a checked scenario and target; everything wrong is said before anything starts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ghal360_robot.config import with_overrides
from ghal360_robot.errors import UsageError
from ghal360_robot.perception.detectors import store
from ghal360_robot.perception.detectors.base import CENTERNET
from ghal360_robot.perception.detectors.networks import class_names_of
from ghal360_robot.perception.names import canonical
from ghal360_robot.simulation.link import Cut, Scenario
from ghal360_robot.simulation.world import LAYOUTS, TARGETS

if TYPE_CHECKING:
    from pathlib import Path

    from ghal360_robot.config import RobotConfig

SIMULATED_DETECTOR = "painted"
"""What `run --sim` searches the simulated world with unless another detector is asked for: it costs next to nothing."""


def detector_of_demo() -> tuple[str, str]:
    """A real detector where its weights are on this machine; else the simulated world's own, and a sentence why."""
    if CENTERNET in store.entries():
        return CENTERNET, ""
    return SIMULATED_DETECTOR, (
        f"The weights of '{CENTERNET}' are not on this machine, so the world is painted for a detector of its own; "
        f"for a real one run `ghal360 detectors add {CENTERNET}` (29 MB, needs npm and network)."
    )


def checked_scenario(
    *,
    world: str,
    seed: int,
    target: str,
    camera_images: Path | None = None,
    lidar_replay: Path | None = None,
    cuts: list[str] | None = None,
    operator: bool = True,
) -> Scenario:
    """A scenario of these words. Raises UsageError."""
    if world not in LAYOUTS:
        raise UsageError(f"there is no world '{world}': choose one of {', '.join(LAYOUTS)}")
    target = canonical(target)
    if target not in TARGETS:
        raise UsageError(f"there is no '{target}' in the simulated worlds: choose one of {', '.join(TARGETS)}")
    for path, what in ((camera_images, "picture folder"), (lidar_replay, "lidar recording")):
        if path is not None and not path.exists():
            raise UsageError(f"the {what} {path} does not exist")
    if lidar_replay is not None and not lidar_replay.is_file():
        raise UsageError(f"the lidar recording {lidar_replay} is not a file")
    return Scenario(
        world=world,
        seed=seed,
        target=target,
        camera_images=None if camera_images is None else str(camera_images.resolve()),
        lidar_replay=None if lidar_replay is None else str(lidar_replay.resolve()),
        cuts=tuple(Cut.parse(text) for text in cuts or []),
        operator=operator,
    )


def dressed(scenario: Scenario, config: RobotConfig) -> Scenario:
    """The same world looking as its detector needs it: natural for real ones, painted for `painted`."""
    return replace(scenario, painted=config.perception.detector == "painted")


def with_target(config: RobotConfig, target: str | None) -> RobotConfig:
    """The configuration with this target, if its detector knows the class. Raises UsageError."""
    if target is not None:
        config = with_overrides(config, {"perception": {"target": target}})
    wanted, known = canonical(config.perception.target), class_names_of(config.perception.detector)
    if wanted and config.perception.detector != "none" and wanted not in known:
        raise UsageError(
            f"the detector '{config.perception.detector}' does not know '{wanted}': choose one of {', '.join(known)}"
        )
    return config
