"""The live view costs the robot nothing, and whoever comes late sees pictures."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import rerun_cli

from ghal360_robot.cli.optional_value import LIVE, with_address
from ghal360_robot.logbook.mailbox import Mailbox
from ghal360_robot.logbook.pictures import pictures
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.logbook.settings import LiveSettings
from ghal360_robot.simulation.encoder import ThetaEncoder
from tests.logbook import robot
from tests.logbook.test_trouble import BUSY_S, other, video

if TYPE_CHECKING:
    from collections.abc import Iterator

import numpy as np

RERUN = str(Path(rerun_cli.__file__).parent / "rerun")
UP_S = 30.0


def free_port() -> int:
    with socket.socket() as trial:
        trial.bind(("127.0.0.1", 0))
        return int(trial.getsockname()[1])


@pytest.fixture
def live(tmp_path: Path) -> Iterator[tuple[Recorder, int]]:
    port = free_port()
    recorder = Recorder(tmp_path, properties={}, config_json="", live=LiveSettings(port=port))
    robot.wait_for(lambda: "rerun --connect" in said(recorder), UP_S)
    yield recorder, port
    recorder.close()


def said(recorder: Recorder) -> str:
    stats = recorder.stats.live
    return "" if stats is None else stats.said


def sent(recorder: Recorder) -> int:
    stats = recorder.stats.live
    return 0 if stats is None else stats.sent


def server_of(recorder: Recorder) -> subprocess.Popen[bytes]:
    feed = recorder._live
    assert feed is not None
    assert feed._server is not None
    return feed._server


def feed_pictures(recorder: Recorder, count: int) -> None:
    encoder = ThetaEncoder(320, 160, 30.0, 400_000)
    picture = np.full((160, 320, 3), 90, np.uint8)
    now = time.monotonic_ns()
    for k in range(count):
        unit = encoder.encode(picture)
        recorder.access_unit(now + k * 33_000_000, unit, k, k % 30 == 0, tainted=False)


def test_a_late_viewer_gets_statics_and_a_picture_that_can_be_decoded(
    live: tuple[Recorder, int], tmp_path: Path
) -> None:
    recorder, port = live
    feed_pictures(recorder, 75)
    before = sent(recorder)
    recorder.text(1, "test", "INFO", "the last thing before the viewer comes")
    robot.wait_for(lambda: recorder.stats.queued == 0 and sent(recorder) > before)
    out = tmp_path / "late.rrd"
    viewer = subprocess.Popen(
        [
            RERUN,
            "--port",
            str(free_port()),
            "--bind",
            "127.0.0.1",
            "--save",
            str(out),
            f"rerun+http://127.0.0.1:{port}/proxy",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        robot.wait_for(lambda: out.exists() and out.stat().st_size > 20_000, UP_S)
        time.sleep(0.5)  # what the viewer has, it writes a moment later
    finally:
        viewer.kill()
        viewer.wait()
    with RunReader(out) as reader:
        assert reader.run_id == recorder.run_id
        units = list(reader.access_units())
        assert units[0].keyframe
        assert len(list(pictures(reader))) == len(units) >= 30


def test_a_frozen_server_costs_nothing_and_the_end_does_not_wait_for_it(live: tuple[Recorder, int]) -> None:
    recorder, _ = live
    os.kill(server_of(recorder).pid, signal.SIGSTOP)
    longest = 0.0
    noise = os.urandom(40_000)
    for k in range(600):  # 24 MB: twice what the pipe and its queue hold
        begin = time.monotonic()
        recorder.access_unit(k, noise, k, k % 30 == 0, tainted=False)
        longest = max(longest, time.monotonic() - begin)
        if k % 50 == 0:
            robot.wait_for(lambda: recorder.stats.queued < 50)
    robot.wait_for(lambda: recorder.stats.live is not None and recorder.stats.live.dropped_video > 0, UP_S)
    begin = time.monotonic()
    assert recorder.close()
    assert time.monotonic() - begin < BUSY_S
    assert longest < BUSY_S
    with RunReader(recorder.folder) as reader:
        assert [unit.sequence for unit in reader.access_units()] == list(range(600))


def test_a_server_that_dies_is_started_again_and_viewers_get_everything_anew(live: tuple[Recorder, int]) -> None:
    recorder, _ = live
    first = server_of(recorder)
    first.kill()
    robot.wait_for(lambda: recorder.stats.live is not None and recorder.stats.live.restarts == 1, UP_S)
    robot.wait_for(lambda: recorder.stats.live is not None and recorder.stats.live.up, UP_S)
    assert server_of(recorder).pid != first.pid


def test_a_port_that_is_taken_is_told_in_words(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with Recorder(tmp_path, properties={}, config_json="", live=LiveSettings(port=port)) as recorder:
            robot.wait_for(lambda: "choose another port" in said(recorder), UP_S)


def test_a_killed_robot_leaves_no_server_behind(tmp_path: Path) -> None:
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom ghal360_robot.logbook.recorder import Recorder\n"
        "from ghal360_robot.logbook.settings import LiveSettings\n"
        "r = Recorder(Path(sys.argv[1]), properties={}, config_json='', live=LiveSettings(port=int(sys.argv[2])))\n"
        "while not r._live._server: time.sleep(0.01)\n"
        "print(r._live._server.pid, flush=True)\ntime.sleep(60)\n"
    )
    command = [os.sys.executable, "-c", code, str(tmp_path), str(free_port())]  # type: ignore[attr-defined]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, stderr=subprocess.DEVNULL)
    assert child.stdout is not None
    pid = int(child.stdout.readline())
    child.kill()
    child.communicate()
    robot.wait_for(lambda: _ended(pid), 10.0)


def _ended(pid: int) -> bool:
    """Also while nobody has asked for its exit status yet."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return True
    return state == "Z"


def test_starting_anew_waits_for_a_key_picture() -> None:
    mailbox = Mailbox(1 << 20, 100)
    mailbox.put(video(10, keyframe=True))
    mailbox.put(other())
    mailbox.start_anew()
    assert len(mailbox) == 0
    assert not mailbox.put(video(10, keyframe=False))
    assert mailbox.put(video(10, keyframe=True))


@pytest.mark.parametrize(
    ("args", "filled"),
    [
        (["--sim", "--live"], ["--sim", "--live", LIVE]),
        (["--live", "--sim"], ["--live", LIVE, "--sim"]),
        (["--live", "0.0.0.0:9999", "--sim"], ["--live", "0.0.0.0:9999", "--sim"]),
        (["--sim"], ["--sim"]),
    ],
)
def test_the_address_of_the_live_view_may_be_left_out(args: list[str], filled: list[str]) -> None:
    assert with_address(args) == filled
