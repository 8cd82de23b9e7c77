"""The log ahead of a part, and what is made of it after a kill."""

from __future__ import annotations

import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rerun_bindings import check_for_rrd_footer

from ghal360_robot.logbook import entities, rows
from ghal360_robot.logbook.clock import Anchor
from ghal360_robot.logbook.encoding import Encoder, joined
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.logbook.recovery import recover_runs
from ghal360_robot.logbook.video_ring import VideoRing
from ghal360_robot.logbook.wal import WriteAheadLog, read_wal
from tests.logbook import robot

REPOSITORY = Path(__file__).parents[2]
ENCODER = Encoder(Anchor(0, 1_700_000_000_000_000_000))


def telegrams(count: int) -> pa.RecordBatch:
    made = [row for k in range(count) for row in rows.lidar_telegram(k, b"telegram %d" % k)]
    return ENCODER.encode(entities.LIDAR_RAW, made)


BATCHES = [telegrams(k + 1) for k in range(6)]


@cache
def whole_log() -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "part-000.wal"
        log = WriteAheadLog(path)
        log.append(BATCHES)
        log.close(remove=False)
        return path.read_bytes()


def read(path: Path, data: bytes) -> list[pa.RecordBatch]:
    path.write_bytes(data)
    return list(read_wal(path))


def test_what_was_logged_ahead_is_read_back(tmp_path: Path) -> None:
    batches, found = BATCHES, read(tmp_path / "log", whole_log())
    assert [batch.column("Telegram:bytes") for batch in found] == [batch.column("Telegram:bytes") for batch in batches]
    assert [batch.column(0) for batch in found] == [batch.column(0) for batch in batches]


@given(cut=st.floats(0, 1), flip=st.integers(0, 7), where=st.floats(0, 0.999))
def test_a_torn_or_damaged_log_gives_its_whole_beginning_and_never_anything_wrong(
    tmp_path_factory: pytest.TempPathFactory, cut: float, flip: int, where: float
) -> None:
    data = whole_log()
    path = tmp_path_factory.getbasetemp() / "damaged.wal"
    torn = read(path, data[: round(len(data) * cut)])
    damaged = bytearray(data)
    damaged[int(len(data) * where)] ^= 1 << flip
    for found in (torn, read(path, bytes(damaged))):
        assert len(found) <= len(BATCHES)
        assert all(a.equals(b) for a, b in zip(found, BATCHES, strict=False))


def test_joined_batches_have_all_rows_in_order() -> None:
    batches = [telegrams(3), telegrams(4)]
    both = joined(batches)
    assert both.num_rows == 7
    assert both.column(0).to_pylist() == [i for batch in batches for i in batch.column(0).to_pylist()]


KILLED = """
import os, signal, sys, time
from pathlib import Path
from ghal360_robot.logbook.recorder import Recorder
from tests.logbook import robot

recorder = Recorder(Path(sys.argv[1]), run_id="run", properties={"robot": "7"}, config_json="{}")
for k in range(100):
    now = 10**18 + k * 1_000_000
    recorder.tick(robot.inputs(now, k), robot.decision(k), robot.applied(k), 0.5, 1.0)
    recorder.access_unit(now, os.urandom(500), k, k % 10 == 0, False)
    recorder.base_state(robot.base_state(now, k))
robot.wait_for(lambda: recorder.stats.queued == 0 and recorder.stats.written > 300)
time.sleep(0.4)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("killed")
    subprocess.run([sys.executable, "-c", KILLED, str(folder)], cwd=REPOSITORY, check=False, timeout=60)
    assert (folder / "run" / "part-000.wal").stat().st_size > 0
    return folder


@pytest.fixture
def left(killed: Path, tmp_path: Path) -> Path:
    """A copy of what a killed recorder left."""
    return shutil.copytree(killed, tmp_path / "runs")


def check_whole(run: Path) -> None:
    with RunReader(run) as reader:
        ticks = list(reader.ticks())
        assert [tick.tick for tick in ticks] == list(range(100))
        assert all(tick.decision == robot.decision(tick.tick) for tick in ticks)
        assert [unit.sequence for unit in reader.access_units()] == list(range(100))
        assert len(list(reader.base_states())) == 100


def test_a_killed_recording_is_read_with_what_was_logged_ahead(left: Path) -> None:
    check_whole(left / "run")


def test_at_the_next_boot_it_gets_its_rows_its_footer_and_keeps_its_layout(left: Path) -> None:
    part = left / "run" / "part-000.rrd"
    assert not check_for_rrd_footer(str(part))
    (sentence,) = recover_runs(left)
    assert "put in order" in sentence
    assert check_for_rrd_footer(str(part))
    assert [file.name for file in sorted((left / "run").iterdir())] == ["meta.json", "part-000.rrd"]
    check_whole(left / "run")
    with RunReader(left / "run") as reader:
        assert reader.damage == []
        assert reader.properties == {"robot": "7"}
        assert len(reader.parts[0]._reader.blueprints()) == 1
    assert recover_runs(left) == []


def test_rows_that_are_in_both_are_one_row(left: Path) -> None:
    """A kill between the chunk's arrival and the log's clearing leaves them twice."""
    log = (left / "run" / "part-000.wal").read_bytes()
    recover_runs(left)
    (left / "run" / "part-000.wal").write_bytes(log)
    check_whole(left / "run")
    with RunReader(left / "run") as reader:
        assert len(reader.parts) == 1, "the log has nothing that the part lacks"


def test_a_recording_in_progress_is_left_alone(tmp_path: Path) -> None:
    with Recorder(tmp_path, properties={}, config_json="") as recorder:
        recorder.lidar_telegram(1, b"telegram")
        robot.wait_for(lambda: recorder.stats.written > 0)
        assert recover_runs(tmp_path) == []
    with RunReader(recorder.folder) as reader:
        assert len(list(reader.telegrams())) == 1
        assert reader.damage == []


def units(first: int, count: int) -> pa.RecordBatch:
    made = [
        row for k in range(first, first + count) for row in rows.access_unit(k, bytes(1000), k, k % 5 == 0, False, 0)
    ]
    return ENCODER.encode(entities.THETA_VIDEO, made)


def test_the_ring_keeps_half_a_minute_in_whole_groups() -> None:
    ring = VideoRing(max_s=30.0)
    for second in range(100):
        ring.add(units(5 * second, 5), key=True, now_s=second)
    kept = ring.take()
    assert 30 <= len(kept) <= 31
    assert ring.let_go == 5 * (100 - len(kept))
    assert (ring.bytes, ring.take()) == (0, [])


def test_the_ring_begins_with_a_key_picture_unless_what_it_leans_on_was_written() -> None:
    ring = VideoRing()
    ring.add(units(1, 2), key=False, now_s=0.0)
    assert (len(ring), ring.let_go) == (0, 2)
    ring.add(units(1, 2), key=False, now_s=0.0, owed=True)
    assert len(ring) == 1


def test_what_is_owed_is_let_go_for_want_of_room_only_and_by_groups() -> None:
    size = units(0, 5).nbytes
    ring = VideoRing(max_s=1.0, max_bytes=3 * size)
    for second in range(10):
        ring.add(units(5 * second, 2), key=True, now_s=second, owed=True)
        ring.add(units(5 * second + 2, 3), key=False, now_s=second, owed=True)
    kept = ring.take()
    assert ring.let_go % 5 == 0
    assert 2 <= len(kept) <= 6
