"""In the guest: the simulated camera behind USB/IP, plugged into this kernel, and what is tried with it."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
import traceback
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from drivers.theta_v.simulator.camera import Composition, SimulatedThetaV
from drivers.theta_v.simulator.usbip_server import UsbIpServer
from tests.usb_kernel import video
from tests.usb_kernel.attach import Cable

RESULT = "RESULT "
PERIOD_S = 1001 / 30000
SCRATCH = Path("/run")
START_S = 60.0  # importing Python modules through a shared folder on an emulated CPU takes its time
ROOT = Path(__file__).parents[2]


class Encoder:
    """The camera's own: offers a picture every 33 ms while the host wants any, and remembers which it took."""

    def __init__(self, camera: SimulatedThetaV, units: dict[int, list[bytes]]) -> None:
        self.sent: list[int] = []
        """Checksums of the pictures that went out, in order."""
        self.late = 0
        """Pictures offered a period late or more: the guest's CPU was too busy."""
        self._camera, self._units = camera, units
        self._sums = {width: [zlib.crc32(u) for u in pictures] for width, pictures in units.items()}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Encoder:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        index, width = 0, 0
        due = time.monotonic()
        while not self._stop.wait(max(0.0, due - time.monotonic())):
            due += PERIOD_S
            if time.monotonic() - due > PERIOD_S:
                self.late += 1
                due = time.monotonic()
            demand = self._camera.demand
            if demand is None:
                width = 0
                continue
            if demand.width != width or self._camera.wants_keyframe:
                width, index = demand.width, -(-index // video.KEY_INTERVAL) * video.KEY_INTERVAL
            pictures = self._units[width]
            if self._camera.offer(pictures[index % len(pictures)]):
                self.sent.append(self._sums[width][index % len(pictures)])
            index += 1


def python(*words: object, timeout_s: float) -> subprocess.Popen[str]:
    del timeout_s
    return subprocess.Popen(
        [sys.executable, "-m", *map(str, words)], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


class Trial:
    def __init__(self, camera: SimulatedThetaV, encoder: Encoder) -> None:
        self.camera, self.encoder = camera, encoder
        self.results: dict[str, Any] = {}

    def client(self, name: str, mode: str, seconds: float, meanwhile: Callable[[], None] | None = None,
               *options: object) -> dict[str, Any]:  # fmt: skip
        log = SCRATCH / f"{name}.log"
        before, busy = len(self.encoder.sent), cpu_s()
        process = python("tests.usb_kernel.client", mode, seconds, log, *options, timeout_s=seconds)
        if meanwhile is not None:
            until(lambda: log.exists() and log.stat().st_size > 200, START_S)
            meanwhile()
        out, _ = process.communicate(timeout=seconds + START_S)
        found: dict[str, Any] = {"exit": process.returncode}
        try:
            found |= json.loads(out.splitlines()[-1])
        except (ValueError, IndexError):
            found["output"] = out[-2000:]
        lines = [line.split(" ", 2) for line in log.read_text().splitlines()] if log.exists() else []
        got = [(int(crc, 16), taint == "-") for _, crc, taint in lines]
        sent = self.encoder.sent[before:]
        found |= compare(sent, got) | {"cpu": {k: round(v - busy[k], 1) for k, v in cpu_s().items()}}
        self.results[name] = found
        print(name, json.dumps(found), flush=True)
        return found


def compare(sent: list[int], got: list[tuple[int, bool]]) -> dict[str, int]:
    """How the pictures that came relate to those that were sent, walking along both in order."""
    at = identical = wrong = 0
    first = True
    missing = 0
    for crc, clean in got:
        try:
            found = sent.index(crc, at)
        except ValueError:
            wrong += clean
            continue
        identical += 1
        if not first:
            missing += found - at
        first = False
        at = found + 1
    return {
        "sent": len(sent), "got": len(got), "identical": identical, "clean": sum(c for _, c in got),
        "clean_but_wrong": wrong, "missing_between": missing,
    }  # fmt: skip


def cpu_s() -> dict[str, float]:
    """What this machine's processors did so far, and this process's part of it."""
    fields = Path("/proc/stat").read_text(encoding="ascii").split("\n")[0].split()[1:9]
    user, nice, system, idle, wait, irq, soft, steal = (int(f) / os.sysconf("SC_CLK_TCK") for f in fields)
    return {
        "user": user + nice, "system": system, "interrupts": irq + soft, "idle": idle + wait, "stolen": steal,
        "camera": time.process_time(),
    }  # fmt: skip


def until(condition: Callable[[], bool], timeout_s: float) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("what was waited for did not happen")
        time.sleep(0.05)


def smoke(trial: Trial) -> None:
    trial.client("2k", "2k", 10)


def trial4k(trial: Trial) -> None:
    trial.client("4k32", "4k", 10)
    trial.client("4k64", "4k", 10, None, "--packets", 64)
    trial.client("4k128", "4k", 10, None, "--packets", 128, "--transfers", 32)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("plan", choices=PLANS)
    parser.add_argument("videos", type=Path)
    arguments = parser.parse_args()
    units = {video.MODES[mode][0]: video.load(video.prepared(mode, arguments.videos)) for mode in video.MODES}
    camera = SimulatedThetaV(composition=Composition.MTP, asleep=True)
    started = time.monotonic()
    with UsbIpServer(camera) as server, Encoder(camera, units) as encoder, Cable("127.0.0.1", server.port) as cable:
        trial = Trial(camera, encoder)
        try:
            PLANS[arguments.plan](trial)
        except (OSError, ValueError, subprocess.SubprocessError, TimeoutError):
            trial.results["error"] = traceback.format_exc()
        trial.results |= {
            "plugged_in": cable.plugged_in, "late": encoder.late, "overruns": camera.overruns,
            "seconds": round(time.monotonic() - started, 1),
        }  # fmt: skip
    print(RESULT + json.dumps(trial.results), flush=True)


PLANS: dict[str, Callable[[Trial], None]] = {"smoke": smoke, "t": trial4k}

if __name__ == "__main__":
    main()
