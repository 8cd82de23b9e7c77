"""What is tried in the guest, and what must come of it. Every run is a process of its own."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from drivers.theta_v.simulator.camera import SimulatedThetaV
from tests.usb_kernel.encoder import RATE_HZ, Encoder

SCRATCH = Path("/run")
START_S = 90.0  # importing Python modules through a shared folder on an emulated CPU takes its time
ROOT = Path(__file__).parents[2]
ENOUGH = 0.99  # of the pictures of the time: the first and the last are cut off by starting and stopping


class Trial:
    """What arrives must be whole, whatever else the machine does; how fast is judged beside what it can do."""

    def __init__(self, camera: SimulatedThetaV, encoder: Encoder) -> None:
        self.camera, self.encoder = camera, encoder
        self.results: dict[str, Any] = {}
        self.failures: list[str] = []
        self.too_slow: list[str] = []
        """Failures too, if this machine had nothing else to do; only the host knows."""
        self.slow: dict[str, int] = {}
        """Runs in which pictures came late, or the camera dropped them because nobody fetched them in time; and how
        often its own encoder was late then, which is for want of processor time and nothing else."""
        self._overruns = self._late = 0

    def probe(self, mode: str, seconds: float) -> None:
        """`ghal360 probe theta-v`, as the person at the robot runs it."""
        folder = SCRATCH / "probe"
        before, late, busy = len(self.encoder.sent), self.encoder.late, cpu_s()
        words = [
            Path(sys.executable).with_name("ghal360"), "probe", "theta-v", "--mode", mode, "--seconds", seconds,
            "--save", folder, "--json",
        ]  # fmt: skip
        out, status = self._end(python(*words), seconds)
        found = last_line(out)
        name = f"probe-{mode}"
        if status != 0:
            self._note(name, found | {"exit": status})
            self._expect(name, "exit", False)
            return
        with (folder / "units.csv").open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        got = [(int(row["crc32"], 16), not row["taint"]) for row in rows]
        survey = json.loads((folder / "readings.json").read_text(encoding="utf-8"))["survey"]
        shutil.rmtree(folder)
        found |= compare(self.encoder.sent[before:], got) | {
            "exit": status, "kernel_drivers": kernel_drivers(), "reenumeration_s": survey["reenumeration_s"],
            "late": self.encoder.late - late, "taints": dict(Counter(row["taint"] or "-" for row in rows)),
            "cpu_s": {name: round(value - busy[name], 1) for name, value in cpu_s().items()},
        }  # fmt: skip
        self._note(name, found)
        self._expect_pace(name, found.get("pictures", 0) >= ENOUGH * seconds * RATE_HZ and not found.get("restarts"))
        self._expect_whole(name, found)

    def client(self, name: str, mode: str, seconds: float, meanwhile: Callable[[], None] | None = None) -> None:
        """The driver as the robot uses it, reconnecting for ever."""
        log = SCRATCH / f"{name}.log"
        before = len(self.encoder.sent)
        process = python("-m", "tests.usb_kernel.client", mode, seconds, log)
        if meanwhile is not None:
            until(lambda: log.exists() and log.stat().st_size > 1000, START_S)
            meanwhile()
        out, status = self._end(process, seconds)
        got = [(int(crc, 16), taint == "-\n") for crc, taint in (line.split(" ", 2)[1:] for line in log.open())]
        taints = Counter(line.split(" ", 2)[2].strip() for line in log.open())
        found = last_line(out) | compare(self.encoder.sent[before:], got) | {"exit": status, "taints": dict(taints)}
        self._note(name, found)
        self._expect(name, "exit", status == 0)
        self._expect(name, "streaming to the end", found.get("link") == "streaming")
        self._expect_pace(name, found.get("rate_hz", 0.0) > 25 and not found.get("restarts"))
        self._expect_whole(name, found)
        until(lambda: self.camera.demand is None, 5.0)

    def floor(self, mode: str, seconds: float) -> None:
        """The same stream, read and thrown away."""
        out, status = self._end(python("-m", "tests.usb_kernel.floor", mode, seconds), seconds)
        found = last_line(out)
        self._note(f"floor-{mode}", found)
        self._expect(f"floor-{mode}", "exit", status == 0)
        until(lambda: self.camera.demand is None, 5.0)

    def judge_pace(self) -> str:
        """Too slow is the driver where the machine was not: its encoder in time, and a bare reader in real time."""
        floor_hz = min(
            (run.get("rate_hz", 0.0) for name, run in self.results.items() if name.startswith("floor")), default=0.0
        )
        if not self.slow:
            return "real time"
        if floor_hz >= ENOUGH * RATE_HZ:
            self.too_slow += [f"{name}: not in real time" for name, late in self.slow.items() if not late]
        runs = ", ".join(f"{name} (encoder late {late} times)" for name, late in self.slow.items())
        return f"not in real time: {runs}; a bare reader gets {floor_hz:.2f} Hz here"

    def replug(self) -> None:
        """The cable is pulled for two seconds in the middle of the stream."""

        def pull() -> None:
            self.camera.unplug()
            time.sleep(2)
            self.camera.replug()

        self.client("replug", "2k", 15, pull)
        self._expect("replug", "reconnected", self.results["replug"].get("reconnects", 0) > 0)

    def restarts(self) -> None:
        for turn in range(3):
            self.client(f"restart-{turn}", "2k", 3)

    def kill(self) -> None:
        """A driver that dies in the middle leaves nothing behind that hinders the next."""
        log = SCRATCH / "killed.log"
        process = python("-m", "tests.usb_kernel.client", "2k", 60, log)
        until(lambda: log.exists() and log.stat().st_size > 1000, START_S)
        process.send_signal(signal.SIGKILL)
        process.wait(5)
        self.client("after-kill", "2k", 5)

    def _end(self, process: subprocess.Popen[str], seconds: float) -> tuple[str, int]:
        try:
            out, _ = process.communicate(timeout=seconds + START_S)
        except subprocess.TimeoutExpired:
            process.kill()
            out, _ = process.communicate()
        return out, process.returncode

    def _note(self, name: str, found: dict[str, Any]) -> None:
        self.results[name] = found
        print(name, json.dumps(found), flush=True)

    def _expect(self, name: str, what: str, met: bool) -> None:
        if not met:
            self.failures.append(f"{name}: not {what}")

    def _expect_pace(self, name: str, met: bool) -> None:
        overruns, self._overruns = self.camera.overruns - self._overruns, self.camera.overruns
        late, self._late = self.encoder.late - self._late, self.encoder.late
        if not met or overruns:
            self.slow[name] = late

    def _expect_whole(self, name: str, found: dict[str, Any]) -> None:
        self._expect(name, "byte for byte", found["clean_but_wrong"] == 0 and found["identical"] == found["got"] > 0)
        self._expect(name, "gapless", found["missing_between"] == 0 or name == "replug" or bool(found.get("restarts")))
        # Pictures the camera itself had to drop leave the rest of their group tainted, and rightly so.
        self._expect(name, "called clean", found["clean"] == found["got"] or name in self.slow)


def python(*words: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, *map(str, words)], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def last_line(out: str) -> dict[str, Any]:
    """The JSON object a program ends with; what it said instead, if it did not."""
    try:
        found: dict[str, Any] = json.loads(out.splitlines()[-1])
    except (ValueError, IndexError):
        return {"output": out[-2000:]}
    return found


def compare(sent: list[int], got: list[tuple[int, bool]]) -> dict[str, int]:
    """How the pictures that came relate to those that were sent: checksums, in order, and who is called clean."""
    at = identical = wrong = missing = 0
    for crc, clean in got:
        try:
            found = sent.index(crc, at)
        except ValueError:
            wrong += clean
            continue
        missing += found - at if identical else 0
        identical += 1
        at = found + 1
    return {
        "sent": len(sent), "got": len(got), "identical": identical, "clean": sum(clean for _, clean in got),
        "clean_but_wrong": wrong, "missing_between": missing,
    }  # fmt: skip


def kernel_drivers() -> dict[str, str]:
    """Which of Linux's own drivers sits on which interface of the camera, now that ours has let go."""
    links = sorted(Path("/sys/bus/usb/devices").glob("*:1.*/driver"))
    found = {link.parent.name: link.resolve().name for link in links}
    return {interface: driver for interface, driver in found.items() if driver != "hub"}


def cpu_s() -> dict[str, float]:
    """What this machine's processors did so far, and this process's part of it."""
    fields = Path("/proc/stat").read_text(encoding="ascii").split("\n")[0].split()[1:8]
    user, nice, system, idle, wait, irq, soft = (int(f) / os.sysconf("SC_CLK_TCK") for f in fields)
    return {
        "user": user + nice, "system": system, "interrupts": irq + soft, "idle": idle + wait,
        "camera": time.process_time(),
    }  # fmt: skip


def until(condition: Callable[[], bool], timeout_s: float) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("what was waited for did not happen")
        time.sleep(0.05)
