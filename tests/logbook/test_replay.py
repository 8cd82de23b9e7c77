"""A recorded run decides the same when its inputs go through the same code again, and otherwise when they should."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from ghal360_robot.assembly import lidar_mount, make_brain, make_safety
from ghal360_robot.config import RobotConfig, parse_config, with_overrides
from ghal360_robot.logbook.errors import RecordingNotReadableError
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.logbook.replay import replay
from ghal360_robot.simulation.lockstep import Lockstep
from ghal360_robot.simulation.world import build_world

if TYPE_CHECKING:
    from pathlib import Path

    from ghal360_robot.messages import Applied, Decision, Inputs

SECONDS = 16
CONFIG = with_overrides(RobotConfig(), {"perception": {"target": "backpack"}})


class Recorded:
    """Puts what a robot in simulated time sees and does into a recording."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._seen: set[tuple[str, int]] = set()

    def observe(self, inputs: Inputs, decision: Decision, applied: Applied) -> None:
        messages = {
            self._recorder.base_state: inputs.base,
            self._recorder.lidar_scan: inputs.scan,
            self._recorder.detections: inputs.detections,
            self._recorder.operator: inputs.operator,
        }
        for record, message in messages.items():
            if message is not None and (record.__name__, message.stamp_ns) not in self._seen:
                self._seen.add((record.__name__, message.stamp_ns))
                record(message)  # type: ignore[operator]
        self._recorder.tick(inputs, decision, applied, lateness_ms=0.0, work_ms=0.0)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    recorder = Recorder(
        tmp_path_factory.mktemp("runs"), properties={"robot": "7"}, config_json=CONFIG.model_dump_json()
    )
    robot = Lockstep(build_world("office", 5, "backpack"), CONFIG, 5, Recorded(recorder).observe)
    for _ in range(SECONDS * 50):
        robot.step()
    assert robot.body.distance_m > 0.5
    assert recorder.close()
    return recorder.folder


def test_every_decision_is_the_recorded_one_bit_for_bit(run: Path) -> None:
    with RunReader(run) as reader:
        settings = parse_config(reader.config_json, "run")
        ticks = list(replay(reader, make_brain(settings), make_safety(settings), lidar_mount(settings)))
    assert len(ticks) == SECONDS * 50
    assert [tick.differing for tick in ticks if tick.differing] == []
    assert {tick.decision.cue for tick in ticks} != {ticks[0].decision.cue}
    assert any(tick.applied.twist.v > 0.1 for tick in ticks)


def test_another_policy_is_told_apart_by_its_cues_only_where_it_matters(run: Path) -> None:
    settings = with_overrides(CONFIG, {"guidance": {"policy": "none"}})
    with RunReader(run) as reader:
        ticks = list(replay(reader, make_brain(settings), make_safety(settings), lidar_mount(settings)))
    differing = [tick for tick in ticks if "cue" in tick.differing]
    assert differing
    assert all(tick.decision.cue.value == "none" for tick in ticks)
    assert all(tick.recorded.decision.cue.value != "none" for tick in differing)


def test_slower_limits_change_what_is_applied_but_not_what_was_recorded(run: Path) -> None:
    settings = with_overrides(CONFIG, {"safety": {"v_max": 0.2}})
    with RunReader(run) as reader:
        ticks = list(replay(reader, make_brain(CONFIG), make_safety(settings), lidar_mount(settings)))
    assert max(tick.applied.twist.v for tick in ticks) <= 0.2 + 1e-9
    assert max(tick.recorded.applied.twist.v for tick in ticks) > 0.2


def test_a_run_without_its_beginning_is_refused_in_words(run: Path, tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, properties={"robot": "7"}, config_json=CONFIG.model_dump_json())
    robot = Lockstep(build_world("office", 5, "backpack"), CONFIG, 5, Recorded(recorder).observe)
    robot.tick = 40
    for _ in range(10):
        robot.step()
    assert recorder.close()
    with RunReader(recorder.folder) as reader, pytest.raises(RecordingNotReadableError, match="tick 0 is missing"):
        list(replay(reader, make_brain(CONFIG), make_safety(CONFIG), lidar_mount(CONFIG)))
