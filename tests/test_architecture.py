"""The rules of the house (README, "How the house is built") as a test, so that they cannot rot silently."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("ghal360_robot", "drivers", "calibration")
OURS = set(PACKAGES)
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))

PURE = (
    "ghal360_robot/messages.py",
    "ghal360_robot/brain.py",
    "ghal360_robot/perception/sphere.py",
    "ghal360_robot/perception/wedges.py",
    "ghal360_robot/guidance/",
    "ghal360_robot/intent/",
    "ghal360_robot/safety/",
    "calibration/mounting.py",
)
IMPURE = {"asyncio", "threading", "rerun", "time", "socket", "subprocess", "multiprocessing"}


def imports(path: Path) -> set[str]:
    """Dotted names of every module a file imports, wherever in the file it does."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.fixture(params=FILES, ids=name)
def file(request: pytest.FixtureRequest) -> Path:
    path: Path = request.param
    return path


def test_drivers_know_nothing_of_the_robot_nor_of_each_other(file: Path) -> None:
    parts = file.relative_to(ROOT).parts
    if parts[0] != "drivers":
        return
    for module in imports(file):
        top = module.split(".")
        assert top[0] not in OURS - {"drivers"}, f"{name(file)} imports {module}"
        if top[0] == "drivers" and len(top) > 1 and len(parts) > 2:
            assert top[1] == parts[1], f"{name(file)} imports {module}"


def test_messages_import_nothing_of_ours() -> None:
    modules = imports(ROOT / "ghal360_robot/messages.py")
    assert not {module for module in modules if module.split(".")[0] in OURS}


def test_pure_modules_have_no_clock_no_io_and_no_drivers(file: Path) -> None:
    if not name(file).startswith(PURE):
        return
    tops = {module.split(".")[0] for module in imports(file)}
    assert not tops & (IMPURE | {"drivers"}), f"{name(file)} imports {tops & (IMPURE | {'drivers'})}"


def test_only_the_logbook_imports_rerun(file: Path) -> None:
    if "logbook" in file.parts:
        return
    assert "rerun" not in {module.split(".")[0] for module in imports(file)}


def test_only_the_command_line_prints(file: Path) -> None:
    if "cli" in file.parts:
        return
    tree = ast.parse(file.read_text(encoding="utf-8"))
    calls = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    assert "print" not in calls


def test_nothing_but_simulation_and_command_line_knows_the_simulated_world(file: Path) -> None:
    allowed = ("ghal360_robot/simulation/", "ghal360_robot/cli/", "ghal360_robot/perception/detectors/painted.py")
    if name(file).startswith(allowed) or file.parts[-1] == "robot.py":
        return
    used = {module for module in imports(file) if module.startswith("ghal360_robot.simulation")}
    assert not used, f"{name(file)} imports {used}"


def test_the_wheel_carries_every_package() -> None:
    assert all((ROOT / package / "__init__.py").exists() for package in PACKAGES)
