"""The stops themselves, with a whole robot in a process of its own; the full list is `ghal360 bench stop`."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ghal360_robot.bench.stand import Stand
from ghal360_robot.bench.stop import CAUSES, measure
from ghal360_robot.bench.subject import Order
from ghal360_robot.bench.subject_process import SubjectError, SubjectProcess
from ghal360_robot.cli import bench as cli
from ghal360_robot.errors import UsageError
from ghal360_robot.simulation.link import Endpoints
from tests.end_to_end.conftest import ghal360

BUSY_MS = 150.0
"""Tests share two cores with whatever else runs; the command itself allows nothing."""


@pytest.mark.alone
@pytest.mark.parametrize("name", ["loop-blocked", "sigkill"])
async def test_the_robot_stops_in_time(name: str) -> None:
    cause = next(cause for cause in CAUSES if cause.name == name)
    sample = await measure(cause)
    assert sample.stop.speed_mps > 0.4
    assert sample.passed(BUSY_MS), sample.to_json()
    if name == "sigkill":
        assert sample.exit_status == -signal.SIGKILL
        assert sample.stop.zero_ms is None  # nobody was left to send one


@pytest.mark.alone
def test_the_command_measures_one_cause_and_says_so_in_json() -> None:
    ran = ghal360("bench", "stop", "--cause", "operator-silent", "--json")
    (told,) = ran.json["stops"]
    assert told["cause"] == "operator-silent"
    assert told["to_zero_limit_ms"] == 300
    assert 0 < told["to_zero_ms"] <= told["to_zero_limit_ms"] + BUSY_MS
    assert told["to_zero_ms"] < told["to_standstill_ms"] <= told["to_standstill_limit_ms"] + BUSY_MS
    assert "operator stale" in told["samples"][0]["said"]
    assert ran.status == (0 if told["passed"] else 1), ran.err


def test_an_unknown_cause_is_a_wrong_request() -> None:
    with pytest.raises(UsageError, match="operator-silent"):
        cli.stop(cause=["boredom"])


def alive(pid: int) -> bool:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, 0)
        return True
    return False


async def test_leaving_the_measurement_leaves_no_process(tmp_path: Path) -> None:
    async with Stand() as stand:
        async with SubjectProcess(stand.endpoints, tmp_path) as subject:
            pid = subject.pid
            assert alive(pid)
        assert not alive(pid)


def test_the_robot_ends_when_nobody_holds_its_pipe_any_more(tmp_path: Path) -> None:
    orders = json.dumps({"theta": 1, "tim571": 1, "rmp110": 1, "record_to": str(tmp_path)}) + "\n"
    ran = subprocess.run(
        [sys.executable, "-m", "ghal360_robot.bench.subject"],
        input=orders.encode(), capture_output=True, timeout=30, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr


async def test_a_dead_process_does_not_leave_the_measurement_waiting(tmp_path: Path) -> None:
    async with SubjectProcess(Endpoints(theta=1, tim571=1, rmp110=1), tmp_path) as subject:
        os.kill(subject.pid, signal.SIGKILL)
        assert await subject.exit_status(5.0) == -signal.SIGKILL
        with pytest.raises(SubjectError, match="did not carry out"):
            await subject.order(Order.PRESS_ESTOP)
