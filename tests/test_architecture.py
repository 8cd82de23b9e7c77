"""The rules of the house (README, "How the house is built") as a test, so that they cannot rot silently."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).parent.parent
PACKAGES = ("ghal360_robot", "drivers", "calibration")
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))

PURE = (
    "ghal360_robot/messages.py",
    "ghal360_robot/brain.py",
    "ghal360_robot/angles.py",
    "ghal360_robot/trail.py",
    "ghal360_robot/surroundings.py",
    "ghal360_robot/export/viewport.py",
    "ghal360_robot/export/ros2_messages.py",
    "ghal360_robot/perception/merge.py",
    "ghal360_robot/perception/names.py",
    "ghal360_robot/perception/panorama.py",
    "ghal360_robot/perception/place.py",
    "ghal360_robot/perception/sphere.py",
    "ghal360_robot/perception/tiles.py",
    "ghal360_robot/perception/tracking.py",
    "ghal360_robot/perception/wedges.py",
    "ghal360_robot/guidance/",
    "ghal360_robot/intent/",
    "ghal360_robot/safety/",
    "calibration/mounting.py",
)
IMPURE = {"asyncio", "threading", "rerun", "time", "socket", "subprocess", "multiprocessing", "drivers"}

KNOWS_THE_WORLD = (
    "ghal360_robot/simulation/",
    "ghal360_robot/cli/",
    "ghal360_robot/bench/",
    "ghal360_robot/experiments/",
    "ghal360_robot/perception/detectors/painted.py",  # its hues are the world's paint, and it says so
)


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@cache
def trees() -> tuple[tuple[str, ast.Module], ...]:
    return tuple((name(path), ast.parse(path.read_text(encoding="utf-8"))) for path in FILES)


@cache
def imports(tree: ast.Module) -> set[str]:
    """Dotted names of every module a file imports, wherever in the file it does."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def offences(
    files: str | tuple[str, ...], forbidden: Callable[[str], bool], allowed: tuple[str, ...] = ()
) -> list[str]:
    """ "file imports module" for every import of `files` that is forbidden."""
    return [
        f"{file} imports {module}"
        for file, tree in trees()
        if file.startswith(files) and not (allowed and file.startswith(allowed))
        for module in sorted(imports(tree))
        if forbidden(module)
    ]


def test_there_are_files_to_check_in_every_package() -> None:
    assert {name(path).split("/")[0] for path in FILES} == set(PACKAGES)
    assert all(any(name(path).startswith(pure) for path in FILES) for pure in PURE)


def test_imports_are_absolute() -> None:
    relative = [
        file
        for file, tree in trees()
        if any(isinstance(node, ast.ImportFrom) and node.level for node in ast.walk(tree))
    ]
    assert relative == []


def test_drivers_know_nothing_of_the_robot() -> None:
    assert offences("drivers/", lambda module: module.split(".")[0] in {"ghal360_robot", "calibration"}) == []


@pytest.mark.parametrize("driver", ["theta_v", "rmp110", "tim571"])
def test_no_driver_knows_another(driver: str) -> None:
    def another(module: str) -> bool:
        parts = module.split(".")
        return parts[0] == "drivers" and len(parts) > 1 and parts[1] != driver

    assert offences(f"drivers/{driver}/", another) == []


def test_messages_import_nothing_of_ours() -> None:
    assert offences("ghal360_robot/messages.py", lambda module: module.split(".")[0] in PACKAGES) == []


def test_pure_modules_have_no_clock_no_io_and_no_drivers() -> None:
    assert offences(PURE, lambda module: module.split(".")[0] in IMPURE) == []


def test_only_the_logbook_imports_rerun() -> None:
    assert offences("", lambda module: module.split(".")[0] == "rerun", ("ghal360_robot/logbook/",)) == []


def test_only_simulation_bench_and_command_line_know_the_simulated_world() -> None:
    assert offences("", lambda module: module.startswith("ghal360_robot.simulation"), KNOWS_THE_WORLD) == []


def test_only_the_command_line_prints() -> None:
    printing = [
        file
        for file, tree in trees()
        if not file.startswith("ghal360_robot/cli/")
        and any(
            isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
            for node in ast.walk(tree)
        )
    ]
    assert printing == []
