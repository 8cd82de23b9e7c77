"""In the guest: the simulated camera behind USB/IP, plugged into this kernel, and what is tried with it."""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.descriptors import Composition
from drivers.theta_v.simulator.usbip_server import UsbIpServer
from tests.usb_kernel import video
from tests.usb_kernel.attach import Cable
from tests.usb_kernel.encoder import Encoder
from tests.usb_kernel.trial import Trial

RESULT = "RESULT "


def smoke(trial: Trial) -> None:
    """Mode switch and ten seconds of 2K."""
    trial.client("client-2k", "2k", 10)
    trial.floor("2k", 3)


def full(trial: Trial) -> None:
    trial.probe("2k", 60)
    trial.probe("4k", 60)
    trial.floor("4k", 10)
    trial.replug()
    trial.restarts()
    trial.kill()


def bulk(trial: Trial) -> None:
    """Firmware that sends video through a bulk endpoint."""
    trial.client("bulk-2k", "2k", 10)
    trial.floor("2k", 3)


PLANS: dict[str, tuple[Callable[[Trial], None], ...]] = {"smoke": (smoke,), "full": (full, bulk)}


def session(plan: Callable[[Trial], None], units: dict[int, list[bytes]]) -> Trial:
    """One camera, in still mode and asleep, from plugging it in to unplugging it."""
    camera = SimulatedThetaV(composition=Composition.MTP, asleep=True, bulk_video=plan is bulk)
    with UsbIpServer(camera) as server, Encoder(camera, units) as encoder, Cable("127.0.0.1", server.port):
        trial = Trial(camera, encoder)
        try:
            plan(trial)
            trial.results[f"pace-{plan.__name__}"] = {"verdict": trial.judge_pace()}
        except (OSError, KeyError, ValueError, subprocess.SubprocessError) as error:
            trial.failures.append(f"the trial itself: {error!r}")
    return trial


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("plan", choices=PLANS)
    parser.add_argument("videos", type=Path)
    arguments = parser.parse_args()
    units = {video.MODES[mode][0]: video.load(video.prepared(mode, arguments.videos)) for mode in video.MODES}
    started = time.monotonic()
    trials = [session(plan, units) for plan in PLANS[arguments.plan]]
    failures = [failure for trial in trials for failure in trial.failures]
    result = {
        "failures": failures, "too_slow": [complaint for trial in trials for complaint in trial.too_slow],
        "runs": {name: run for trial in trials for name, run in trial.results.items()},
        "overruns": sum(trial.camera.overruns for trial in trials), "late": sum(t.encoder.late for t in trials),
        "guest_s": round(time.monotonic() - started, 1),
    }  # fmt: skip
    print(RESULT + json.dumps(result), flush=True)


if __name__ == "__main__":
    main()
