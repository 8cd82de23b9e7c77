"""How far the stamps of scans are from the truth, over a real socket.

    python benchmarks/lidar_clock.py
    python benchmarks/lidar_clock.py --seconds 60 --drift 20 --json

The simulated lidar and the driver share this process and its clock. Its own clock drifts, every telegram is late by
an exponentially distributed time, and now and then the line stalls. Whatever the machine itself adds while the
simulator works is part of the lateness: run it on a quiet one. Exit status 1 if a stamp is off by 200 us or more.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys

import numpy as np

from drivers.tim571 import TcpTransport, TiM571, Tim571Simulator
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.simulator.behaviour import DeviceSettings
from drivers.tim571.simulator.faults import FaultPlan

SETTLED_S = 5.0
WANTED_US = 200.0


async def errors_us(
    seconds: float, drift_ppm: float, jitter_s: float, stalls: float
) -> tuple[list[float], list[float]]:
    """Stamp minus truth, and lateness of the arrival without a fit, in microseconds, from the fifth second on."""
    faults = FaultPlan(jitter_s=jitter_s, delay=stalls, delay_s=0.070)
    stamps: list[float] = []
    arrivals: list[float] = []
    async with (
        Tim571Simulator(dialect=Dialect.B, settings=DeviceSettings(drift_ppm=drift_ppm), faults=faults) as simulator,
        TiM571(TcpTransport(simulator.host, simulator.port)) as lidar,
    ):
        began_ns = 0
        async for scan in lidar.scans():
            truth = simulator.finished(scan.scan_counter)
            began_ns = began_ns or scan.arrival_ns
            if truth is not None and scan.arrival_ns - began_ns > SETTLED_S * 1e9:
                delay_ns = 1000 * ((scan.transmit_time_us - scan.device_time_us) % (1 << 32))
                stamps.append((scan.stamp_ns - truth.end_ns) / 1e3)
                arrivals.append((scan.arrival_ns - delay_ns - truth.end_ns) / 1e3)
            if scan.arrival_ns - began_ns > (SETTLED_S + seconds) * 1e9:
                return stamps, arrivals
    raise RuntimeError("the scans ended")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--drift", type=float, default=5.0, help="ppm")
    parser.add_argument("--jitter", type=float, default=100e-6, help="mean, seconds")
    parser.add_argument("--stalls", type=float, default=0.02, help="chance for each telegram")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    stamps, arrivals = asyncio.run(errors_us(options.seconds, options.drift, options.jitter, options.stalls))
    found = {}
    for words, errors in (("stamps", np.array(stamps)), ("arrivals", np.array(arrivals))):
        found[words] = {
            "scans": len(errors),
            "median_us": round(float(np.median(errors)), 1),
            "p99_us": round(float(np.percentile(np.abs(errors), 99)), 1),
            "worst_us": round(float(np.abs(errors).max()), 1),
        }
        print(f"{words:8} {found[words]}")
    good = found["stamps"]["worst_us"] < WANTED_US
    if options.json:
        print(json.dumps(found | {"good": good}))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
