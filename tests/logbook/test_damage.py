"""A recording from a damaged disk or a stranger ends in a sentence, whatever is wrong with it."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from ghal360_robot.cli import careful
from ghal360_robot.logbook import tick_rows
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from tests.logbook import robot

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ghal360_robot.logbook.records import Tick
    from ghal360_robot.logbook.rrd import StoredRow

REPOSITORY = Path(__file__).parents[2]
T0 = 1_000_000_000_000_000_001
FILES = 24


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    recorder = Recorder(tmp_path_factory.mktemp("whole"), properties={"robot": "7"}, config_json="{}")
    for k in range(60):
        stamp = T0 + k * robot.TICK_NS
        recorder.tick(robot.inputs(stamp, k), robot.decision(k), robot.applied(k), 0.5, 1.0)
        recorder.base_state(robot.base_state(stamp, k))
        recorder.lidar_scan(robot.scan(stamp, k))
        recorder.access_unit(stamp, os.urandom(300), k, k % 10 == 0, False)
    recorder.close()
    return (recorder.folder / "part-000.rrd").read_bytes()


def test_a_tick_whose_rows_contradict_each_other_is_left_out_and_told(
    tmp_path: Path, whole: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "part-000.rrd").write_bytes(whole)
    understood = tick_rows._tick

    def sometimes(row: StoredRow, *rest: Any) -> Tick:
        devices = ["one too many", *rest[1]] if row.tick in {20, 30} else rest[1]
        return understood(row, rest[0], devices, *rest[2:])

    monkeypatch.setattr(tick_rows, "_tick", sometimes)
    with RunReader(tmp_path) as reader:
        ticks = [tick.tick for tick in reader.ticks()]
        told = [sentence for sentence in reader.damage if "makes no sense" in sentence]
    assert ticks == [number for number in range(60) if number not in {20, 30}]
    assert len(told) == 1
    assert told[0].startswith("Tick 20 ")


@pytest.mark.parametrize(
    ("entity", "read", "column", "value"),
    [
        ("base/state", RunReader.base_states, "Scalars:scalars", np.zeros(2)),
        ("base/state", RunReader.base_states, "BaseState:mode", ["no mode at all"]),
        ("lidar/scan", RunReader.scans, "LidarScan:counters", np.zeros(0)),
        ("theta/video", RunReader.access_units, "AccessUnit:sequence", None),
    ],
    ids=["too few numbers", "a word unknown", "none", "nothing"],
)
def test_any_other_row_that_makes_no_sense_is_left_out_and_told_once(
    tmp_path: Path,
    whole: bytes,
    monkeypatch: pytest.MonkeyPatch,
    entity: str,
    read: Callable[[RunReader], Iterator[Any]],
    column: str,
    value: Any,
) -> None:
    (tmp_path / "part-000.rrd").write_bytes(whole)
    as_stored = RunReader.rows

    def flipped(reader: RunReader, name: str, *between: int | None) -> Iterator[StoredRow]:
        for n, row in enumerate(as_stored(reader, name, *between)):
            yield replace(row, values=row.values | {column: value}) if name == entity and n in {20, 30} else row

    with RunReader(tmp_path) as reader:
        good = [item.stamp_ns for item in read(reader)]
    monkeypatch.setattr(RunReader, "rows", flipped)
    with RunReader(tmp_path) as reader:
        left = [item.stamp_ns for item in read(reader)]
        told = [sentence for sentence in reader.damage if "makes no sense" in sentence]
    assert left == [stamp for n, stamp in enumerate(good) if n not in {20, 30}]
    assert len(told) == 1
    assert told[0].startswith(f"A row of {entity} ")


INSPECT_MANY = """
import json, sys
from pathlib import Path
from ghal360_robot.logbook.errors import LogbookError
from ghal360_robot.logbook.inspection import inspect_run
for name in sys.argv[1:]:
    try:
        inspect_run(Path(name)).to_json()
    except LogbookError:
        pass
    print(name, flush=True)
"""


def test_flipped_bits_end_in_a_report_or_an_error_of_ours_or_in_an_abort_that_the_child_takes(
    tmp_path: Path, whole: bytes
) -> None:
    """Where Rerun itself aborts, the child is gone; what must never come is an exception of another kind."""
    rng = random.Random(1)
    files = []
    for k in range(FILES):
        damaged = bytearray(whole)
        for _ in range(rng.choice((1, 1, 5))):
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        path = tmp_path / f"part-{k:03d}.rrd"
        path.write_bytes(bytes(damaged))
        files.append(str(path))
    aborted = 0
    while files:
        done = subprocess.run(
            [sys.executable, "-c", INSPECT_MANY, *files], cwd=REPOSITORY, capture_output=True, text=True, check=False
        )
        files = files[len(done.stdout.splitlines()) :]
        if done.returncode < 0:
            aborted += 1
            files = files[1:]
        else:
            assert done.returncode == 0, done.stderr[-2000:]
    assert aborted < FILES


@pytest.mark.parametrize(("number", "words"), [(signal.SIGABRT, "damaged in a way"), (signal.SIGTERM, "from outside")])
def test_a_reading_process_that_dies_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, number: signal.Signals, words: str
) -> None:
    (tmp_path / "part-000.rrd").write_bytes(b"RRF2")
    fake = tmp_path / "python"
    fake.write_text(f'#!/bin/sh\ncase "$1" in -m) kill -{number.value} $$;; esac\nexit 1\n')
    fake.chmod(0o755)
    monkeypatch.setattr(careful.sys, "executable", str(fake))
    status, sentence = careful.run_in_child(["inspect", str(tmp_path)])
    assert status == 1
    assert words in sentence


def test_only_commands_that_read_recordings_get_a_process_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(careful.IN_CHILD, raising=False)
    assert careful.wants_child(["inspect", "run"])
    assert not careful.wants_child(["run", "--sim"])
    assert not careful.wants_child([])
    monkeypatch.setenv(careful.IN_CHILD, "1")
    assert not careful.wants_child(["inspect", "run"])
