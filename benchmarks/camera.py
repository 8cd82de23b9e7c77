"""What the camera's driver costs: assembly, decoding beside bare PyAV, end-to-end latency, and losses it misses.

    nice -n -5 python -m benchmarks.camera [--seconds 20]

One JSON object on the last line, with the machine's load in it. Streams are synthetic, at the camera's sizes and
bit rates. The collecting thread's work is measured on libusb's real transfer objects, filled by hand; what the
kernel does is not in it.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import usb1

from drivers.theta_v import AccessUnit, Mode, ThetaConfig, ThetaV
from drivers.theta_v.codec.access_units import AccessUnitTracker
from drivers.theta_v.codec.descriptors import ISOCHRONOUS, Endpoint
from drivers.theta_v.codec.h264 import opens_stream
from drivers.theta_v.codec.payload import Assembler
from drivers.theta_v.device.collector import Collector
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.faults import FaultPlan, spoil
from drivers.theta_v.simulator.packetiser import packetise
from drivers.theta_v.simulator.usbip_server import UsbIpServer
from drivers.theta_v.transport.libusb_video import Queue, VideoTransfers
from drivers.theta_v.transport.microframes import NOTHING
from drivers.theta_v.transport.usbip import UsbIpTransport
from tests.usb_kernel import video
from tests.usb_kernel.kernel import CACHE

PERIOD_S = 1001 / 30000
MICROFRAME_S = 125e-6
PACKET_BYTES = 3072
REPEATS = 3
PICTURES, DECODED = 10_000, 1500  # of each kind of loss; where the decoder has a say, it takes its time


def stream(mode: str) -> list[bytes]:
    return video.load(video.prepared(mode, CACHE / "video"))


def microframes(units: list[bytes]) -> list[bytes]:
    """What passes on the bus, 8000 packets a second, most of them empty behind each picture."""
    slots = [b""] * round(len(units) * PERIOD_S / MICROFRAME_S)
    at = 0
    for index, unit in enumerate(units):
        at = max(at, round(index * PERIOD_S / MICROFRAME_S))
        packets = packetise(unit, index & 1)
        slots[at : at + len(packets)] = packets
        at += len(packets)
    return slots


class Handle:
    """Gives out libusb's own transfers, which are filled here instead of by a kernel."""

    def getTransfer(self, iso_packets: int = 0) -> Any:  # noqa: N802 the name is usb1's
        def nothing(*_: object, **__: object) -> Callable[[], None]:
            return lambda: None

        return usb1.USBTransfer(None, None, iso_packets, nothing, nothing, nothing, False, False)


def assembly(units: list[bytes], queue: Queue) -> dict[str, float]:
    """CPU time of the collecting thread's Python for a second of video, as a part of one core."""
    collector = Collector(None)
    transfers = VideoTransfers(
        Handle(), Endpoint(0x84, ISOCHRONOUS, PACKET_BYTES, 1), PACKET_BYTES, queue, collector.packets, print
    )
    transfers._submit = lambda _: True  # type: ignore[method-assign]
    transfer = transfers._transfers[0]
    table, buffer = transfers._tables[id(transfer)], transfer.getBuffer()
    if table is None:
        raise RuntimeError("usb1 hides its packet table: the fast path is not measured")
    slots = microframes(units)
    spent = 0.0
    for at in range(0, len(slots) - queue.packets, queue.packets):
        for i, packet in enumerate(slots[at : at + queue.packets]):
            table[i, 1:] = len(packet), 0
            buffer[i * PACKET_BYTES : i * PACKET_BYTES + len(packet)] = packet
        before = time.thread_time()
        reason = transfers._take(transfer, at)
        spent += time.thread_time() - before
        if reason:
            raise RuntimeError(reason)
    whole = [unit for unit in units if len(unit)]
    if collector.meter.received < len(whole) - 2 or collector.meter.tainted:
        raise RuntimeError("what was measured did not work")
    return {"core_percent": round(100 * spent / (len(slots) * MICROFRAME_S), 2)}


def decoding(units: list[bytes]) -> dict[str, float]:
    """Pictures a second of CPU time: PyAV alone, and PyAV fed by this driver from packets on."""

    def bare() -> int:
        decoder = av.CodecContext.create("h264", "r")
        decoder.thread_type = "NONE"
        return sum(len(decoder.decode(av.Packet(unit))) for unit in units)

    batches = [[(0, packet) for packet in packetise(unit, index & 1)] for index, unit in enumerate(units)]

    def driven() -> int:
        decoder = av.CodecContext.create("h264", "r")
        decoder.thread_type = "NONE"
        assembler, tracker = Assembler(opens=opens_stream), AccessUnitTracker()
        count = 0
        for at, batch in enumerate(batches):
            for unit in assembler.feed(at, batch):
                access_unit = tracker.feed(unit)
                if access_unit is not None:
                    count += len(decoder.decode(av.Packet(access_unit.data)))
        return count

    rates: dict[str, float] = {}
    for _ in range(REPEATS):  # in turn, so that a busy machine is equally busy for both
        for name, work in (("bare", bare), ("driver", driven)):
            before = time.thread_time()
            count = work()
            rates[name] = max(rates.get(name, 0.0), count / (time.thread_time() - before))
    return {
        "bare_hz": round(rates["bare"], 1), "driver_hz": round(rates["driver"], 1),
        "ratio": round(rates["driver"] / rates["bare"], 3),
    }  # fmt: skip


def latency(units: list[bytes], seconds: float) -> dict[str, float]:
    """From the last packet's microframe to the decoded picture in hand, over USB/IP in real time."""
    last_packet: dict[bytes, float] = {}
    camera = SimulatedThetaV()
    stop = threading.Event()

    def encode() -> None:
        index = 0
        due = time.monotonic()
        while not stop.wait(max(0.0, due - time.monotonic())):
            due += PERIOD_S
            if camera.demand is None:
                continue
            unit = units[index % len(units)]
            begin = time.monotonic()
            if camera.offer(unit, index % video.KEY_INTERVAL == 0):
                last_packet[unit[-64:]] = begin + -(-len(unit) // (PACKET_BYTES - 2)) * MICROFRAME_S
            index += 1

    async def run(port: int) -> tuple[list[float], list[float]]:
        decoder = av.CodecContext.create("h264", "r")
        decoder.thread_type = "NONE"
        loop = asyncio.get_running_loop()
        added: list[float] = []
        decode_s: list[float] = []

        def decode(unit: AccessUnit) -> tuple[float, float]:
            begin = time.monotonic()
            decoder.decode(av.Packet(unit.data))
            return begin, time.monotonic()

        async with ThetaV(lambda: UsbIpTransport("127.0.0.1", port), ThetaConfig(mode=Mode.TWO_K)) as theta:
            until = time.monotonic() + seconds
            async for unit in theta.access_units():
                begin, end = await loop.run_in_executor(None, decode, unit)
                total = time.monotonic() - last_packet[unit.raw[-64:]]
                added.append(total - (end - begin))
                decode_s.append(end - begin)
                if time.monotonic() > until:
                    break
        return added, decode_s

    thread = threading.Thread(target=encode, daemon=True)
    with UsbIpServer(camera) as server:
        thread.start()
        added, decode_s = asyncio.run(run(server.port))
        stop.set()
        thread.join()
    return {
        "pictures": len(added),
        "decode_p50_ms": round(float(np.percentile(decode_s, 50)) * 1e3, 2),
        "added_p50_ms": round(float(np.percentile(added, 50)) * 1e3, 2),
        "added_p99_ms": round(float(np.percentile(added, 99)) * 1e3, 2),
    }


LOSSES = ("lost_packets", "vanished_packets", "skipped_packets")
"""As the host controller reports them; as an empty microframe shows them; as nothing on the wire does."""


def losses(units: list[bytes], kind: str, loss: float, pictures: int, *, decode: bool) -> dict[str, int]:
    """How many of the pictures hurt are called clean wrongly: by the driver, and by driver and decoder together."""
    plan = replace(FaultPlan(seed=3), **{kind: loss})  # type: ignore[arg-type]
    rng = np.random.default_rng(plan.seed)
    assembler, tracker = Assembler(opens=opens_stream), AccessUnitTracker()
    decoder = av.CodecContext.create("h264", "r")
    decoder.thread_type = "NONE"
    index_of = {unit: index for index, unit in enumerate(units)}
    sound, doubtful = -1, True
    wrong = wrong_with_decoder = hurt = tainted = 0
    for at in range(pictures):
        batch = spoil(packetise(units[at % len(units)], at & 1), plan, rng)
        for done in assembler.feed(at, [NOTHING if packet is None else packet for packet in batch]):
            unit = tracker.feed(done)
            if unit is None:
                continue
            index = index_of.get(unit.raw, -1)
            whole = index >= 0 and (index % video.KEY_INTERVAL == 0 or index == sound + 1)
            sound = index if whole else -1
            flagged = False
            if decode:
                try:
                    frames = decoder.decode(av.Packet(unit.data))
                    flagged = not frames or any(frame.is_corrupt for frame in frames)
                except av.error.InvalidDataError:
                    flagged = True
            doubtful = flagged or unit.tainted or (doubtful and not unit.keyframe)
            hurt += not whole
            wrong += not whole and not unit.tainted
            wrong_with_decoder += not whole and not doubtful
            tainted += unit.tainted
    found = {"pictures": pictures, "hurt": hurt, "tainted": tainted, "wrong": wrong}
    return found | {"wrong_with_decoder": wrong_with_decoder} if decode else found


def missed(units: list[bytes], kind: str) -> dict[str, dict[str, int]]:
    decode = kind == LOSSES[-1]
    count = DECODED if decode else PICTURES
    return {f"{loss:.2%}": losses(units, kind, loss, count, decode=decode) for loss in (0.0001, 0.001, 0.01)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of the latency measurement")
    parser.add_argument("--out", type=Path, help="write the result there as well")
    arguments = parser.parse_args()
    two_k, four_k = stream("2k"), stream("4k")
    usb1.getVersion()  # loads the library
    result: dict[str, Any] = {
        "load_before": [round(x, 2) for x in os.getloadavg()],
        "assembly_4k_105mbit": {f"{n}_packets": assembly(four_k * 3, Queue(8, n)) for n in (32, 64)},
        "decoding": {"2k": decoding(two_k), "4k": decoding(four_k)},
        "latency_2k": latency(two_k, arguments.seconds),
        "losses_2k": {kind: missed(two_k, kind) for kind in LOSSES},
    }
    text = json.dumps(result)
    if arguments.out is not None:
        arguments.out.write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
