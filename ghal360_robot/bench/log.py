"""What logging costs beside a floor: the same bytes written with plain `write`, by the same loop."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ghal360_robot.bench.log_subject import Report, Subject
from ghal360_robot.errors import GhalError

if TYPE_CHECKING:
    from collections.abc import Callable

CPU_PERCENT = 20.0
"""Of one core (DESIGN, budgets)."""
SHARE_OF_RAW = 1.05
MB_PER_MIN = 2.0

START_S = 120.0
"""A machine with much else to do may take as long to begin, and to catch up."""


@dataclass(frozen=True, slots=True)
class LogCost:
    """Everything per second or minute of the run."""

    seconds: float
    picture_hz: float
    mbit_s: float
    cpu_percent: float
    """Of one core: with logging, less the loop that only writes the bytes."""
    floor_cpu_percent: float
    """The loop that makes the bytes and writes them."""
    writer_cpu_percent: float
    """The logbook's own thread."""
    raw_mb_per_min: float
    file_mb_per_min: float
    allowed_mb_per_min: float
    lateness_ms: dict[str, float]
    floor_lateness_ms: dict[str, float]
    rows_per_s: float
    rss_mb: float
    live: bool

    @property
    def passed(self) -> bool:
        return self.cpu_percent <= CPU_PERCENT and self.file_mb_per_min <= self.allowed_mb_per_min

    def to_json(self) -> dict[str, Any]:
        return asdict(self) | {"passed": self.passed}


def measure(
    seconds: float,
    *,
    picture_hz: float,
    mbit_s: float,
    live_port: int = 0,
    say: Callable[[str], None] = lambda _: None,
) -> LogCost:
    """Run both processes one after the other. Raises GhalError where one does not end properly."""
    with tempfile.TemporaryDirectory(prefix="ghal360-bench-") as folder:
        here = Path(folder)
        say("the same bytes with plain write ...")
        plain, logged = here / "floor", here / "log"
        for directory in (plain, logged):
            directory.mkdir()
        bare = Subject(str(plain), seconds, log=False, picture_hz=picture_hz, mbit_s=mbit_s, marks=(0, 0, 0))
        floor = run_subject(bare)
        say("everything into the logbook ...")
        report = run_subject(replace(bare, directory=str(logged), log=True, live_port=live_port))
        written = sum(file.stat().st_size for file in logged.rglob("*") if file.is_file())
    minutes = report.seconds / 60.0
    raw = report.raw_bytes / 1e6 / minutes
    return LogCost(
        seconds=round(report.seconds, 1),
        picture_hz=picture_hz,
        mbit_s=mbit_s,
        cpu_percent=round(100 * (report.cpu_s / report.seconds - floor.cpu_s / floor.seconds), 1),
        floor_cpu_percent=round(100 * floor.cpu_s / floor.seconds, 1),
        writer_cpu_percent=round(100 * report.writer_cpu_s / report.seconds, 1),
        raw_mb_per_min=round(raw, 2),
        file_mb_per_min=round(written / 1e6 / minutes, 2),
        allowed_mb_per_min=round(SHARE_OF_RAW * raw + MB_PER_MIN, 2),
        lateness_ms=report.lateness_ms,
        floor_lateness_ms=floor.lateness_ms,
        rows_per_s=round(report.stats["written"] / report.seconds, 0),
        rss_mb=round(report.rss_mb, 0),
        live=bool(live_port),
    )


def run_subject(subject: Subject) -> Report:
    """One measured process from start to end."""
    command = [sys.executable, "-m", "ghal360_robot.bench.log_subject", json.dumps(asdict(subject))]
    limit_s = subject.seconds + START_S
    done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s, check=False)  # noqa: S603 - ours
    if done.returncode:
        raise GhalError(f"the measured process failed: {done.stderr.strip().splitlines()[-1:]}")
    return Report(**json.loads(done.stdout.splitlines()[-1]))
