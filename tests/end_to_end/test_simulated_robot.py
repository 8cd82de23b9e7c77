"""The whole robot on its simulated hardware: processes, wires, loop, recording."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from drivers.tim571.codec import scandata
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.telegram import Receiver, Telegram
from ghal360_robot.cli.session import simulated
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.journal import RunReport
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.messages import STILL, HeadPose, OperatorInput, Twist
from ghal360_robot.robot import Robot
from ghal360_robot.simulation.link import Scenario
from ghal360_robot.simulation.remote_operator import RemoteOperator
from ghal360_robot.simulation.session import SimulatedHardware
from tests.end_to_end.conftest import ghal360

pytestmark = pytest.mark.alone

CONFIG = with_overrides(RobotConfig(), {"perception": {"detector": "painted", "target": "backpack"}})
ENTITIES = {
    "theta/video", "theta/objects", "lidar/scan", "lidar/raw", "base/state", "can/rx", "can/tx", "tf/base",
    "operator/head", "operator/command", "scene/wedges", "guidance/cue", "guidance/q", "intent/belief", "cmd/wanted",
    "cmd/applied", "state/arm", "state/theta", "state/tim571", "state/rmp110", "loop/timing", "loop/inputs",
    "sim/truth", "sim/map", "world/map", "world/target",
}  # fmt: skip


async def run_robot(scenario: Scenario, record_to: Path, until, operator=None) -> RunReport:  # type: ignore[no-untyped-def]
    """Run the robot in this process until `until(robot, hardware)` returns."""
    async with SimulatedHardware(scenario) as hardware:
        robot = Robot(simulated(CONFIG, hardware), operator or RemoteOperator(hardware), record_to)
        hardware.record_into(robot)
        stop = asyncio.Event()
        running = asyncio.create_task(robot.run(stop))
        waiting = asyncio.create_task(until(robot, hardware))
        await asyncio.wait({running, waiting}, return_when=asyncio.FIRST_COMPLETED)
        stop.set()
        report = await running
        await waiting
        return report


async def met(condition, what: str, timeout_s: float = 30.0) -> None:  # type: ignore[no-untyped-def]
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, f"waited {timeout_s} s for: {what}"
        await asyncio.sleep(0.02)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunReport, Path, list[str]]:
    """One run of a few metres: report, recording, and the camera's own list of what it sent."""
    folder = tmp_path_factory.mktemp("recorded")
    tape = folder / "camera.tape"

    async def drive_a_little(robot: Robot, _hardware: SimulatedHardware) -> None:
        await robot.started.wait()
        await met(lambda: robot.journal.distance_m > 0.5, "half a metre driven", 60)

    scenario = Scenario(seed=3, operator=True, camera_tape=str(tape))
    report = asyncio.run(run_robot(scenario, folder, drive_a_little))
    return report, Path(str(report.recording)), tape.read_text(encoding="ascii").split()


def test_the_recording_holds_every_entity(recorded: tuple[RunReport, Path, list[str]]) -> None:
    with RunReader(recorded[1]) as reader:
        missing = ENTITIES - set(reader.entities())
    assert missing == set()


def test_access_units_are_byte_identical_to_what_the_camera_sent(
    recorded: tuple[RunReport, Path, list[str]],
) -> None:
    with RunReader(recorded[1]) as reader:
        kept = [hashlib.sha256(unit.data).hexdigest() for unit in reader.access_units()]
    sent = recorded[2]
    assert len(kept) > 30
    first = sent.index(kept[0])
    assert sent[first : first + len(kept)] == kept


def test_recorded_scans_are_what_the_recorded_telegrams_say(recorded: tuple[RunReport, Path, list[str]]) -> None:
    with RunReader(recorded[1]) as reader:
        wire = b"".join(telegram.data for telegram in reader.telegrams())
        scans = list(reader.scans())
    sent = {
        data.scan_counter: data.channel("DIST1").samples
        for event in Receiver(Dialect.B).feed(wire)
        if isinstance(event, Telegram) and scandata.is_scan(event)
        for data in [scandata.decode(event)]
    }
    assert len(scans) > 30
    for scan in scans:  # a robot that came late has scans it never looked at, in their telegrams only
        raw = sent[scan.scan_counter]
        expected = np.where(raw < 16, np.nan, raw.astype(np.float32) * np.float32(1e-3))
        np.testing.assert_allclose(scan.ranges, expected, rtol=1e-6)


def test_can_frames_are_recorded_both_ways_and_motion_keeps_its_limits(
    recorded: tuple[RunReport, Path, list[str]],
) -> None:
    with RunReader(recorded[1]) as reader:
        frames = list(reader.can_frames())
    assert {frame.direction for frame in frames} == {"rx", "tx"}
    motion = [np.frombuffer(f.data, ">f4") for f in frames if f.direction == "tx" and f.can_id == 0x500]
    assert len(motion) > 50
    assert all(np.isfinite(pair).all() and np.abs(pair).max() <= 1.0 for pair in motion)
    assert {f.can_id for f in frames if f.direction == "tx"} == {0x500, 0x501}


def test_the_robot_drove_and_hit_nothing(recorded: tuple[RunReport, Path, list[str]]) -> None:
    report = recorded[0]
    assert report.distance_m > 0.4
    assert report.ticks > 300
    assert report.tim571["lost"] == report.tim571["damaged"] == 0
    assert report.theta["damaged"] == 0
    assert report.recording_bytes > 100_000


class SteadyHand:
    """An operator who turns the robot on the spot, arming it whenever it is ready, until told to be silent."""

    rate_hz = 20.0

    def __init__(self) -> None:
        self.silent = False
        self.last_ns = 0

    async def run(self, robot: Robot) -> None:
        presses = 0
        while True:
            if not self.silent:
                if not robot.not_ready() and robot.journal.arms == len(robot.journal.stops):
                    presses += 1
                self.last_ns = time.monotonic_ns()
                robot.board.put_operator(
                    OperatorInput(self.last_ns, HeadPose(), deadman=True, stick=Twist(0.0, 0.4), arm_presses=presses)
                )
            await asyncio.sleep(0.05)


def turning(robot: Robot) -> bool:
    return robot.board.base is not None and abs(robot.board.base.twist.w) > 0.2


@pytest.mark.parametrize("device", ["tim571", "rmp110", "theta"])
def test_a_device_that_vanishes_stops_the_robot_which_goes_on_when_armed_again(device: str, tmp_path: Path) -> None:
    async def cut_in_the_middle(robot: Robot, hardware: SimulatedHardware) -> None:
        await robot.started.wait()
        await met(lambda: turning(robot), "turning")
        hardware.cut(device, 5.0)
        await met(lambda: robot.journal.stops, "the stop", 10)
        await met(lambda: not robot.not_ready() or robot.journal.arms > 1, "all devices back", 30)
        await met(lambda: robot.journal.arms == 2, "the operator's second arming", 30)
        await met(lambda: turning(robot), "turning again")

    report = asyncio.run(run_robot(Scenario(seed=3), tmp_path, cut_in_the_middle, SteadyHand()))
    words = {"tim571": "lidar", "rmp110": "base", "theta": "video"}
    assert words[device] in report.stops[0]["reason"]
    assert getattr(report, device)["reconnects"] >= 1
    with RunReader(Path(str(report.recording))) as reader:
        warnings = [text.text for text in reader.texts() if text.level in {"WARN", "ERROR"}]
        ticks = sum(1 for _ in reader.ticks())
    assert any(words[device] in text for text in warnings)
    assert ticks == report.ticks


def test_hardware_that_is_killed_ends_in_standstill_and_a_whole_recording(tmp_path: Path) -> None:
    async def kill_all(robot: Robot, hardware: SimulatedHardware) -> None:
        await robot.started.wait()
        await met(lambda: turning(robot), "turning")
        assert hardware.pid is not None
        os.kill(hardware.pid, signal.SIGKILL)
        await met(lambda: robot.journal.stops, "the stop", 10)

    report = asyncio.run(run_robot(Scenario(seed=3), tmp_path, kill_all, SteadyHand()))
    assert report.stops
    with RunReader(Path(str(report.recording))) as reader:
        assert reader.damage == []
        last = list(reader.ticks())[-1]
    assert last.applied.twist == STILL


def motion_frames(run: Path) -> list[tuple[int, tuple[float, float]]]:
    with RunReader(run) as reader:
        frames = [f for f in reader.can_frames() if f.direction == "tx" and f.can_id == 0x500]
    return [(frame.stamp_ns, struct.unpack(">2f", frame.data)) for frame in frames]


def test_a_silent_operator_means_zero_on_the_wire_within_300_ms(tmp_path: Path) -> None:
    hand = SteadyHand()

    async def fall_silent(robot: Robot, _hardware: SimulatedHardware) -> None:
        await robot.started.wait()
        await met(lambda: turning(robot), "turning")
        hand.silent = True
        await met(lambda: robot.journal.stops, "disarmed", 10)

    report = asyncio.run(run_robot(Scenario(seed=3), tmp_path, fall_silent, hand))
    assert "operator lost" in report.stops[0]["reason"]
    moving = [stamp for stamp, motion in motion_frames(Path(str(report.recording))) if any(motion)]
    assert (moving[-1] - hand.last_ns) / 1e6 <= 300


def test_sigusr1_is_a_bookmark_and_sigterm_stops_the_base_and_closes_the_recording(tmp_path: Path) -> None:
    words = ["run", "--sim", "--operator", "virtual", "--seed", "3", "--record", str(tmp_path), "--json"]
    running = subprocess.Popen(
        [sys.executable, "-m", "ghal360_robot", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with running:
        try:
            # The search of this seed begins to drive after ten seconds and takes half a minute.
            with pytest.raises(subprocess.TimeoutExpired):
                running.wait(20)
            running.send_signal(signal.SIGUSR1)
            running.terminate()
            began = time.monotonic()
            out, err = running.communicate(timeout=20)
        finally:
            running.kill()
    assert running.returncode == 0, err
    assert time.monotonic() - began < 10
    run = Path(json.loads(out.strip().splitlines()[-1])["recording"])
    motion = motion_frames(run)
    with RunReader(run) as reader:
        assert reader.damage == []
        modes = [f.data[7] for f in reader.can_frames() if f.direction == "tx" and f.data[:4] == b"\0\0\0\x20"]
    assert any(any(pair) for _, pair in motion)
    assert motion[-1][1] == (0.0, 0.0)
    assert modes[-1] == 4  # STANDBY
    assert "by SIGUSR1: (no note)" in ghal360("inspect", run).out


def test_real_panoramas_and_real_telegrams_run_through_the_same_wires(shared_data: Path, tmp_path: Path) -> None:
    ran = ghal360(
        "run", "--sim", "--duration", 10, "--json", "--record", tmp_path,
        "--camera-images", shared_data / "panoramas" / "theta_v",
        "--lidar-replay", shared_data / "tim" / "tim781s_cola_b.rec",
    )  # fmt: skip
    assert ran.status == 0, ran.err
    report = ran.json
    assert report["theta"]["received"] >= 80
    assert report["tim571"]["received"] >= 120
    assert report["theta"]["damaged"] == 0
    assert report["tim571"]["damaged"] <= 1  # where the tape begins anew, its clock jumps: one telegram is doubted
    with RunReader(Path(report["recording"])) as reader:
        scans = list(reader.scans())
        assert sum(1 for _ in reader.access_units()) >= 80
    assert all(len(scan.ranges) == 811 and scan.rssi is not None for scan in scans)


def test_inspect_prints_the_rates_of_a_recording(recorded: tuple[RunReport, Path, list[str]]) -> None:
    ran = ghal360("inspect", recorded[1], "--json")
    assert ran.status == 0, ran.err
    rates = {row["entity"]: row["rate_hz"] for row in ran.json["entities"]}
    assert 14 < rates["lidar/scan"] < 16
    assert 9 < rates["theta/video"] < 13
    people = ghal360("inspect", recorded[1])
    assert people.status == 0
    assert "theta/video" in people.out
