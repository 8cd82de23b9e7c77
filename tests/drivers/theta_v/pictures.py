"""Small H.264 streams as the camera would send them, and what the tests need to compare them."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from fractions import Fraction
from functools import cache

import av
import numpy as np

from drivers.theta_v.simulator.camera import SimulatedThetaV

KEY_INTERVAL = 10


@cache
def stream(
    count: int, width: int = 64, height: int = 32, seed: int = 0, key_interval: int = KEY_INTERVAL
) -> tuple[bytes, ...]:
    """`count` access units: baseline, Annex B, SPS and PPS in key pictures, one slice, no B-pictures."""
    context = av.CodecContext.create("libx264", "w")
    context.width, context.height, context.pix_fmt = width, height, "yuv420p"
    context.time_base, context.framerate = Fraction(1, 30), Fraction(30)
    context.options = {
        "profile": "baseline",
        "tune": "zerolatency",
        "x264-params": f"keyint={key_interval}:min-keyint={key_interval}:scenecut=0:repeat-headers=1:annexb=1"
        ":bframes=0:sliced-threads=0:threads=1:slices=1:log-level=error",
    }
    rng = np.random.default_rng(seed)
    units: list[bytes] = []
    for index in range(count):
        noise = rng.integers(0, 255, (height, width, 3), dtype=np.uint8)
        frame = av.VideoFrame.from_ndarray(noise, format="rgb24").reformat(format="yuv420p")
        frame.pts = index
        units += [bytes(packet) for packet in context.encode(frame)]
    units += [bytes(packet) for packet in context.encode(None)]
    assert len(units) == count
    return tuple(units)


class Feeder:
    """Offers the units round and round, in a thread, whenever the camera streams."""

    def __init__(
        self, camera: SimulatedThetaV, units: tuple[bytes, ...], rate_hz: float = 100.0, start: int = 0
    ) -> None:
        self._camera, self._units, self._start = camera, units, start
        self._period_s = 1 / rate_hz
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Feeder:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        index = self._start
        streamed = False
        while not self._stop.wait(self._period_s):
            demand = self._camera.demand is not None
            if demand and not streamed:
                index = self._start
            streamed = demand
            if demand:
                self._camera.offer(self._units[index % len(self._units)])
                index += 1


async def until(condition: Callable[[], bool], timeout_s: float = 30.0) -> None:
    """Wait for a condition on the event loop; fails the test when it does not come true."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "the condition did not come true in time"
        await asyncio.sleep(0.005)
