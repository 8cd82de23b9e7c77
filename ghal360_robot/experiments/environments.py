"""Environments by name or file: procedural floors, the simulator's buildings, files, navigation graphs, recordings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from ghal360_robot.experiments.environment_file import from_json, read_json
from ghal360_robot.experiments.errors import EnvironmentFileError
from ghal360_robot.experiments.floors import open_floor, room_floor
from ghal360_robot.experiments.grid import GridMap, ground_of
from ghal360_robot.experiments.matterport import CONNECTIVITY, NavigationGraph, ground_of_graph, read_matterport

if TYPE_CHECKING:
    from ghal360_robot.experiments.ground import Ground

Environment = GridMap | NavigationGraph

OPEN = ("open-0", "open-1", "open-2")
ROOMS = ("rooms-0", "rooms-1", "rooms-2")
PATTERN = re.compile(r"(open|rooms|office|home)-(\d{1,6})(?:-([a-z]+))?")
DEFAULT_TARGET = "backpack"


def load_environment(what: str) -> Environment:
    """An environment by name (open-0, rooms-2, office-3-laptop), or by path.

    A path is a JSON file of ours, a Matterport connectivity file, or the folder of a recorded run.
    Raises EnvironmentFileError, which says what was expected.
    """
    named = PATTERN.fullmatch(what)
    if named:
        return _named(named[1], int(named[2]), named[3])
    path = Path(what)
    if path.is_dir():
        from ghal360_robot.experiments.recorded import recorded_map  # noqa: PLC0415 - pulls in the log's reader

        return recorded_map(path)
    if path.name.endswith(CONNECTIVITY):
        return read_matterport(path)
    if not path.exists():
        raise EnvironmentFileError(
            f"there is no environment {what!r}: name open-N, rooms-N, office-N[-target], home-N[-target], "
            "or a file or the folder of a run"
        )
    return from_json(read_json(path), str(path))


def ground_for(environment: Environment, *, step_m: float, range_m: float) -> Ground:
    """The tables that searches run on."""
    if isinstance(environment, NavigationGraph):
        return ground_of_graph(environment, range_m=range_m)
    return ground_of(environment, step_m=step_m, range_m=range_m)


def _named(kind: str, number: int, target: str | None) -> GridMap:
    if kind in {"open", "rooms"}:
        if target:
            raise EnvironmentFileError(f"a floor has its own two targets: name it {kind}-{number}")
        return open_floor(number) if kind == "open" else room_floor(number)
    from ghal360_robot.experiments.buildings import building  # noqa: PLC0415 - pulls in the simulated world

    try:
        return building(kind, number, target or DEFAULT_TARGET)
    except ValueError as error:
        raise EnvironmentFileError(str(error)) from error
