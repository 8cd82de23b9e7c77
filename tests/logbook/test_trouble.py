"""What the logbook does when the disk, the data or the process fail."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rerun.chunk import OptimizationProfile, RrdReader

from ghal360_robot.logbook import entities
from ghal360_robot.logbook.errors import LogbookError, RecordingNotReadableError
from ghal360_robot.logbook.inspection import inspect_run
from ghal360_robot.logbook.mailbox import ENTRY_BYTES, Entry, Mailbox
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.messages import Cue
from tests.logbook import robot

if TYPE_CHECKING:
    from collections.abc import Callable

T0 = 1_000_000_000_000_000_001
REPOSITORY = Path(__file__).parents[2]

# What does not wait for anything is done within this on a machine that has much else to do.
BUSY_S = 10.0

# Two seconds are written, in less than one chunk: without the log ahead of it all of them were lost.
MAX_LOST_S = 1.2


def video(size: int, *, keyframe: bool) -> Entry:
    return Entry("theta/video", list, size, video=True, keyframe=keyframe)


def other(size: int = 0) -> Entry:
    return Entry("lidar/raw", list, size)


def test_a_full_mailbox_drops_whole_groups_of_video_before_anything_else() -> None:
    mailbox = Mailbox(max_bytes=10 * (1000 + ENTRY_BYTES), max_entries=1000)
    for k in range(10):
        assert mailbox.put(video(1000, keyframe=k in (0, 4, 8)))
    assert mailbox.put(other(1000))
    assert mailbox.dropped_video == 4
    assert [entry.keyframe for entry in mailbox.take(100)][:2] == [True, False]
    assert mailbox.dropped_rest == 0


def test_video_stays_out_until_the_next_keyframe_once_a_picture_was_dropped() -> None:
    mailbox = Mailbox(max_bytes=2 * (1000 + ENTRY_BYTES), max_entries=1000)
    assert mailbox.put(video(1000, keyframe=True))
    assert not mailbox.put(video(3000, keyframe=False))
    assert not mailbox.put(video(10, keyframe=False))
    mailbox.take(100)
    assert not mailbox.put(video(10, keyframe=False))
    assert mailbox.put(video(10, keyframe=True))
    assert mailbox.put(video(10, keyframe=False))
    assert mailbox.dropped_video == 3


def test_without_video_to_drop_the_newest_goes_and_is_counted() -> None:
    mailbox = Mailbox(max_bytes=1 << 20, max_entries=5)
    assert [mailbox.put(other()) for _ in range(7)] == [True] * 5 + [False] * 2
    assert (mailbox.dropped_rest, len(mailbox)) == (2, 5)
    mailbox.take(3)
    assert mailbox.put(other())
    mailbox.take(100)
    assert mailbox.bytes == 0


def test_an_overflow_is_counted_and_told_in_the_log(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, properties={}, config_json="", max_bytes=200_000)
    for k in range(40):
        recorder.access_unit(T0 + k, bytes(20_000), k, True, False)
        recorder.lidar_telegram(T0 + k, b"telegram")
    recorder.close()
    stats = recorder.stats
    assert stats.dropped_video > 0
    assert stats.dropped_rest == 0
    with RunReader(recorder.folder) as reader:
        assert len(list(reader.telegrams())) == 40
        assert len(list(reader.access_units())) == 40 - stats.dropped_video
        assert any(f"{stats.dropped_video} pictures" in text.text for text in reader.texts())


def test_a_call_never_waits_while_the_writer_is_stuck(recorder: Recorder) -> None:
    stuck = threading.Event()

    def wait() -> list[object]:
        stuck.wait(60)
        return []

    recorder._mailbox.put(Entry("log/test", wait))  # type: ignore[arg-type]
    begin = time.monotonic()
    for k in range(1000):
        recorder.can_frame(T0 + k, "rx", k, b"12345678")
    assert time.monotonic() - begin < BUSY_S
    stuck.set()
    assert recorder.close(timeout_s=BUSY_S)
    assert recorder.stats.dropped_rest == 0


BAD: list[tuple[str, Callable[[Recorder], None]]] = [
    ("can/rx", lambda r: r.can_frame(T0 + 5, "rx", -1, b"12345678")),
    ("can/rx", lambda r: r.can_frame(T0 + 5, "rx", 1 << 40, b"12345678")),
    ("lidar/raw", lambda r: r.lidar_telegram(T0 + 5, "text")),  # type: ignore[arg-type]
    ("log/loop", lambda r: r.text(T0 + 5, "loop", "INFO", ["no text"])),  # type: ignore[arg-type]
    ("sim/map", lambda r: r.true_map(T0 + 5, np.zeros(5, np.uint8), 0.1, None)),  # type: ignore[arg-type]
    ("theta/video", lambda r: r.access_unit(T0 + 5, b"unit", "one", True, False)),  # type: ignore[arg-type]
    ("base/state", lambda r: r.base_state(robot.base_state(1 << 70, 1))),
]


@pytest.mark.parametrize(("entity", "log_bad"), BAD)
def test_a_row_that_cannot_be_logged_is_told_and_stops_nothing_else(
    recorder: Recorder, entity: str, log_bad: Callable[[Recorder], None]
) -> None:
    for k in range(10):
        recorder.can_frame(T0 + k, "rx", k, b"12345678")
        recorder.lidar_telegram(T0 + k, b"telegram")
        recorder.text(T0 + k, "loop", "INFO", "fine")
        recorder.access_unit(T0 + k, b"unit", k, True, False)
        recorder.base_state(robot.base_state(T0 + k, k))
        if k == 5:
            log_bad(recorder)
    robot.wait_for(lambda: recorder.stats.failed_rows > 0)
    assert recorder.close()
    assert recorder.stats.failed_rows == 1
    with RunReader(recorder.folder) as reader:
        assert len(list(reader.can_frames())) == 10
        assert len(list(reader.telegrams())) == 10
        assert len(list(reader.access_units())) == 10
        assert list(reader.base_states()) == [robot.base_state(T0 + k, k) for k in range(10)]
        texts = list(reader.texts())
    assert sum(text.source == "loop" for text in texts) == 10
    assert any(text.level == "ERROR" and f"1 of {entity}" in text.text for text in texts)


def test_a_bad_directory_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(LogbookError, match="make that folder writable or choose another") as caught:
        Recorder(tmp_path / "file", properties={}, config_json="")
    assert isinstance(caught.value, OSError)


def test_a_run_is_never_written_over(tmp_path: Path) -> None:
    Recorder(tmp_path, run_id="one", properties={}, config_json="").close()
    with pytest.raises(LogbookError, match="already"):
        Recorder(tmp_path, run_id="one", properties={}, config_json="")


def test_closing_takes_no_longer_than_it_may(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, properties={}, config_json="")
    stuck = threading.Event()
    recorder._mailbox.put(Entry("log/test", lambda: [] * stuck.wait(60)))
    begin = time.monotonic()
    assert not recorder.close(timeout_s=0.5)
    assert time.monotonic() - begin < BUSY_S
    stuck.set()
    assert recorder.close(timeout_s=BUSY_S)


def test_a_backlog_is_given_up_for_the_sake_of_the_footer(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, properties={}, config_json="")

    def slowly() -> list[object]:
        time.sleep(0.02)
        return []

    for _ in range(1000):
        recorder._mailbox.put(Entry("log/test", slowly))  # type: ignore[arg-type]
    begin = time.monotonic()
    assert recorder.close(timeout_s=6.0)  # a thousand times 20 ms are 20 s
    assert time.monotonic() - begin < 15.0
    assert recorder.stats.dropped_rest > 0
    with RunReader(recorder.folder) as reader:
        assert reader.damage == []
        assert any("are not in the recording" in text.text for text in reader.texts())


CHILD = """
import sys, time
from pathlib import Path
from ghal360_robot.logbook.recorder import Recorder
from tests.logbook import robot

recorder = Recorder(Path(sys.argv[1]), run_id="run", properties={}, config_json="")
tick = 0
begin = time.monotonic()
while time.monotonic() - begin < 30:
    now = time.monotonic_ns()
    recorder.tick(robot.inputs(now, tick), robot.decision(tick), robot.applied(tick), 0.0, 0.0)
    for _ in range(12):
        recorder.can_frame(now, "rx", tick, b"12345678")
    if tick % 3 == 0:
        recorder.access_unit(now, bytes(20_000), tick, True, False)
        recorder.lidar_telegram(now, b"telegram" * 100)
    print(now, flush=True)
    tick += 1
    time.sleep(0.02)
"""


def test_a_killed_process_leaves_a_readable_recording_that_lacks_only_its_last_moment(tmp_path: Path) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(tmp_path)], stdout=subprocess.PIPE, cwd=REPOSITORY, text=True
    )
    assert child.stdout is not None
    lines = [child.stdout.readline() for _ in range(100)]
    os.kill(child.pid, signal.SIGKILL)
    lines += child.stdout.readlines()
    child.stdout.close()
    child.wait(10)
    last_ns = int([line for line in lines if line.endswith("\n")][-1])
    with RunReader(tmp_path / "run") as reader:
        assert any("was not closed properly" in sentence for sentence in reader.damage)
        ticks = list(reader.ticks())
        units = list(reader.access_units())
        frames = list(reader.can_frames())
    assert [tick.tick for tick in ticks] == list(range(len(ticks)))
    assert all(tick.decision == robot.decision(tick.tick) for tick in ticks)
    for newest_ns in (ticks[-1].stamp_ns, units[-1].stamp_ns, frames[-1].stamp_ns):
        assert (last_ns - newest_ns) / 1e9 < MAX_LOST_S


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A closed recording with a chunk for each of twelve access units of 60 kB."""
    recorder = Recorder(tmp_path_factory.mktemp("whole"), properties={"robot": "7"}, config_json="")
    for k in range(12):
        recorder.access_unit(T0 + k, os.urandom(60_000), k, True, False)
        robot.wait_for(lambda k=k: recorder.stats.written > k)  # type: ignore[misc]
    recorder.close()
    return (recorder.folder / "part-000.rrd").read_bytes()


@pytest.mark.parametrize("cut", [1, 40, 1000, 40_000, 200_000, 600_000])
def test_a_torn_file_is_readable_up_to_the_tear(tmp_path: Path, whole: bytes, cut: int) -> None:
    path = tmp_path / "part-000.rrd"
    path.write_bytes(whole[:-cut])
    with RunReader(path) as reader:
        units = list(reader.access_units())
        assert reader.damage
        assert reader.properties == {"robot": "7"}
        copies = [part._copy for part in reader.parts]
    assert [unit.sequence for unit in units] == list(range(len(units)))
    assert len(units) >= 12 - 1 - cut // 60_000
    assert not any(copy is not None and copy.exists() for copy in copies)


@pytest.mark.parametrize("filled_with", [bytes, os.urandom])
@pytest.mark.parametrize("lost", [500, 3000, 30_000, 70_000, 333_333, 700_000])
def test_an_end_of_zeros_or_rubbish_costs_no_more_than_itself(
    tmp_path: Path, whole: bytes, filled_with: Callable[[int], bytes], lost: int
) -> None:
    """What a power cut leaves: the file has its length, but not its last bytes."""
    path = tmp_path / "part-000.rrd"
    path.write_bytes(whole[:-lost] + filled_with(lost))
    with RunReader(path) as reader:
        units = list(reader.access_units())
        assert reader.damage
    assert [unit.sequence for unit in units] == list(range(len(units)))
    assert len(units) >= 12 - 1 - lost // 60_000


@pytest.mark.parametrize("content", [b"", b"RRF2", b"not a recording at all, but long enough to be one"])
def test_what_is_no_recording_is_one_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "part-000.rrd"
    path.write_bytes(content)
    with pytest.raises(RecordingNotReadableError, match=r"part-000\.rrd"):
        RunReader(tmp_path)


def test_a_missing_recording_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(RecordingNotReadableError, match="There is no recording"):
        RunReader(tmp_path / "nothing")
    with pytest.raises(RecordingNotReadableError, match="no part"):
        RunReader(tmp_path)


FULL_DISK = """
import os, resource, signal, sys, time
from pathlib import Path
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from tests.logbook import robot

# A limit on the size of files stands in for a full disk: writes fail until it is lifted.
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
recorder = Recorder(Path(sys.argv[1]), run_id="run", properties={}, config_json="")
recorder.text(time.monotonic_ns(), "test", "INFO", "before")
robot.wait_for(lambda: recorder.stats.written == 1)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, resource.RLIM_INFINITY))
sequence = 0
while recorder.stats.failed is None:
    recorder.access_unit(time.monotonic_ns(), os.urandom(40_000), sequence, True, False)
    sequence += 1
    time.sleep(0.01)
print(recorder.stats.failed)
recorder.text(time.monotonic_ns(), "test", "INFO", "during")
time.sleep(1.2)
assert recorder.stats.failed is not None
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
robot.wait_for(lambda: recorder.stats.failed is None)
recorder.text(time.monotonic_ns(), "test", "INFO", "after")
assert recorder.close(timeout_s=60.0)
assert recorder.stats.reopened == 1, recorder.stats
with RunReader(recorder.folder) as reader:
    print(len(reader.parts), [text.text for text in reader.texts()])
"""


def test_a_full_disk_is_told_and_the_recording_goes_on_in_a_new_part(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(tmp_path)],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    failed, texts = done.stdout.splitlines()
    assert "disk is probably full" in failed
    assert texts.startswith("2 ")
    assert "'before'" in texts
    assert "'during'" in texts
    assert "'after'" in texts


def test_every_cue_has_a_colour_in_the_timeline() -> None:
    from ghal360_robot.logbook.statics import STATE_COLORS

    assert {cue.value for cue in Cue} <= STATE_COLORS.keys()


def test_a_mistake_in_the_writer_itself_is_told_and_the_file_still_ends_properly(
    recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(until: float) -> None:
        raise ZeroDivisionError

    recorder.text(T0, "loop", "INFO", "before")
    robot.wait_for(lambda: recorder.stats.written == 1)
    monkeypatch.setattr(recorder._writer, "_take", broken)
    robot.wait_for(lambda: recorder.stats.failed is not None)
    assert "ZeroDivisionError" in (recorder.stats.failed or "")
    recorder.text(T0, "loop", "INFO", "after")
    assert not recorder.close()
    with RunReader(recorder.folder) as reader:
        assert [text.text for text in reader.texts()] == ["before"]
        assert reader.damage == []


def test_logger_names_out_of_control_do_not_fill_the_tree(recorder: Recorder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(entities, "_log_tables", {})
    for k in range(200):
        recorder.text(T0 + k, f"source.{k}", "INFO", str(k))
    recorder.close()
    with RunReader(recorder.folder) as reader:
        assert (
            len([entity for entity in reader.entities() if entity.startswith("log/")]) == entities.MAX_LOG_SOURCES + 1
        )
        assert [text.text for text in reader.texts()] == [str(k) for k in range(200)]


def test_a_recording_that_rerun_has_optimized_reads_the_same(recorder: Recorder, tmp_path: Path) -> None:
    """Recovery and archiving go through Rerun's optimize, which takes rows apart by component."""
    for k in range(100):
        stamp = T0 + k * robot.TICK_NS
        recorder.tick(robot.inputs(stamp, k), robot.decision(k), robot.applied(k), k / 7, 1.0)
        recorder.base_state(robot.base_state(stamp, k))
        recorder.lidar_scan(robot.scan(stamp, k))
        recorder.access_unit(stamp, os.urandom(5000), k, False, k % 3 == 0)
    recorder.close()
    path = tmp_path / "optimized.rrd"
    whole = RrdReader(str(recorder.folder / "part-000.rrd")).stream()
    optimized = whole.collect(optimize=OptimizationProfile.OBJECT_STORE)
    optimized.write_rrd(path, application_id="ghal360", recording_id=recorder.run_id)
    chunks = list(RrdReader(str(path)).stream().filter(content="/theta/video", is_static=False))
    assert any("VideoStream:sample" not in chunk.to_record_batch().schema.names for chunk in chunks)
    with RunReader(recorder.folder) as before, RunReader(path) as after:
        assert after.anchor == before.anchor
        assert list(after.ticks()) == list(before.ticks())
        assert list(after.access_units()) == list(before.access_units())
        assert list(after.base_states()) == list(before.base_states())
        assert [s.ranges.tobytes() for s in after.scans()] == [s.ranges.tobytes() for s in before.scans()]
    counts = [{e.entity: e.rows for e in inspect_run(run).entities} for run in (recorder.folder, path)]
    assert counts[0] == counts[1]
