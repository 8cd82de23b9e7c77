"""Environments by name and from files, hostile files included."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.tim571.geometry import BEAM_YAW
from ghal360_robot.assembly import lidar_mount
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.experiments.environment_file import from_json, to_json
from ghal360_robot.experiments.environments import ground_for, load_environment
from ghal360_robot.experiments.errors import EnvironmentFileError
from ghal360_robot.experiments.evaluation import PAPER_ROWS, Row, do_piece, gather, pieces_of
from ghal360_robot.experiments.floors import open_floor
from ghal360_robot.experiments.grid import GridMap, ground_of
from ghal360_robot.experiments.ground import UNSEEN
from ghal360_robot.experiments.matterport import NavigationGraph, ground_of_graph, read_matterport
from ghal360_robot.experiments.recorded import recorded_map
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.messages import BaseMode, BaseState, LidarScan, Twist
from ghal360_robot.simulation.lockstep import ideal_detections
from ghal360_robot.simulation.vantage import vantage_pose
from ghal360_robot.simulation.world import build_world

from . import synthetic_scan

SCAN = Path(__file__).parent / "data" / "synthetic_connectivity.json"


def test_a_grid_comes_back_from_its_file_as_it_was(tmp_path: Path) -> None:
    grid = open_floor(2)
    path = tmp_path / "floor.json"
    path.write_text(to_json(grid))
    assert load_environment(str(path)) == grid


def test_floors_are_the_same_every_time_and_differ_by_number() -> None:
    assert open_floor(1) == load_environment("open-1") == open_floor(1)
    assert open_floor(1).rows != open_floor(4).rows


@pytest.mark.parametrize(
    "change",
    [
        {"rows": []},
        {"rows": ["..", "."]},
        {"rows": [".x"]},
        {"rows": ["." * 200] * 200},
        {"rows": "...."},
        {"cell_m": 0},
        {"cell_m": "0.5"},
        {"cell_m": float("nan")},
        {"targets": []},
        {"targets": [{"name": "a", "x": None, "y": 0}]},
        {"targets": [7]},
        {"clutter": {}},
        {"name": ""},
        {"steps": "giant"},
        {"version": 9},
        {"format": None},
    ],
)
def test_an_environment_that_makes_no_sense_is_refused_by_name(change: dict[str, Any]) -> None:
    body = json.loads(to_json(open_floor(0))) | change
    with pytest.raises(EnvironmentFileError, match=r"floor\.json"):
        from_json(body, "floor.json")


def test_files_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "torn.json").write_text('{"format": ')
    for what in (str(tmp_path / "torn.json"), str(tmp_path / "missing.json"), "cellar-3", "open-1-backpack"):
        with pytest.raises(EnvironmentFileError):
            load_environment(what)
    with pytest.raises(EnvironmentFileError, match="unicorn"):
        load_environment("office-1-unicorn")


def test_a_building_has_its_rooms_joined_by_doors() -> None:
    grid = load_environment("office-0-backpack")
    assert isinstance(grid, GridMap)
    world = build_world("office", 0, "backpack")
    ground = ground_for(grid, step_m=1.5, range_m=6.0)
    reached = np.isfinite(ground.path_m[int(np.hypot(*(ground.xy - (world.start.x, world.start.y)).T).argmin())])
    assert reached.mean() > 0.9
    assert all(world.clearance(x, y) > 0.3 for x, y in ground.xy[::25].tolist())


def test_the_shipped_scan_is_what_its_script_makes() -> None:
    connectivity, objects = synthetic_scan.build()
    assert json.loads(SCAN.read_text()) == json.loads(json.dumps(connectivity))
    assert json.loads(SCAN.with_name("synthetic_objects.json").read_text()) == json.loads(json.dumps(objects))


@pytest.fixture(scope="module")
def scan() -> NavigationGraph:
    return read_matterport(SCAN)


def test_a_navigation_graph_includes_what_it_says(scan: NavigationGraph) -> None:
    body = json.loads(SCAN.read_text())
    assert len(scan.ids) == len(body) - 1
    assert scan.targets == ("backpack", "laptop")
    assert not np.diagonal(scan.open_way).any()


def test_a_graphs_target_stands_where_it_was_put(scan: NavigationGraph) -> None:
    ground = ground_of_graph(scan, range_m=6.0)
    for goal, target in zip(ground.goals, synthetic_scan.TARGETS, strict=True):
        assert goal.xy == pytest.approx((target.x, target.y), abs=0.1)
        seen = np.isfinite(goal.bearing)
        truth = np.arctan2(target.x - ground.xy[:, 0], target.y - ground.xy[:, 1])
        assert np.cos(goal.bearing[seen] - truth[seen]) == pytest.approx(1, abs=1e-4)
        assert 0 < seen.mean() < 0.6


def test_steps_of_a_graph_go_to_open_neighbours_in_their_wedge(scan: NavigationGraph) -> None:
    ground = ground_of_graph(scan, range_m=6.0)
    for i, row in enumerate(ground.moves.tolist()):
        for wedge, j in enumerate(row):
            if i != j:
                assert scan.open_way[i, j]
                east, north = ground.xy[j] - ground.xy[i]
                off = np.degrees(np.arctan2(east, north)) - 45 * wedge
                assert abs((off + 180) % 360 - 180) <= 22.6
    assert (ground.spot_wedge != UNSEEN).any(axis=1).all()


def test_a_graph_gives_the_same_experiments(scan: NavigationGraph) -> None:
    rows = (Row("F1", environments=(str(SCAN),)),)
    pieces = pieces_of(rows, [0], 60)
    systems = gather(pieces, [do_piece(piece) for piece in pieces])["F1"]["systems"]
    assert systems["RLGS"]["success"] > systems["FGS"]["success"] - 0.05 > systems["ADV"]["success"]
    assert set(systems["RLGS"]["by_distance"]) <= {"2", "4", "6", "8", "10", "12"}


def viewpoint(**changes: Any) -> list[dict[str, Any]]:
    one = {
        "image_id": "a",
        "pose": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1.5, 0, 0, 0, 1],
        "included": True,
        "visible": [False],
        "unobstructed": [False],
        "height": 1.5,
    }
    return [one | changes]


GOOD_OBJECTS = {
    "format": "ghal360-objects",
    "version": 1,
    "targets": ["cup"],
    "viewpoints": {"a": [{"name": "cup", "heading_deg": 10, "distance_m": 2}]},
}


@pytest.mark.parametrize(
    ("connectivity", "objects"),
    [
        ({}, GOOD_OBJECTS),
        ([], GOOD_OBJECTS),
        ([3], GOOD_OBJECTS),
        (viewpoint(included=False), GOOD_OBJECTS),
        (viewpoint(pose=[1, 2, 3]), GOOD_OBJECTS),
        (viewpoint(pose=["x"] * 16), GOOD_OBJECTS),
        (viewpoint(visible=[1]), GOOD_OBJECTS),
        (viewpoint(unobstructed=[True, False]), GOOD_OBJECTS),
        (viewpoint(image_id=5), GOOD_OBJECTS),
        (viewpoint() * 2, GOOD_OBJECTS),
        (viewpoint(), {}),
        (viewpoint(), GOOD_OBJECTS | {"targets": []}),
        (viewpoint(), GOOD_OBJECTS | {"viewpoints": []}),
        (viewpoint(), GOOD_OBJECTS | {"viewpoints": {"b": []}}),
        (viewpoint(), GOOD_OBJECTS | {"viewpoints": {"a": [{"name": "cup", "heading_deg": 0}]}}),
        (viewpoint(), GOOD_OBJECTS | {"viewpoints": {"a": "cup"}}),
    ],
)
def test_graphs_that_make_no_sense_are_refused(tmp_path: Path, connectivity: Any, objects: Any) -> None:
    (tmp_path / "bad_connectivity.json").write_text(json.dumps(connectivity))
    (tmp_path / "bad_objects.json").write_text(json.dumps(objects))
    with pytest.raises(EnvironmentFileError, match="bad_"):
        read_matterport(tmp_path / "bad_connectivity.json")


def test_a_target_that_stands_in_two_places_is_refused(tmp_path: Path) -> None:
    connectivity = [
        viewpoint(visible=[False] * 2, unobstructed=[False] * 2)[0] | {"image_id": id_} for id_ in ("a", "b")
    ]
    seen = {id_: [{"name": "cup", "heading_deg": heading, "distance_m": 3}] for id_, heading in (("a", 0), ("b", 180))}
    (tmp_path / "two_connectivity.json").write_text(json.dumps(connectivity))
    (tmp_path / "two_objects.json").write_text(json.dumps(GOOD_OBJECTS | {"viewpoints": seen}))
    graph = read_matterport(tmp_path / "two_connectivity.json")
    with pytest.raises(EnvironmentFileError, match="only one"):
        ground_of_graph(graph, range_m=6.0)


WORLD = build_world("home", 4, "backpack")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a robot that was carried around its target: scans, odometry, ideal detections."""
    config = with_overrides(RobotConfig(), {"perception": {"target": "backpack"}})
    mount = lidar_mount(config)
    recorder = Recorder(
        tmp_path_factory.mktemp("runs"), run_id="run", properties={}, config_json=config.model_dump_json()
    )
    poses = [vantage_pose(WORLD, distance_m) for distance_m in np.arange(1.2, 4.2, 0.3).tolist()]
    yaw = np.asarray(BEAM_YAW, np.float32)
    for n, pose in enumerate(poses):
        stamp = recorder.anchor.monotonic_ns + n * 1_000_000_000
        recorder.base_state(BaseState(stamp, BaseMode.DRIVE, pose, Twist(), 90.0))
        direction = pose.yaw + mount.yaw + yaw
        at = (pose.x + mount.x * np.cos(pose.yaw), pose.y + mount.x * np.sin(pose.yaw))
        ranges = WORLD.ranges(*at, direction.astype(np.float64))
        recorder.lidar_scan(LidarScan(stamp + 1, ranges.astype(np.float32), yaw, n, n, n))
        recorder.detections(ideal_detections(WORLD, pose, stamp + 2, n))
    assert recorder.close()
    return recorder.folder


def test_a_recorded_run_becomes_the_floor_that_was_seen(run: Path) -> None:
    grid = recorded_map(run)
    target = WORLD.target_object()
    found = grid.targets[0]
    assert found.name == "backpack"
    # The map was moved so that its corner is the origin; the target says by how much.
    shift = np.array([target.x - found.x, target.y - found.y])
    ground = ground_of(grid, step_m=1.5, range_m=6.0)
    assert len(ground.xy) * grid.cell_m**2 > 6.0
    clearance = np.array([WORLD.clearance(*at) for at in (ground.xy + shift).tolist()])
    assert np.mean(clearance > 0.15) > 0.95
    assert np.isfinite(ground.goals[0].bearing).any()


def test_a_run_that_never_saw_its_target_is_refused(run: Path) -> None:
    with pytest.raises(EnvironmentFileError, match="unicorn"):
        recorded_map(run, "unicorn")


def test_rows_of_the_paper_name_environments_that_exist() -> None:
    for row in PAPER_ROWS:
        for name in row.environments:
            assert isinstance(load_environment(name), GridMap)
