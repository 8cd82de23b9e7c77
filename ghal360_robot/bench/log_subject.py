"""The measured process: a control loop that gives everything to a recorder, or only writes the raw bytes.

`python -m ghal360_robot.bench.log_subject '{"directory": ..., "seconds": ...}'`. It ends by SIGTERM or by itself, and
its last line is a report. What it has sent stands in a file of counters at any time, so that a killed process is
known to the row.
"""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import mmap
import resource
import signal
import struct
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ghal360_robot.bench.log_flow import CONFIG, TICKS_PER_S, Flow, Rates
from ghal360_robot.logbook.disk import Watermarks
from ghal360_robot.logbook.handler import LogbookHandler
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.logbook.settings import LiveSettings, RecorderSettings
from ghal360_robot.robot import SWITCH_INTERVAL_S
from ghal360_robot.simulation.lockstep import TICK_NS
from ghal360_robot.timing import Lateness

COUNTED = (
    "theta/video",
    "lidar/raw",
    "lidar/scan",
    "can/rx",
    "can/tx",
    "base/state",
    "operator/command",
    "loop/inputs",
)
"""Entities with a row for everything that was sent."""
COUNTERS = struct.Struct(f"<{len(COUNTED)}qq")
"""And the stamp of the last tick."""
WARM_UP_TICKS = 100
"""Imports, first chunks, first flush: two seconds that are no run."""


@dataclass(frozen=True, slots=True)
class Subject:
    """What to run."""

    directory: str
    seconds: float
    log: bool = True
    second_directory: str = ""
    live_port: int = 0
    picture_hz: float = 30.0
    mbit_s: float = 12.0
    part_bytes: int = 512 << 20
    part_s: float = 600.0
    marks: tuple[int, int, int] = (64 << 20, 32 << 20, 4 << 20)
    file_limit: int = 0
    """No file may grow beyond this between `limit_s`: stands in for a full disk where none can be mounted."""
    limit_s: tuple[float, float] = (0.0, 0.0)
    run_id: str = "run"


@dataclass(slots=True)
class Report:
    """What it came to."""

    seconds: float = 0.0
    sent: dict[str, int] = field(default_factory=dict)
    raw_bytes: int = 0
    cpu_s: float = 0.0
    writer_cpu_s: float = 0.0
    lateness_ms: dict[str, float] = field(default_factory=dict)
    skipped: int = 0
    rss_mb: float = 0.0
    closed: bool = True
    close_s: float = 0.0
    stats: dict[str, Any] = field(default_factory=dict)
    not_recorded: list[str] = field(default_factory=list)
    """Everything the status line said was missing, once each."""


async def run(subject: Subject) -> Report:
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    directory = Path(subject.directory)
    flow = Flow(Rates(subject.picture_hz, subject.mbit_s))
    recorder = _recorder(subject, directory) if subject.log else None
    handler = None if recorder is None else LogbookHandler(recorder)
    if handler is not None:
        logging.getLogger().addHandler(handler)
    plain = None if subject.log else (directory / "floor.bin").open("wb", buffering=0)
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    counters = _counters(directory.parent / f"{directory.name}.counters")
    sys.stdout.write("running\n")
    sys.stdout.flush()
    report, lateness = Report(), Lateness()
    began_ns = due_ns = time.monotonic_ns()
    cpu_s = time.process_time()
    tick, ticks = 0, round(subject.seconds * TICKS_PER_S)
    missing: dict[str, None] = {}
    while tick < ticks and not stop.is_set():
        await asyncio.sleep(max(0.0, (due_ns - time.monotonic_ns()) / 1e9))
        now_ns = time.monotonic_ns()
        if tick >= WARM_UP_TICKS:
            lateness.note((now_ns - due_ns) / 1e6)
        raw = flow.give(recorder, tick, now_ns)
        if plain is not None:
            plain.write(b"".join(raw))
        counters[:] = COUNTERS.pack(*(flow.sent[name] for name in COUNTED), now_ns)
        tick += 1
        due_ns += TICK_NS
        if (late := (time.monotonic_ns() - due_ns) // TICK_NS) > 0:
            lateness.skipped += late
            due_ns += late * TICK_NS
        if recorder is not None and tick % TICKS_PER_S == 0:
            missing.update(dict.fromkeys(recorder.stats.not_recorded))
            _limit(subject, tick / TICKS_PER_S)
    report.seconds = (time.monotonic_ns() - began_ns) / 1e9
    report.cpu_s = time.process_time() - cpu_s
    if handler is not None:
        logging.getLogger().removeHandler(handler)
    if recorder is not None:
        await _close(recorder, report)
    report.sent = {name: flow.sent[name] for name in COUNTED}
    report.raw_bytes, report.skipped = flow.raw_bytes, lateness.skipped
    report.lateness_ms = lateness.summary()
    report.rss_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    report.not_recorded = list(missing)
    return report


async def _close(recorder: Recorder, report: Report) -> None:
    began_s = time.monotonic()
    report.closed = await asyncio.to_thread(recorder.close)
    report.close_s = time.monotonic() - began_s
    report.stats = asdict(recorder.stats)
    report.writer_cpu_s = recorder.stats.writer_cpu_s


def _recorder(subject: Subject, directory: Path) -> Recorder:
    second = Path(subject.second_directory) if subject.second_directory else None
    return Recorder(
        directory,
        run_id=subject.run_id,
        properties={"robot": "bench"},
        config_json=CONFIG.model_dump_json(indent=1),
        settings=RecorderSettings(
            second_directory=second,
            part_bytes=subject.part_bytes,
            part_s=subject.part_s,
            watermarks=Watermarks(*subject.marks),
        ),
        live=LiveSettings(port=subject.live_port) if subject.live_port else None,
    )


def _limit(subject: Subject, at_s: float) -> None:
    if subject.file_limit:
        begin, end = subject.limit_s
        soft = subject.file_limit if begin <= at_s < end else resource.RLIM_INFINITY
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, resource.RLIM_INFINITY))


def _counters(path: Path) -> mmap.mmap:
    with path.open("w+b") as file:
        file.truncate(COUNTERS.size)
        return mmap.mmap(file.fileno(), COUNTERS.size)


def main() -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    logging.basicConfig(level=logging.INFO, stream=sys.stderr)
    told = json.loads(sys.argv[1])
    for name in ("marks", "limit_s"):
        if name in told:
            told[name] = tuple(told[name])
    report = asyncio.run(run(Subject(**told)))
    sys.stdout.write(json.dumps(asdict(report)) + "\n")


if __name__ == "__main__":
    main()
