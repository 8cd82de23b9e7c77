"""In the guest: the driver as the robot uses it, writing down what every picture was. One process a run."""

from __future__ import annotations

import argparse
import asyncio
import json
import time
import zlib
from dataclasses import asdict
from pathlib import Path

from drivers.theta_v import AccessUnit, Mode, ThetaConfig, ThetaV
from drivers.theta_v.transport.libusb import LibUsbTransport
from drivers.theta_v.transport.libusb_video import Queue

FIRST_S = 60.0  # waking, switching and negotiating on an emulated CPU

MODES = {"2k": Mode.TWO_K, "4k": Mode.FOUR_K}


async def run(mode: str, seconds: float, log: Path, queue: Queue) -> None:
    with log.open("w", buffering=1) as file:

        def note(unit: AccessUnit) -> None:
            file.write(f"{unit.sequence} {zlib.crc32(unit.raw):08x} {unit.taint or '-'}\n")

        config = ThetaConfig(mode=MODES[mode], backoff_max_s=1.0)
        started, began = time.process_time(), time.monotonic()
        async with ThetaV(lambda: LibUsbTransport(queue=queue), config, on_access_unit=note) as camera:
            async with asyncio.timeout(FIRST_S):
                while not camera.stats.received:
                    await asyncio.sleep(0.05)
            await asyncio.sleep(seconds)
            stats = camera.stats
    print(
        json.dumps(
            asdict(stats)
            | {"cpu_s": round(time.process_time() - started, 2), "wall_s": round(time.monotonic() - began, 2)}
        ),
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("mode", choices=MODES)
    parser.add_argument("seconds", type=float)
    parser.add_argument("log", type=Path)
    parser.add_argument("--transfers", type=int, default=64)
    parser.add_argument("--packets", type=int, default=32)
    arguments = parser.parse_args()
    queue = Queue(arguments.transfers, arguments.packets)
    asyncio.run(run(arguments.mode, arguments.seconds, arguments.log, queue))


if __name__ == "__main__":
    main()
