"""What the logbook does when viewers, disks and the process itself fail: `make test-logbook`, about six minutes.

Every case runs a control loop at the budget's rates (`ghal360_robot.bench.log_subject`), lets something fail, and
compares what was sent with what is in the files, row for row. Required: nothing is lost except the last 0.3 s of a
killed process and what no disk takes; ticks are as punctual as without the fault; the process ends within 3 s.

    python -m benchmarks.logbook_faults [--case NAME ...] [--seconds 12] [--kills 20] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import rerun_cli

from ghal360_robot.bench.log_subject import COUNTED, COUNTERS, Report, Subject
from ghal360_robot.logbook.errors import RecordingNotReadableError
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recovery import recover_runs
from ghal360_robot.logbook.rrd import chunk_row_ids

RERUN = str(Path(rerun_cli.__file__).parent / "rerun")
EXIT_S = 3.0
KILL_LOSS_S = 0.3
NOISE_MS = 5.0
"""A p99 is the sixth latest of 600 ticks: beyond twice that of the runs without any fault, and so much more."""
QUIET = "no live view"
BETWEEN_S = {"theta/video": 0.02, "lidar/raw": 0.06, "lidar/scan": 0.06, "operator/command": 0.04}
"""What does not come at every tick: from its newest row to the last tick, where nothing is lost."""
FAULT_S = 3.0
"""Seconds into the run at which something fails."""
SMALL_DISK = 24 << 20


@dataclass(slots=True)
class Result:
    """One case."""

    name: str
    sent: int = 0
    found: int = 0
    lost: dict[str, int] = field(default_factory=dict)
    lost_s: float | None = None
    """After kill -9: from the newest row of the worst entity to the last tick."""
    lateness_ms: dict[str, float] = field(default_factory=dict)
    exit_s: float | None = None
    told: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    trouble: list[str] = field(default_factory=list)


@dataclass(slots=True)
class Stage:
    """Where one case happens."""

    folder: Path
    seconds: float
    result: Result
    process: subprocess.Popen[str] | None = None
    began_s: float = 0.0

    def wait_until(self, second: float) -> None:
        time.sleep(max(0.0, self.began_s + second - time.monotonic()))

    def server(self) -> int:
        """The live view's server."""
        pids = [int(p.name) for p in Path("/proc").iterdir() if p.name.isdigit()]
        for pid in pids:
            try:
                words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
                parent = int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[1])
            except OSError:
                continue
            if (
                self.process is not None
                and parent == self.process.pid
                and b"ghal360_robot.logbook.live_server" in words
            ):
                return pid
        raise RuntimeError("there is no live server")


def run_case(stage: Stage, subject: Subject, fault: Callable[[Stage], None] | None = None) -> Report | None:
    """Run the subject to its end by SIGTERM; `fault` runs meanwhile, from the first tick on."""
    command = [sys.executable, "-m", "ghal360_robot.bench.log_subject", json.dumps(asdict(subject))]
    log = (stage.folder / "stderr.txt").open("w")
    process = stage.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
    wait_for_line(process)
    stage.began_s = time.monotonic()
    if fault is not None:
        fault(stage)
    stage.wait_until(stage.seconds)
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
    ended_s = time.monotonic()
    try:
        said, _ = process.communicate(timeout=30)
    except subprocess.TimeoutExpired:
        process.kill()
        said, _ = process.communicate()
        stage.result.trouble.append("did not end within 30 s of SIGTERM")
    stage.result.exit_s = round(time.monotonic() - ended_s, 2)
    if stage.result.exit_s > EXIT_S:
        stage.result.trouble.append(f"took {stage.result.exit_s} s to end")
    lines = said.splitlines()
    return Report(**json.loads(lines[-1])) if lines and lines[-1].startswith("{") else None


def conclude(stage: Stage, report: Report | None, *, may_lose: bool = False) -> None:
    """Compare what was sent with what the files have."""
    result = stage.result
    if report is None:
        result.trouble.append("the process left no report: " + (stage.folder / "stderr.txt").read_text()[-300:])
        return
    found, damage = count_rows(stage.folder / "runs" / "run")
    compare(result, report.sent, found)
    result.lateness_ms, result.told, result.damage = report.lateness_ms, report.not_recorded, damage
    if result.lost and not may_lose:
        result.trouble.append(f"rows lost: {result.lost}")
    if result.lost and may_lose and not result.told:
        result.trouble.append("rows lost and nobody was told")


def compare(result: Result, sent: dict[str, int], found: dict[str, int]) -> None:
    result.sent, result.found = sum(sent.values()), sum(found.get(name, 0) for name in COUNTED)
    result.lost = {name: sent[name] - found.get(name, 0) for name in COUNTED if sent[name] != found.get(name, 0)}


def count_rows(folder: Path) -> tuple[dict[str, int], list[str]]:
    """Rows by entity, each counted once wherever it lies."""
    ids: dict[str, set[bytes]] = {name: set() for name in COUNTED}
    try:
        with RunReader(folder) as reader:
            for part in reader.parts:
                for chunk in part.chunks():
                    entity = chunk.entity_path.lstrip("/")
                    if entity in ids and not chunk.is_static:
                        ids[entity].update(chunk_row_ids(chunk))
            return {name: len(found) for name, found in ids.items()}, reader.damage
    except RecordingNotReadableError as error:
        return {}, [str(error)]


def subject_in(stage: Stage, **changes: object) -> Subject:
    runs = stage.folder / "runs"
    runs.mkdir(exist_ok=True)
    subject = Subject(str(runs), 3600.0, marks=(0, 0, 0))
    return replace(subject, **changes)  # type: ignore[arg-type]


def start_viewer(port: int) -> subprocess.Popen[bytes]:
    """A viewer without a window: it takes everything and writes it to nowhere. Ended after its case."""
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    command = [RERUN, "--bind", "127.0.0.1", "--port", str(free_port()), "--save", os.devnull, url]
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    viewers.append(process)
    return process


class SlowLink(threading.Thread):
    """A TCP relay that lets through so many bytes a second towards the viewer."""

    def __init__(self, to_port: int, bytes_per_s: int) -> None:
        super().__init__(daemon=True)
        self._to, self._rate = to_port, bytes_per_s
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.passed = 0

    def run(self) -> None:
        near, _ = self._listener.accept()
        far = socket.create_connection(("127.0.0.1", self._to))
        far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 65_536)
        threading.Thread(target=self._pump, args=(near, far, None), daemon=True).start()
        self._pump(far, near, self._rate)

    def _pump(self, source: socket.socket, target: socket.socket, rate: int | None) -> None:
        try:
            while data := source.recv(16_384):
                target.sendall(data)
                if rate is not None:
                    self.passed += len(data)
                    time.sleep(len(data) / rate)
        except OSError:
            return


@contextmanager
def small_disk(stage: Stage, size: int = SMALL_DISK) -> Iterator[Path | None]:
    """A disk of this size under the stage's folder; None where nothing may be mounted."""
    place = stage.folder / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)], capture_output=True, check=False
    )
    if mounted.returncode:
        yield None
        return
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=False)


def no_live(stage: Stage) -> None:
    conclude(stage, run_case(stage, subject_in(stage)))


def no_viewer(stage: Stage) -> None:
    conclude(stage, run_case(stage, subject_in(stage, live_port=free_port())))


def viewer_case(what: Callable[[Stage, subprocess.Popen[bytes]], None]) -> Callable[[Stage], None]:
    def case(stage: Stage) -> None:
        port = free_port()

        def fault(stage: Stage) -> None:
            wait_for_port(port)
            process = start_viewer(port)
            stage.wait_until(FAULT_S)
            if process.poll() is not None:
                stage.result.trouble.append("the viewer did not live long enough to fail")
            what(stage, process)

        conclude(stage, run_case(stage, subject_in(stage, live_port=port), fault))

    return case


viewers: list[subprocess.Popen[bytes]] = []
"""A frozen one stays until its case is over: the robot has to end beside it."""


def slow_link(stage: Stage) -> None:
    port = free_port()
    link: list[SlowLink] = []

    def fault(stage: Stage) -> None:
        wait_for_port(port)
        link.append(SlowLink(port, 1_000_000))
        link[0].start()
        start_viewer(link[0].port)

    # At three times the usual rate, so that the link is far too slow within the case.
    conclude(stage, run_case(stage, subject_in(stage, live_port=port, mbit_s=36.0), fault))
    if not link or link[0].passed < 1_000_000:
        stage.result.trouble.append("hardly anything went over the slow link: the case shows nothing")


def server_case(number: signal.Signals) -> Callable[[Stage], None]:
    def case(stage: Stage) -> None:
        def fault(stage: Stage) -> None:
            stage.wait_until(FAULT_S)
            os.kill(stage.server(), number)

        conclude(stage, run_case(stage, subject_in(stage, live_port=free_port()), fault))

    return case


def disk_full(stage: Stage) -> None:
    """Full at about half time, and nothing helps: what was lost has to have been told."""
    with small_disk(stage, 12 << 20) as disk:
        if disk is None:
            limits = {"file_limit": 10 << 20, "limit_s": (0.0, 1e9)}
            report = run_case(stage, subject_in(stage, **limits))
        else:
            (stage.folder / "runs").symlink_to(disk)
            report = run_case(stage, subject_in(stage))
        conclude(stage, report, may_lose=True)


def disk_back(stage: Stage) -> None:
    """Full for four seconds, then there is room again: memory bridges that."""
    with small_disk(stage, 200 << 20) as disk:
        if disk is None:
            limits = {"file_limit": 8 << 20, "limit_s": (0.0, 9.0)}
            conclude(stage, run_case(stage, subject_in(stage, **limits)))
            return
        (stage.folder / "runs").symlink_to(disk)

        def fault(stage: Stage) -> None:
            stage.wait_until(FAULT_S)
            ballast = disk / "ballast"
            subprocess.run(["dd", "if=/dev/zero", f"of={ballast}", "bs=1M"], capture_output=True, check=False)
            stage.wait_until(FAULT_S + 4)
            ballast.unlink()

        conclude(stage, run_case(stage, subject_in(stage), fault))
    if not stage.result.told:
        stage.result.trouble.append("nobody was told that the disk was full")


def second_disk(stage: Stage) -> None:
    with small_disk(stage, 12 << 20) as disk:
        second = stage.folder / "second"
        second.mkdir()
        if disk is None:
            stage.result.trouble.append("not run: nothing may be mounted here")
            return
        (stage.folder / "runs").symlink_to(disk)
        conclude(stage, run_case(stage, subject_in(stage, second_directory=str(second))))


def removed(stage: Stage) -> None:
    def fault(stage: Stage) -> None:
        stage.wait_until(FAULT_S)
        shutil.rmtree(stage.folder / "runs" / "run")

    conclude(stage, run_case(stage, subject_in(stage), fault))


def rotation(stage: Stage) -> None:
    conclude(stage, run_case(stage, subject_in(stage, part_s=2.0)))
    parts = len(list((stage.folder / "runs" / "run").glob("part-*.rrd")))
    if parts < 3:
        stage.result.trouble.append(f"only {parts} parts")


def killed(stage: Stage, moments: random.Random) -> None:
    """kill -9 at a random moment, read, recover, read again."""
    runs = stage.folder / "runs"
    runs.mkdir()
    subject = subject_in(stage)
    command = [sys.executable, "-m", "ghal360_robot.bench.log_subject", json.dumps(asdict(subject))]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    wait_for_line(process)
    time.sleep(moments.uniform(1.0, 8.0))
    process.kill()
    process.communicate()
    *sent, last_ns = COUNTERS.unpack((stage.folder / "runs.counters").read_bytes())
    counts = dict(zip(COUNTED, sent, strict=True))
    for when in ("as it was left", "recovered"):
        found, damage = count_rows(runs / "run")
        compare(stage.result, counts, found)
        stage.result.lost_s = max(stage.result.lost_s or 0.0, lost_seconds(runs / "run", last_ns))
        if stage.result.lost_s > KILL_LOSS_S:
            stage.result.trouble.append(f"{when}: the last {stage.result.lost_s:.2f} s are lost")
        if when == "recovered" and damage:
            stage.result.trouble.append(f"recovered, and still: {damage}")
        stage.result.damage += damage
        recover_runs(runs)


def lost_seconds(folder: Path, last_ns: int) -> float:
    """From the newest row of the entity that lacks most to the last one it had before the kill, at the latest."""
    lost = []
    with RunReader(folder) as reader:
        for entity in COUNTED:
            stamps = [reader.anchor.to_monotonic(row.t_ns) for row in reader.rows(entity, last_ns - 3_000_000_000)]
            lost.append((last_ns - max(stamps, default=0)) / 1e9 - BETWEEN_S.get(entity, 0.0))
    return round(max(0.0, *lost), 3)


def truncated(stage: Stage) -> None:
    """The last part loses its last third: what lies before is there."""
    report = run_case(stage, subject_in(stage))
    path = stage.folder / "runs" / "run" / "part-000.rrd"
    os.truncate(path, path.stat().st_size * 2 // 3)
    conclude(stage, report, may_lose=True)
    result = stage.result
    result.trouble = [] if result.found and result.damage else ["the rest cannot be read, or nothing is said of it"]
    video = report.sent["theta/video"] if report is not None else 0
    kept = video - result.lost.get("theta/video", 0)
    if kept < 0.6 * video:
        result.trouble.append(f"only {kept} of {video} pictures are left of two thirds of the file")


CASES: dict[str, Callable[[Stage], None]] = {
    QUIET: no_live,
    "live, no viewer": no_viewer,
    "viewer killed": viewer_case(lambda _, process: process.kill()),
    "viewer frozen": viewer_case(lambda _, process: process.send_signal(signal.SIGSTOP)),
    "viewer at 1 MB/s": slow_link,
    "live server frozen": server_case(signal.SIGSTOP),
    "live server killed": server_case(signal.SIGKILL),
    "rotation": rotation,
    "disk full": disk_full,
    "disk full and back": disk_back,
    "second disk": second_disk,
    "folder removed": removed,
    "file truncated": truncated,
}


def wait_for_line(process: subprocess.Popen[str]) -> None:
    """Until the subject's loop is about to begin."""
    if process.stdout is not None:
        process.stdout.readline()


def free_port() -> int:
    with socket.socket() as trial:
        trial.bind(("127.0.0.1", 0))
        return int(trial.getsockname()[1])


def wait_for_port(port: int) -> None:
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        try:
            socket.create_connection(("127.0.0.1", port), 0.2).close()
        except OSError:
            time.sleep(0.1)
        else:
            return
    raise RuntimeError("the live view does not come up")


def perform(name: str, seconds: float, case: Callable[[Stage], None]) -> Result:
    with tempfile.TemporaryDirectory(prefix="ghal360-faults-") as folder:
        stage = Stage(Path(folder), seconds, Result(name))
        try:
            case(stage)
        except (RuntimeError, OSError, AssertionError, subprocess.SubprocessError) as error:
            stage.result.trouble.append(f"the case itself failed: {error!r}")
        finally:
            if stage.process is not None and stage.process.poll() is None:
                stage.process.kill()
                stage.process.wait()
            while viewers:
                process = viewers.pop()
                process.kill()
                process.wait()
        return stage.result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", action="append", choices=[*CASES, "kill -9"])
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    wanted = options.case or [*CASES, "kill -9"]
    if len(wanted) > 1 and QUIET in wanted:
        wanted = [*wanted[: len(wanted) // 2], QUIET, *wanted[len(wanted) // 2 :], QUIET]
    results = []
    for name in wanted:
        if name == "kill -9":
            moments = random.Random(options.seed)
            results += [
                perform(f"kill -9, {k + 1} of {options.kills}", 0.0, partial(killed, moments=moments))
                for k in range(options.kills)
            ]
        else:
            results.append(perform(name, options.seconds, CASES[name]))
            say(results[-1])
    if len(wanted) > 1 and QUIET in wanted:
        judge_lateness(results)
    kills = [result for result in results if result.lost_s is not None]
    if kills:
        losses = [result.lost_s or 0.0 for result in kills]
        print(f"kill -9 at {len(kills)} moments: lost {np.median(losses):.3f} s, at most {max(losses):.3f} s")
    failed = [result for result in results if result.trouble]
    for result in failed:
        print(f"FAILED {result.name}: {'; '.join(result.trouble)}")
    if options.json:
        print(json.dumps({"passed": not failed, "cases": [asdict(result) for result in results]}))
    return 1 if failed else 0


def judge_lateness(results: list[Result]) -> None:
    """No fault may make the ticks later than they are without one: before the faults, among them, after them."""
    quiet = [result.lateness_ms.get("p99", 0.0) for result in results if result.name == QUIET]
    limit_ms = 2 * float(np.median(quiet)) + NOISE_MS
    for result in results:
        p99 = result.lateness_ms.get("p99", 0.0)
        if p99 > limit_ms:
            result.trouble.append(f"p99 of the ticks' lateness {p99} ms, without faults {quiet} ms")


def say(result: Result) -> None:
    late = result.lateness_ms
    print(
        f"{result.name:20s} sent {result.sent:7d} found {result.found:7d} lost {sum(result.lost.values()):6d}  "
        f"ticks late p50 {late.get('p50', 0):.1f} p99 {late.get('p99', 0):.1f} max {late.get('max', 0):.0f} ms  "
        f"exit {result.exit_s} s  {'; '.join(result.told)}",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
