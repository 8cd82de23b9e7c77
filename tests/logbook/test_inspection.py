"""The report on a recording says what really is in it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from ghal360_robot.logbook.blueprint import operator_blueprint
from ghal360_robot.logbook.inspection import RecordingReport, inspect_run
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.messages import Applied, ArmState, BaseMode, BaseState, Bookmark, Cue, Decision, Pose2, Twist
from tests.logbook import robot

if TYPE_CHECKING:
    from pathlib import Path

T0 = 5_000_000_000
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> RecordingReport:
    """Ten seconds: 50 ticks/s with one missing, 10 pictures/s with a gap, held back by a person for 2 s."""
    recorder = Recorder(tmp_path_factory.mktemp("runs"), properties={"robot": "7"}, config_json="")
    for k in range(501):
        stamp = T0 + k * robot.TICK_NS
        base = BaseState(stamp - 4_000_000, BaseMode.DRIVE, Pose2(k * 0.01, 0, 0), Twist(0.5, 0), 80)
        recorder.base_state(base)
        held = 100 <= k < 200
        cue = Cue.LEFT if k < 250 else Cue.CONFIRM
        decision = Decision(cue, None, (0,) * 8, None, (0.125,) * 8, k // 200, Twist(0.5, 0), ())
        twist, reasons = (Twist(), ("a person is near",)) if held else (Twist(0.5, 0), ())
        seen = replace(robot.inputs(stamp, k), base=base, scan=None, detections=None)
        if k != 77:
            recorder.tick(seen, decision, Applied(twist, ArmState.ARMED, reasons), float(k % 100), 1.0)
        if k % 5 == 0 and not 50 < k < 100:
            recorder.access_unit(stamp, bytes(1000), k // 5, k == 0, k == 10)
    recorder.bookmark(Bookmark(T0 + 3 * SECOND, "page-1", "the door"))
    recorder.bookmark(Bookmark(T0 + 4 * SECOND, "SIGUSR1"))
    recorder.text(T0, "tim571", "WARN", "no answer")
    recorder.text(T0, "tim571", "INFO", "connected")
    recorder.close()
    return inspect_run(recorder.folder)


def test_duration_rates_and_gaps_are_per_entity(report: RecordingReport) -> None:
    assert report.duration_s == pytest.approx(10.004)
    assert report.properties == {"robot": "7"}
    assert report.damage == ()
    entities = {entity.entity: entity for entity in report.entities}
    assert entities["base/state"].rows == 501
    assert entities["base/state"].rate_hz == pytest.approx(50)
    assert entities["theta/video"].max_gap_s == pytest.approx(1.0)
    assert entities["loop/inputs"].max_gap_s == pytest.approx(0.04)
    assert entities["theta/video"].bytes > 92_000
    assert report.files[0].bytes > 0


def test_video_counts_what_is_missing_and_tainted(report: RecordingReport) -> None:
    assert (report.video.units, report.video.missing) == (92, 9)
    assert (report.video.keyframes, report.video.tainted, report.video.bytes) == (1, 1, 92_000)


def test_ages_and_lateness_are_percentiles_over_the_ticks(report: RecordingReport) -> None:
    assert report.age_ms["base"].median == pytest.approx(4.0)
    assert "operator" not in report.age_ms
    assert (report.lateness_ms.count, report.lateness_ms.max) == (500, 99.0)
    assert report.lateness_ms.median == pytest.approx(49.5, abs=1)


def test_decisions_tell_what_was_shown_meant_driven_and_held_back(report: RecordingReport) -> None:
    decisions = report.decisions
    assert (decisions.ticks, decisions.missing_ticks) == (500, 1)
    assert decisions.cues_shown == {"left": 1, "confirm": 1}
    assert decisions.cue_s == {"left": pytest.approx(5.0), "confirm": pytest.approx(5.0)}
    assert decisions.intentions == {"0": 1, "1": 1, "2": 1}
    assert decisions.armed_s == {"armed": pytest.approx(10.0)}
    assert decisions.distance_m == pytest.approx(5.0)
    assert decisions.stop_s == {"a person is near": pytest.approx(2.0)}


def test_bookmarks_say_when_who_and_why(report: RecordingReport) -> None:
    found = [(mark.at_s, mark.holder, mark.note) for mark in report.bookmarks]
    assert found == [(3.004, "page-1", "the door"), (4.004, "SIGUSR1", "")]


def test_complaints_are_warnings_and_worse(report: RecordingReport) -> None:
    assert report.complaints == ("tim571: no answer",)


def test_the_report_is_one_line_of_json(report: RecordingReport) -> None:
    text = report.to_json()
    assert "\n" not in text
    assert json.loads(text)["decisions"]["distance_m"] == pytest.approx(5.0)


def test_an_empty_recording_has_a_report_too(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, properties={}, config_json="")
    recorder.close()
    report = inspect_run(recorder.folder)
    assert (report.duration_s, report.entities, report.decisions.ticks) == (0.0, (), 0)
    json.loads(report.to_json())


def test_the_layout_can_be_built() -> None:
    assert operator_blueprint().root_container is not None
