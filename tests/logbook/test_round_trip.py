"""What goes into a recording comes out of it, to the bit."""

from __future__ import annotations

import hashlib
import json
import logging
import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rerun.chunk import RrdReader

from ghal360_robot.logbook.handler import LogbookHandler
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.logbook.statics import Mount
from ghal360_robot.messages import Detection, Detections, LinkStats, Pose2
from tests.logbook import robot

if TYPE_CHECKING:
    from pathlib import Path

    from ghal360_robot.messages import LidarScan

T0 = 1_000_000_000_000_000_001
"""Odd, and too long for a float64."""


def test_access_units_come_back_byte_identical(recorder: Recorder) -> None:
    rng = np.random.default_rng(1)
    sent = [(T0 + k, rng.bytes(int(rng.integers(1, 60_000))), k, k % 5 == 0, k % 7 == 1) for k in range(40)]
    for unit in sent:
        recorder.access_unit(*unit)
    assert recorder.close()
    with RunReader(recorder.folder) as reader:
        got = list(reader.access_units())
    assert [(u.stamp_ns, u.data, u.sequence, u.keyframe, u.tainted) for u in got] == sent


def test_a_keyframe_mark_exists_on_keyframes_only(recorder: Recorder) -> None:
    for k in range(6):
        recorder.access_unit(T0 + k, b"\0\0\0\1\x65", k, k == 3, False)
    recorder.close()
    with RunReader(recorder.folder) as reader:
        marks = [row.values.get("VideoStream:is_keyframe") for row in reader.rows("theta/video")]
    assert marks == [None, None, None, [True], None, None]


def test_telegrams_come_back_byte_identical(recorder: Recorder) -> None:
    sent = [(T0 + k, bytes(range(256)) * k) for k in range(9)]
    for stamp, data in sent:
        recorder.lidar_telegram(stamp, data)
    recorder.close()
    with RunReader(recorder.folder) as reader:
        assert [(t.stamp_ns, t.data) for t in reader.telegrams()] == sent


def test_can_frames_come_back_exactly_and_merged_by_time(recorder: Recorder) -> None:
    rng = np.random.default_rng(2)
    sent = [(T0 + k, ("rx", "tx")[k % 3 == 0], int(rng.integers(0, 1 << 29)), rng.bytes(k % 9)) for k in range(500)]
    for stamp, direction, can_id, data in sent:
        recorder.can_frame(stamp, direction, can_id, data)  # type: ignore[arg-type]
    recorder.close()
    with RunReader(recorder.folder) as reader:
        got = [(f.stamp_ns, f.direction, f.can_id, f.data) for f in reader.can_frames()]
    assert got == sent


def assert_same_scan(got: LidarScan, sent: LidarScan) -> None:
    np.testing.assert_array_equal(got.ranges, sent.ranges)
    np.testing.assert_array_equal(got.yaw, sent.yaw)
    assert got.ranges.dtype == got.yaw.dtype == np.float32
    if sent.rssi is None or got.rssi is None:
        assert got.rssi is sent.rssi
    else:
        np.testing.assert_array_equal(got.rssi, sent.rssi)
    for field in ("stamp_ns", "scan_counter", "telegram_counter", "device_time_us", "device_ok"):
        assert getattr(got, field) == getattr(sent, field)


def test_scans_come_back_to_the_bit_whatever_their_numbers(recorder: Recorder) -> None:
    millimetres = [robot.scan(T0 + k, k, rssi=k % 2 == 0) for k in range(8)]
    odd = robot.scan(T0 + 10, 10)
    fine = replace(odd, stamp_ns=T0 + 11, ranges=odd.ranges * np.float32(1.0001))
    endless = replace(odd, stamp_ns=T0 + 12, ranges=np.full(811, np.inf, np.float32), rssi=odd.ranges)
    zero = replace(odd, stamp_ns=T0 + 13, ranges=np.zeros(811, np.float32), rssi=odd.yaw * 0 + 65_535)
    short = replace(odd, stamp_ns=T0 + 14, ranges=odd.ranges[:100], yaw=odd.yaw[:100], rssi=None)
    empty = replace(odd, stamp_ns=T0 + 15, ranges=odd.ranges[:0], yaw=odd.yaw[:0], rssi=odd.yaw[:0])
    sent = [*millimetres, odd, fine, endless, zero, short, empty]
    for scan in sent:
        recorder.lidar_scan(scan)
    recorder.close()
    with RunReader(recorder.folder) as reader:
        got = list(reader.scans())
    assert len(got) == len(sent)
    for a, b in zip(got, sent, strict=True):
        assert_same_scan(a, b)


def test_base_states_operator_and_detections_come_back_equal(recorder: Recorder) -> None:
    stamps = [T0 + k * robot.TICK_NS for k in range(60)]
    states = [robot.base_state(stamp, k) for k, stamp in enumerate(stamps)]
    wishes = [robot.operator(stamp, k) for k, stamp in enumerate(stamps)]
    found = [robot.detections(stamp, k) for k, stamp in enumerate(stamps)]
    for k in range(60):
        recorder.base_state(states[k])
        recorder.operator(wishes[k])
        recorder.detections(found[k])
    recorder.close()
    with RunReader(recorder.folder) as reader:
        assert list(reader.base_states()) == states
        assert list(reader.operator_inputs()) == wishes
        assert list(reader.detections()) == found


def test_ticks_come_back_equal_although_unchanged_rows_are_left_out(recorder: Recorder) -> None:
    numbers = range(10, 410)
    for k in numbers:
        recorder.tick(robot.inputs(T0 + k * robot.TICK_NS, k), robot.decision(k), robot.applied(k), k / 7, 1 / k)
    recorder.close()
    with RunReader(recorder.folder) as reader:
        got = list(reader.ticks())
        assert len(list(reader.rows("scene/wedges"))) < 60
    assert [tick.tick for tick in got] == list(numbers)
    for tick in got:
        k = tick.tick
        seen = robot.inputs(T0 + k * robot.TICK_NS, k)
        assert tick.stamp_ns == seen.stamp_ns
        assert tick.decision == robot.decision(k)
        assert tick.applied == robot.applied(k)
        assert tick.freshness == seen.freshness
        assert (tick.lateness_ms, tick.work_ms) == (k / 7, 1 / k)
        assert tick.base_ns == seen.stamp_ns - 1
        assert tick.operator_ns is None
        assert (tick.commands, tick.locks, tick.lease) == (seen.commands, seen.locks, seen.lease)
        assert tick.stops == seen.stops


def test_early_ticks_have_seen_nothing(recorder: Recorder) -> None:
    recorder.tick(replace(robot.inputs(T0, 0), base=None, freshness={}), robot.decision(0), robot.applied(0), 0, 0)
    recorder.close()
    with RunReader(recorder.folder) as reader:
        (tick,) = reader.ticks()
    assert (tick.base_ns, tick.scan_ns, tick.detections_ns, tick.operator_ns) == (None, None, None, None)
    assert tick.freshness == {}


def test_links_truth_maps_and_texts_come_back_equal(recorder: Recorder) -> None:
    links = [
        LinkStats("connecting", "no answer on 192.168.0.1"),
        LinkStats("streaming", "", 1 << 40, 2, 3, 4, 14.9, T0, "battery 98 %, charging"),
    ]
    for stats in links:
        recorder.link("tim571", stats)
    recorder.truth(T0, Pose2(1 / 3, 2, 3), (4.5, 5))
    cells = np.arange(12, dtype=np.uint8).reshape(3, 4)
    recorder.true_map(T0, cells, 1 / 30, Pose2(-1 / 3, 2, 0.1))
    recorder.text(T0, "loop", "INFO", "ändert nichts")
    recorder.close()
    with RunReader(recorder.folder) as reader:
        assert [link.stats for link in reader.links()] == links
        assert [truth.pose for truth in reader.truths()] == [Pose2(1 / 3, 2, 3)]
        (got,) = reader.maps("sim/map")
        np.testing.assert_array_equal(got.cells, cells)
        assert (got.resolution_m, got.origin) == (1 / 30, Pose2(-1 / 3, 2, 0.1))
        (text,) = reader.texts()
        assert (text.stamp_ns, text.source, text.level, text.text) == (T0, "loop", "INFO", "ändert nichts")


def test_rows_without_a_tick_have_no_tick_and_their_own_time(recorder: Recorder) -> None:
    """Rerun's clock is sticky; nothing logged between ticks may inherit one's number or time."""
    for k in range(3):
        recorder.tick(robot.inputs(T0 + k * robot.TICK_NS, k), robot.decision(k), robot.applied(k), 0, 0)
        recorder.text(T0 - 5 - k, "loop", "INFO", "between")
        recorder.base_state(robot.base_state(T0 - 100 - k, k))
    recorder.close()
    with RunReader(recorder.folder) as reader:
        for entity in ("log/loop", "base/state", "tf/base"):
            assert all(row.tick is None for row in reader.rows(entity))
        stamps = [reader.anchor.to_monotonic(row.t_ns) for row in reader.rows("log/loop")]
        assert stamps == [T0 - 7, T0 - 6, T0 - 5]
        assert [row.tick for row in reader.rows("loop/inputs")] == [0, 1, 2]


def test_rows_are_read_by_time_whatever_order_they_came_in(recorder: Recorder) -> None:
    order = np.random.default_rng(3).permutation(200)
    for batch in np.array_split(order, 4):
        for k in batch:
            recorder.access_unit(T0 + int(k), b"%d" % k, int(k), True, False)
        written = recorder.stats.written
        robot.wait_for(lambda written=written: recorder.stats.written >= written + 50)  # type: ignore[misc]
    recorder.close()
    with RunReader(recorder.folder) as reader:
        chunks = sum(1 for part in reader.parts for _ in part.chunks("theta/video"))
        assert chunks >= 4
        assert [unit.data for unit in reader.access_units()] == [b"%d" % k for k in range(200)]


def test_python_logging_reaches_the_log_of_this_recorder(recorder: Recorder) -> None:
    logger = logging.Logger("drivers.tim571")  # noqa: LOG001 - a logger that no other test can see
    logger.addHandler(LogbookHandler(recorder))
    logger.warning("no answer for %d s", 3)
    logger.debug("not logged")
    before = time.monotonic_ns()
    recorder.close()
    with RunReader(recorder.folder) as reader:
        (text,) = reader.texts()
    assert (text.source, text.level, text.text) == ("drivers/tim571", "WARN", "no answer for 3 s")
    assert abs(before - text.stamp_ns) < 5e9


def test_a_closed_recording_has_a_footer_a_layout_and_says_what_it_is(tmp_path: Path) -> None:
    recorder = Recorder(
        tmp_path,
        properties={"robot": "nr 7", "git": "abc"},
        config_json="speed = 0.3\n",
        mounts={"lidar": Mount(0.2, 0.0, 0.3, 0.1), "theta": Mount(z=1.2)},
    )
    recorder.text(T0, "loop", "INFO", "hello")
    assert recorder.close()
    file = RrdReader(str(recorder.folder / "part-000.rrd"))
    assert file.store().schema() is not None
    assert len(file.blueprints()) == 1
    meta = json.loads((recorder.folder / "meta.json").read_text())
    assert meta["run_id"] == recorder.run_id == recorder.folder.name
    assert meta["config_sha256"] == hashlib.sha256(b"speed = 0.3\n").hexdigest()
    with RunReader(recorder.folder / "part-000.rrd") as reader:
        assert reader.properties == {"robot": "nr 7", "git": "abc"}
        assert (reader.run_id, reader.config_json) == (recorder.run_id, "speed = 0.3\n")
        assert reader.anchor == recorder.anchor
        assert reader.damage == []


@pytest.mark.parametrize("second", [False, True])
def test_closing_twice_and_logging_afterwards_is_harmless(recorder: Recorder, second: bool) -> None:
    recorder.close()
    if second:
        assert recorder.close()
    recorder.text(T0, "loop", "INFO", "too late")
    assert recorder.stats.queued == 0


def test_a_box_over_the_seam_is_drawn_on_both_sides_and_stays_one_object(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, properties={}, config_json="", mounts={"theta": Mount(yaw=math.pi / 2)})
    behind_the_camera = Detection("person", 0.9, -math.pi / 2, 0.0, math.pi / 4, math.pi / 4)
    ahead_of_it = Detection("person", 0.8, math.pi / 2, math.pi / 4, math.pi / 4, math.pi / 4)
    found = Detections(T0, 1, "painted", (behind_the_camera, ahead_of_it))
    recorder.detections(found)
    recorder.close()
    with RunReader(recorder.folder) as reader:
        (row,) = reader.rows("theta/objects")
        assert list(reader.detections()) == [found]
    centers = np.array(row.values["Boxes2D:centers"])
    np.testing.assert_allclose(centers, [(1860, 480), (60, 480), (960, 240)], atol=0.01)
