"""Half an hour of scans at fifteen times the speed, and a hundred reconnects: does anything grow or stay behind?

    make soak-lidar
    python benchmarks/lidar_soak.py --seconds 30 --reconnects 20

Driver and simulated lidar live in this process, on loopback, with split, delayed and damaged telegrams. Half of
the reconnects break the connection, half pull the plug. The last line is one JSON object; exit status 1 if something
grew, stayed behind or did not come back.
"""

from __future__ import annotations

import argparse
import asyncio
import ctypes
import gc
import json
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from drivers.tim571 import TcpTransport, TiM571, Tim571Simulator, TimConfig
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.device.stats import LinkState
from drivers.tim571.simulator.behaviour import DeviceSettings
from drivers.tim571.simulator.faults import FaultPlan

SPEED = 15
RATE_HZ = 15.0 * SPEED
WARM_UP_S = 60.0  # the allocator of a process that makes arrays 1,000 times a second settles within 40 s
MOST_GROWTH_MB = 3.0  # 5 MB an hour is allowed, and the resident size of a quiet process wanders by 0.5 MB
PATIENCE_S = 10.0
FAULTS = FaultPlan(split=0.1, delay=0.01, delay_s=0.02, corrupt=0.001, jitter_s=100e-6)
HASTY = TimConfig(answer_timeout_s=1.0, dialect_timeout_s=0.5, backoff_first_s=0.005, backoff_max_s=0.05)


@dataclass(frozen=True)
class Soaked:
    """What was seen."""

    seconds: float
    received: int
    lost: int
    damaged: int
    dropped: int
    reconnects: int
    slowest_reconnect_s: float
    grown_mb: float
    tasks_left: int
    descriptors_left: int

    @property
    def good(self) -> bool:
        return self.grown_mb < MOST_GROWTH_MB and self.tasks_left == self.descriptors_left == 0


def resident_mb() -> float:
    """This process's resident size once the allocator has given back what is free: what is left is in use."""
    gc.collect()
    with suppress(OSError, AttributeError):  # another C library than glibc
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - the listing's own descriptor is in it either way


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - conditions of many kinds, none of them an event
            await asyncio.sleep(0.002)


async def reconnect(simulator: Tim571Simulator, lidar: TiM571, pull: bool) -> float:
    """Break the connection, wait for the next scan; returns how long that took."""
    began_s, before = time.monotonic(), lidar.stats
    if pull:
        await simulator.unplug()
        await until(lambda: lidar.stats.state is not LinkState.STREAMING)
        await simulator.replug()
    else:
        simulator.hang_up()
    await until(lambda: lidar.stats.reconnects > before.reconnects and lidar.stats.received > before.received)
    return time.monotonic() - began_s


async def soak(seconds: float, reconnects: int, warm_up_s: float = WARM_UP_S, dialect: Dialect = Dialect.B) -> Soaked:
    """Stream for that long, then reconnect so often; raises TimeoutError if scans do not come back."""
    tasks, files = len(asyncio.all_tasks()), descriptors()
    settings = DeviceSettings(scan_rate_hz=RATE_HZ)
    async with Tim571Simulator(dialect=dialect, settings=settings, faults=FAULTS) as simulator:
        async with TiM571(TcpTransport(simulator.host, simulator.port), HASTY) as lidar:
            began_s = time.monotonic()
            warm_mb = 0.0
            async for _ in lidar.scans():
                now_s = time.monotonic() - began_s
                if not warm_mb and now_s > warm_up_s:
                    warm_mb = resident_mb()
                if now_s > warm_up_s + seconds:
                    break
            grown_mb = resident_mb() - warm_mb
            streamed = lidar.stats
            took_s = [await reconnect(simulator, lidar, pull=bool(number % 2)) for number in range(reconnects)]
            again = lidar.stats.reconnects - streamed.reconnects
        await until(lambda: simulator.clients == 0)
    await until(lambda: len(asyncio.all_tasks()) <= tasks)
    return Soaked(
        seconds=round(time.monotonic() - began_s, 1),
        received=streamed.received,
        lost=streamed.lost,
        damaged=streamed.damaged,
        dropped=streamed.dropped,
        reconnects=again,
        slowest_reconnect_s=round(max(took_s, default=0.0), 3),
        grown_mb=round(grown_mb, 2),
        tasks_left=len(asyncio.all_tasks()) - tasks,
        descriptors_left=descriptors() - files,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--reconnects", type=int, default=100)
    parser.add_argument("--dialect", choices=["a", "b"], default="b")
    options = parser.parse_args()
    found = asyncio.run(soak(options.seconds, options.reconnects, dialect=Dialect(options.dialect)))
    print(json.dumps(asdict(found) | {"good": found.good}))
    return 0 if found.good else 1


if __name__ == "__main__":
    sys.exit(main())
