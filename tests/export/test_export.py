"""A recorded run, exported: what other tools read back is what was recorded."""

from __future__ import annotations

import csv
import math
from collections import Counter
from typing import TYPE_CHECKING

import av
import numpy as np
import pytest

from calibration.mounting import CameraMount, LidarMount
from ghal360_robot.errors import GhalError
from ghal360_robot.export.csv_tables import write_csv
from ghal360_robot.export.mcap import Mounts, write_mcap
from ghal360_robot.export.mp4 import FilmSettings, Look, write_mp4
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.simulation.encoder import ThetaEncoder
from tests.logbook import robot

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

START_NS = 5_000_000_000
PICTURES, SCANS, TICKS = 12, 6, 50
MOUNTS = Mounts(LidarMount(0.2, 0.0, 0.25, 0.1), CameraMount())


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunReader]:
    """A second of a robot in front of a panorama whose eight columns differ in brightness."""
    recorder = Recorder(tmp_path_factory.mktemp("runs"), properties={"robot": "7"}, config_json="{}")
    encoder = ThetaEncoder(320, 160, 12.0, 400_000)
    picture = np.repeat(np.arange(8, dtype=np.uint8) * 30, 40)[None, :, None] * np.ones((160, 1, 3), np.uint8)
    for k in range(PICTURES):
        recorder.access_unit(START_NS + k * 80_000_000, encoder.encode(picture), k, k == 0, tainted=False)
    for k in range(SCANS):
        recorder.lidar_scan(robot.scan(START_NS + k * 66_000_000, k))
    for k in range(TICKS):
        stamp_ns = START_NS + k * robot.TICK_NS
        recorder.base_state(robot.base_state(stamp_ns - 1, k))
        recorder.operator(robot.operator(stamp_ns - 3, k))
        recorder.tick(robot.inputs(stamp_ns, k), robot.decision(k), robot.applied(k), lateness_ms=0.5, work_ms=1.0)
    assert recorder.close()
    with RunReader(recorder.folder) as reader:
        yield reader


def test_the_mcap_holds_every_message_and_an_independent_reader_decodes_them(run: RunReader, tmp_path: Path) -> None:
    ros2 = pytest.importorskip("mcap_ros2.reader")
    written = write_mcap(run, tmp_path / "run.mcap", MOUNTS)
    seen: Counter[str] = Counter()
    newest = {}
    previous_ns = 0
    for message in ros2.read_ros2_messages(tmp_path / "run.mcap"):
        seen[message.channel.topic] += 1
        newest[message.channel.topic] = message.ros_msg
        assert message.log_time_ns >= previous_ns
        previous_ns = message.log_time_ns
    assert dict(seen) == written
    assert (seen["/theta/video"], seen["/scan"], seen["/odom"], seen["/cmd_vel"]) == (PICTURES, SCANS, TICKS, TICKS)
    last = robot.base_state(0, TICKS - 1)
    assert newest["/odom"].pose.pose.position.x == last.pose.x
    assert newest["/odom"].pose.covariance[0] == last.covariance[0]
    assert newest["/odom"].pose.covariance[31] == newest["/odom"].pose.covariance[11] == last.covariance[4]
    yaw = 2 * math.atan2(newest["/odom"].pose.pose.orientation.z, newest["/odom"].pose.pose.orientation.w)
    assert math.remainder(yaw - last.pose.yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert newest["/cmd_vel"].twist.linear.x == robot.applied(TICKS - 1).twist.v
    scan = robot.scan(0, SCANS - 1)
    assert np.array_equal(newest["/scan"].ranges, scan.ranges, equal_nan=True)
    assert newest["/scan"].angle_min == pytest.approx(float(scan.yaw[0]))
    assert newest["/tf_static"].transforms[0].child_frame_id == "laser"


def test_the_access_units_in_the_mcap_are_the_recorded_bytes(run: RunReader, tmp_path: Path) -> None:
    ros2 = pytest.importorskip("mcap_ros2.reader")
    write_mcap(run, tmp_path / "run.mcap", MOUNTS)
    units = [
        bytes(message.ros_msg.data)
        for message in ros2.read_ros2_messages(tmp_path / "run.mcap", topics=["/theta/video"])
    ]
    assert units == [unit.data for unit in run.access_units()]


@pytest.mark.parametrize(("look", "height"), [(Look.PANORAMA, 160), (Look.VIEW, 180)])
def test_the_film_has_every_picture_at_its_own_time(run: RunReader, tmp_path: Path, look: Look, height: int) -> None:
    out = tmp_path / "run.mp4"
    assert write_mp4(run, out, FilmSettings(look, width=320)) == PICTURES
    with av.open(str(out)) as film:
        frames = list(film.decode(video=0))
        assert film.streams.video[0].codec_context.name == "h264"
        assert (frames[0].width, frames[0].height, frames[0].format.name) == (320, height, "yuv420p")
    times = [float(frame.time or 0.0) for frame in frames]
    assert times == pytest.approx([0.08 * k for k in range(PICTURES)], abs=1e-3)


def test_a_film_of_a_span_without_pictures_is_refused_in_words(run: RunReader, tmp_path: Path) -> None:
    with pytest.raises(GhalError, match="no picture"):
        write_mp4(run, tmp_path / "none.mp4", FilmSettings(from_s=100.0))
    assert not (tmp_path / "none.mp4").exists()


def test_the_tables_hold_every_row_with_full_numbers(run: RunReader, tmp_path: Path) -> None:
    counts = write_csv(run, tmp_path / "tables")
    assert counts["ticks.csv"] == counts["base.csv"] == TICKS
    with (tmp_path / "tables" / "base.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["yaw_rad"]) for row in rows] == [robot.base_state(0, k).pose.yaw for k in range(TICKS)]
    with (tmp_path / "tables" / "scans.csv").open(newline="") as file:
        first = next(csv.DictReader(file))
    assert len(first["ranges_m"].split()) == 811
    assert first["ranges_m"].split()[0] == "nan"
