"""The tick's cost and the CAN reader's throughput, on small samples."""

from __future__ import annotations

import contextlib
import gc
import json
import sys
from dataclasses import replace

import pytest

from ghal360_robot.bench import can_feedback, tick
from ghal360_robot.cli import bench as cli
from ghal360_robot.config import RobotConfig
from ghal360_robot.errors import GhalError


@pytest.mark.alone
def test_a_tick_keeps_its_budget_and_leaves_the_interpreter_as_it_was() -> None:
    before = sys.getswitchinterval(), gc.get_freeze_count()
    cost = tick.measure(2000)
    assert (sys.getswitchinterval(), gc.get_freeze_count()) == before
    assert cost.total.p50_us <= tick.LIMIT_MS * 1e3  # the percentiles beyond are for a quiet machine
    for part in (cost.decode, cost.chain, cost.encode, cost.floor):
        assert 0 < part.p50_us <= part.p99_us <= part.max_us
    assert cost.ratio > 1


def test_the_measured_ticks_are_those_of_a_driving_robot() -> None:
    ticker = tick.Ticker(tick.Drive(tick.BEGIN_NS, RobotConfig()))
    moved = [ticker.tick()[1] for _ in range(2 * tick.WARM_UP)]
    assert not moved[0]
    assert sum(moved[tick.WARM_UP :]) > tick.LEAST_MOVED * tick.WARM_UP


@pytest.mark.parametrize("as_json", [False, True])
def test_the_command_prints_the_parts(as_json: bool, capsys: pytest.CaptureFixture[str]) -> None:
    with contextlib.suppress(GhalError):  # on a busy machine
        cli.tick(1000, as_json)
    out = capsys.readouterr().out
    assert all(part in out for part in ("decode", "chain", "encode", "scan", "floor"))
    assert not as_json or json.loads(out.splitlines()[-1])["ticks"] == 1000


@pytest.mark.parametrize(("interface", "seconds"), [("virtual", 2), ("socketcand", 5)])
def test_the_reader_loses_nothing_of_a_hundred_full_packets_a_second(interface: str, seconds: int) -> None:
    run = can_feedback.measure(interface, seconds)
    assert run.polls > 50 * seconds
    assert run.frames_lost == run.damaged == run.polls_dropped == 0, run.to_json()
    # Two cores that stand still for 20 ms in the middle of a packet tear it; the benchmark itself allows none.
    assert run.lost == run.torn <= run.polls // 50, run.to_json()
    assert 0 < run.reader_cpu < 0.5


def test_a_run_with_losses_does_not_pass() -> None:
    whole = can_feedback.FeedbackRun("virtual", 1.0, 100, 0, 4800, 100, 0, 0, 0.1, 0.1)
    assert whole.passed
    assert not replace(whole, packets=99).passed
    assert not replace(whole, torn=1).passed
    assert not replace(whole, damaged=1).passed
    assert not replace(whole, polls_dropped=1).passed
    assert not replace(whole, polls=0, packets=0).passed
    assert replace(whole, frames=4700).frames_lost == 100
