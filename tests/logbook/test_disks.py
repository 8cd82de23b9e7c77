"""Where a recording goes when disks fill, fail, vanish and come back."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.logbook import store
from ghal360_robot.logbook.disk import Disk, Level, Watermarks
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.logbook.settings import RecorderSettings
from ghal360_robot.messages import Bookmark
from tests.logbook import robot

if TYPE_CHECKING:
    from pathlib import Path

T0 = 1_000_000_000_000_000_001
MARKS = Watermarks(warn=100, no_video=50, stop=10)
GROUP = 5


class FakeDisks:
    """Says how much is free in each directory, instead of the operating system."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, free: int = 1000) -> None:
        self.free: dict[str, int] = {}
        self.default = free
        monkeypatch.setattr(store, "look_at", self.look_at)

    def look_at(self, directory: Path, marks: Watermarks, before: Level = Level.FINE) -> Disk:
        free = self.free.get(directory.parent.name, self.default)
        return Disk(directory, marks.level(free, before), free)


@pytest.fixture
def disks(monkeypatch: pytest.MonkeyPatch) -> FakeDisks:
    monkeypatch.setattr("ghal360_robot.logbook.writer.LOOK_PERIOD_S", 0.1)
    return FakeDisks(monkeypatch)


def feed(recorder: Recorder, first: int, count: int) -> None:
    """Pictures in groups of five, and a telegram with each."""
    for k in range(first, first + count):
        recorder.access_unit(T0 + k, b"picture %d" % k, k, k % GROUP == 0, tainted=False)
        recorder.lidar_telegram(T0 + k, b"telegram %d" % k)


def settled(recorder: Recorder) -> None:
    robot.wait_for(lambda: recorder.stats.queued == 0)
    for _turn in ("the one that took it", "one that writes it", "and one after it"):
        spent = recorder.stats.writer_cpu_s  # told at the end of every turn of the writer's
        robot.wait_for(lambda spent=spent: recorder.stats.writer_cpu_s != spent)  # type: ignore[misc]


def begun(tmp_path: Path) -> Recorder:
    """A recorder with two groups safely in its file."""
    recorder = Recorder(tmp_path, properties={}, config_json="", settings=RecorderSettings(watermarks=MARKS))
    feed(recorder, 0, 10)
    settled(recorder)
    return recorder


@given(st.integers(0, 200), st.sampled_from(Level))
def test_less_room_is_never_a_better_level_and_leaving_a_level_takes_more_than_entering_it(
    free: int, before: Level
) -> None:
    level = MARKS.level(free, before)
    assert level >= MARKS.level(free + 1, before)
    assert level >= MARKS.level(free)
    if free > 110:
        assert level is Level.FINE


def test_below_the_second_mark_video_stays_away_and_comes_back_with_the_half_minute_before(
    tmp_path: Path, disks: FakeDisks
) -> None:
    recorder = begun(tmp_path)
    disks.default = 40
    robot.wait_for(lambda: bool(recorder.stats.not_recorded))
    assert "video is not recorded: only 0 MB left" in recorder.stats.not_recorded[0]
    feed(recorder, 10, 10)
    settled(recorder)
    with RunReader(recorder.folder) as reader:
        assert len(list(reader.telegrams())) == 20
        assert len(list(reader.access_units())) == 10
    disks.default = 1000
    robot.wait_for(lambda: not recorder.stats.not_recorded)
    feed(recorder, 20, 10)
    assert recorder.close()
    with RunReader(recorder.folder) as reader:
        assert [unit.sequence for unit in reader.access_units()] == list(range(30))
        assert any("video is not recorded any more" in text.text for text in reader.texts())


def test_below_the_last_mark_the_file_is_ended_and_everything_is_kept_until_there_is_room(
    tmp_path: Path, disks: FakeDisks
) -> None:
    recorder = begun(tmp_path)
    disks.default = 5
    robot.wait_for(lambda: recorder.stats.failed is not None)
    assert "nothing is recorded: only 0 MB left" in recorder.stats.not_recorded[0]
    feed(recorder, 10, 10)
    settled(recorder)
    with RunReader(recorder.folder) as reader:
        assert reader.damage == [], "ended properly while there was room for its footer"
        assert len(list(reader.access_units())) == 10
    disks.default = 1000
    robot.wait_for(lambda: recorder.stats.failed is None)
    feed(recorder, 20, 10)
    assert recorder.close()
    assert recorder.stats.dropped_video == recorder.stats.dropped_rest == 0
    with RunReader(recorder.folder) as reader:
        assert len(reader.parts) == 2
        assert [unit.sequence for unit in reader.access_units()] == list(range(30))
        assert [t.data for t in reader.telegrams()] == [b"telegram %d" % k for k in range(30)]


def test_a_recording_goes_on_in_the_second_place_and_is_read_as_one(tmp_path: Path, disks: FakeDisks) -> None:
    settings = RecorderSettings(second_directory=tmp_path / "second", watermarks=MARKS)
    recorder = Recorder(tmp_path / "first", properties={"robot": "7"}, config_json="{}", settings=settings)
    feed(recorder, 0, 10)
    settled(recorder)
    disks.free["first"] = 20
    robot.wait_for(lambda: recorder.stats.part == "part-001.rrd")
    feed(recorder, 10, 10)
    assert recorder.close()
    second = tmp_path / "second" / recorder.run_id
    assert [file.name for file in recorder.folder.glob("*.rrd")] == ["part-000.rrd"]
    assert [file.name for file in second.glob("*.rrd")] == ["part-001.rrd"]
    for folder in (recorder.folder, second):
        with RunReader(folder) as reader:
            assert [unit.sequence for unit in reader.access_units()] == list(range(20))
            assert reader.properties == {"robot": "7"}
    assert json.loads((second / "meta.json").read_text())["rows"]["dropped_video"] == 0


def test_a_folder_removed_at_the_last_moment_costs_no_row_either(tmp_path: Path) -> None:
    recorder = begun(tmp_path)
    feed(recorder, 10, 10)
    shutil.rmtree(recorder.folder)
    assert recorder.close()
    with RunReader(recorder.folder) as reader:
        assert [unit.sequence for unit in reader.access_units()] == list(range(20))
        assert [t.data for t in reader.telegrams()] == [b"telegram %d" % k for k in range(20)]


def test_a_folder_removed_under_the_recorders_hands_is_put_back_with_all_its_rows(tmp_path: Path) -> None:
    recorder = begun(tmp_path)
    shutil.rmtree(recorder.folder)
    feed(recorder, 10, 10)
    robot.wait_for(lambda: recorder.stats.part == "part-001.rrd")
    feed(recorder, 20, 10)
    assert recorder.close()
    with RunReader(recorder.folder) as reader:
        assert [unit.sequence for unit in reader.access_units()] == list(range(30))
        assert [t.data for t in reader.telegrams()] == [b"telegram %d" % k for k in range(30)]
        assert any("put back" in text.text for text in reader.texts())
    assert json.loads((recorder.folder / "meta.json").read_text())["run_id"] == recorder.run_id


@pytest.mark.parametrize("by", ["bytes", "seconds"])
def test_a_part_ends_before_a_key_picture_and_every_part_can_be_read_alone(tmp_path: Path, by: str) -> None:
    settings = RecorderSettings(watermarks=MARKS)
    settings = replace(settings, part_bytes=1) if by == "bytes" else replace(settings, part_s=0.001)
    recorder = Recorder(tmp_path, properties={"robot": "7"}, config_json="{}", settings=settings)
    for first in range(0, 20, GROUP):
        feed(recorder, first, GROUP)
        tick = first
        recorder.tick(robot.inputs(T0 + first, tick), robot.decision(7), robot.applied(7), 0.0, 0.0)
        settled(recorder)
    assert recorder.close()
    parts = sorted(recorder.folder.glob("part-*.rrd"))
    assert len(parts) >= 4
    for part in parts[1:]:
        with RunReader(part) as reader:
            assert (reader.properties, reader.config_json) == ({"robot": "7"}, "{}")
            assert reader.damage == []
            units = list(reader.access_units())
            assert units[0].keyframe
            assert all(tick.decision == robot.decision(7) for tick in reader.ticks())
    with RunReader(recorder.folder) as reader:
        assert [unit.sequence for unit in reader.access_units()] == list(range(20))
        assert len(list(reader.ticks())) == 4


def test_around_a_bookmark_video_is_recorded_from_before_it_on(tmp_path: Path) -> None:
    settings = RecorderSettings(watermarks=MARKS, video_always=False)
    recorder = Recorder(tmp_path, properties={}, config_json="", settings=settings)
    feed(recorder, 0, 10)
    settled(recorder)
    with RunReader(recorder.folder) as reader:
        assert list(reader.access_units()) == []
        assert len(list(reader.telegrams())) == 10
    recorder.bookmark(Bookmark(T0 + 9, "page-1", "something fell"))
    feed(recorder, 10, 10)
    assert recorder.close()
    assert recorder.stats.not_recorded == ()
    with RunReader(recorder.folder) as reader:
        assert [unit.sequence for unit in reader.access_units()] == list(range(20))
        assert list(reader.bookmarks()) == [Bookmark(T0 + 9, "page-1", "something fell")]
        assert [text.text for text in reader.texts() if text.source == "bookmark"] == ["page-1: something fell"]
    (mark,) = json.loads((recorder.folder / "meta.json").read_text())["bookmarks"]
    assert (mark["note"], mark["part"]) == ("something fell", "part-000.rrd")


def test_an_emergency_stop_is_a_bookmark_once(recorder: Recorder) -> None:
    for k in range(30, 70):
        recorder.tick(robot.inputs(T0 + k, k), robot.decision(k), robot.applied(k), 0.0, 0.0)
    assert [mark.note.partition(":")[0] for mark in recorder.bookmarks] == ["emergency stop"]


def test_meta_lists_the_first_hundred_bookmarks_and_the_recording_all_of_them_cut_to_size(recorder: Recorder) -> None:
    for k in range(105):
        recorder.bookmark(Bookmark(T0 + k, "x" * 1000, f"{k}" + "y" * 1000))
    assert recorder.close()
    with RunReader(recorder.folder) as reader:
        marks = list(reader.bookmarks())
    assert [mark.note[:3].rstrip("y") for mark in marks] == [f"{k}" for k in range(105)]
    assert {(len(mark.holder), len(mark.note)) for mark in marks} == {(64, 200)}
    assert len(recorder.bookmarks) == 100


def test_meta_says_what_the_run_was_and_how_it_ended(tmp_path: Path) -> None:
    recorder = Recorder(
        tmp_path, properties={"robot": "nr 7"}, config_json='{"a": 1}', calibration_json='{"lidar_x_m": 0.2}'
    )
    feed(recorder, 0, 5)
    running = json.loads((recorder.folder / "meta.json").read_text())
    assert recorder.close()
    ended = json.loads((recorder.folder / "meta.json").read_text())
    assert "ended" not in running
    assert ended.items() >= running.items()
    assert ended["robot"] == "nr 7"
    assert len(ended["config_sha256"]) == len(ended["calibration_sha256"]) == 64
    assert set(ended["clock"]) >= {"synchronized"}
    assert ended["versions"]["rerun-sdk"] == "0.41.0"
    assert ended["rows"]["written"] == recorder.stats.written >= 10
    assert ended["seconds"] >= 0


def test_a_disk_that_cannot_be_written_at_the_start_is_passed_over_for_the_second(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    settings = RecorderSettings(second_directory=tmp_path / "second")
    with Recorder(tmp_path / "file", properties={}, config_json="", settings=settings) as recorder:
        feed(recorder, 0, 5)
        run_id = recorder.run_id
    with RunReader(tmp_path / "second" / run_id) as reader:
        assert len(list(reader.access_units())) == 5
