"""A replay with other parts: the table, the second recording, and what the viewer is given."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from ghal360_robot.cli.replay import compare
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.logbook.errors import RecordingNotReadableError
from ghal360_robot.logbook.outcome import Outcome
from ghal360_robot.logbook.pictures import pictures
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.logbook.redetection import redetect
from ghal360_robot.logbook.viewer import find_files
from ghal360_robot.messages import Twist
from ghal360_robot.perception.detectors.base import PixelDetection
from ghal360_robot.perception.sphere import PixelBox
from ghal360_robot.simulation.encoder import ThetaEncoder
from ghal360_robot.simulation.lockstep import Lockstep
from ghal360_robot.simulation.world import build_world
from tests.logbook import robot
from tests.logbook.test_replay import Recorded

if TYPE_CHECKING:
    from pathlib import Path

CONFIG = with_overrides(RobotConfig(), {"perception": {"target": "backpack"}})
SECONDS = 16


class OneThing:
    """Finds the same thing in every picture."""

    name = "one thing"
    class_names = ("backpack",)

    def detect(self, rgb: np.ndarray) -> list[PixelDetection]:
        assert rgb.shape == (160, 320, 3)
        return [PixelDetection("backpack", 0.9, PixelBox(150, 70, 20, 20))]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    recorder = Recorder(tmp_path_factory.mktemp("runs"), properties={}, config_json=CONFIG.model_dump_json())
    simulated = Lockstep(build_world("office", 5, "backpack"), CONFIG, 5, Recorded(recorder).observe)
    encoder = ThetaEncoder(320, 160, 12.0, 400_000)
    picture = np.full((160, 320, 3), 90, np.uint8)
    for k in range(SECONDS * 50):
        simulated.step()
        if k % 8 == 0:
            number = k // 8
            recorder.access_unit(k * 20_000_000, encoder.encode(picture), number, number % 12 == 0, tainted=False)
    assert recorder.close()
    return recorder.folder


def test_other_settings_are_a_table_and_a_second_recording_under_the_firsts_id(run: Path, tmp_path: Path) -> None:
    path = tmp_path / "replayed-slow.rrd"
    with RunReader(run) as reader:
        comparison = compare(reader, with_overrides(CONFIG, {"safety": {"v_max": 0.05}}), overlay_path=path)
        run_id = reader.run_id
    figures = comparison.as_json()
    assert comparison.ticks == SECONDS * 50
    driven = "distance by applied speed, m"
    assert figures["differing_ticks"] > 0
    assert 0.0 < figures["replayed"][driven] < 0.5 * figures["recorded"][driven]
    with RunReader(path) as reader:
        stored = reader.parts[0]._reader.recordings()[0]
        assert (stored.application_id, stored.recording_id) == ("ghal360", run_id)
        assert {entity.partition("/")[0] for entity in reader.entities()} == {"replayed"}
        assert len(list(reader.rows("replayed/cmd/applied"))) > 1
        speeds = [row.values["Scalars:scalars"][0] for row in reader.rows("replayed/cmd/applied")]
        assert max(speeds) <= 0.05 + 1e-9


def test_another_detector_sees_the_pictures_of_the_run_in_the_place_of_the_first(run: Path) -> None:
    seen: list[int] = []
    with RunReader(run) as reader:
        found = list(redetect(reader, OneThing(), rate_hz=4.0, told=lambda d: seen.append(d.stamp_ns)))
        decoded = [stamp for stamp, _ in pictures(reader)]
        recorded = {detections.stamp_ns for detections in reader.detections()}
    assert len(decoded) == len(range(0, SECONDS * 50, 8))
    assert seen == [detections.stamp_ns for detections in found]
    assert set(seen) <= set(decoded)
    assert set(seen) == recorded & set(decoded)
    assert all(thing.name == "backpack" for detections in found for thing in detections.objects)


def test_pictures_between_two_stamps_begin_at_the_first_one_exactly(run: Path) -> None:
    with RunReader(run) as reader:
        stamps = [stamp for stamp, _ in pictures(reader)]
        some = [stamp for stamp, _ in pictures(reader, stamps[17], stamps[29])]
    assert some == stamps[17:30]


def test_figures_add_up_what_held_between_ticks() -> None:
    outcome = Outcome()
    for k in range(101):
        outcome.note(k * 20_000_000, robot.decision(21), robot.applied(400 // 4 * 4))
    figures = outcome.figures()
    assert figures["distance by applied speed, m"] == pytest.approx(0.1 * 2.0)
    assert figures["cues confirm"] == 1
    still = Outcome()
    for k in range(51):
        still.note(k * 20_000_000, robot.decision(25), robot.applied(0))
    assert robot.applied(0).twist == Twist()
    assert still.figures()["held, s: no reason given"] == pytest.approx(1.0)


def test_the_viewer_gets_the_parts_and_the_newest_replay(run: Path, tmp_path: Path) -> None:
    parts = find_files(run, None, with_overlay=True)
    assert [file.name for file in parts] == ["part-000.rrd"]
    overlay = run / "replayed-fgs.rrd"
    overlay.write_bytes(b"RRF2")
    try:
        assert find_files(run, None, with_overlay=True) == [*parts, overlay]
        assert find_files(run, None, with_overlay=False) == parts
        with RunReader(run) as reader:
            assert len(reader.parts) == 1, "a replay's recording is no part of the run"
    finally:
        overlay.unlink()
    with pytest.raises(RecordingNotReadableError, match="no recording"):
        find_files(tmp_path / "nothing", None, with_overlay=True)
    with pytest.raises(RecordingNotReadableError, match="no recording at"):
        find_files(run, tmp_path / "nothing.rrd", with_overlay=True)
