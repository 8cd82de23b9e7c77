"""In the guest: the same stream read and thrown away, with nothing behind the transfers. What this machine can do."""

from __future__ import annotations

import argparse
import asyncio
import json
import time

from drivers.theta_v import Mode
from drivers.theta_v.codec.payload import Packet
from drivers.theta_v.device import bringup
from drivers.theta_v.errors import ThetaGone
from drivers.theta_v.transport.libusb import LibUsbTransport
from tests.usb_kernel.client import MODES


async def run(mode: Mode, seconds: float) -> None:
    ends: list[int] = []

    def sink(stamp_ns: int, packets: list[Packet]) -> None:
        ends.extend(stamp_ns for _, payload in packets if len(payload) > 1 and payload[1] & 0x02)

    transport = LibUsbTransport()
    await transport.open(None, lambda _: None)
    try:
        video = bringup.functions(transport).video
        if video is None:
            raise ThetaGone("the camera is not in live mode")
        agreement = await bringup.agree(transport, video, mode)
        if agreement.pipe.alternate:
            await transport.set_interface(video.interface, agreement.pipe.alternate)
        await transport.start_video(agreement.pipe.endpoint, agreement.probe.max_payload_bytes, sink)
        while not ends:
            await asyncio.sleep(0.05)
        began, started = time.monotonic(), time.process_time()
        before = len(ends)
        await asyncio.sleep(seconds)
        wall_s, cpu_s, count = time.monotonic() - began, time.process_time() - started, len(ends) - before
        await transport.stop_video()
        await transport.set_interface(video.interface, 0)
    finally:
        await transport.close()
    print(json.dumps({"rate_hz": round(count / wall_s, 2), "cpu_s": round(cpu_s, 2)}), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("mode", choices=MODES)
    parser.add_argument("seconds", type=float)
    arguments = parser.parse_args()
    asyncio.run(run(MODES[arguments.mode], arguments.seconds))


if __name__ == "__main__":
    main()
