"""The simulated camera's encoder: prepared pictures, one every 33 ms, while the host wants any."""

from __future__ import annotations

import threading
import time
import zlib

from drivers.theta_v.simulator.camera import SimulatedThetaV
from tests.usb_kernel.video import KEY_INTERVAL

RATE_HZ = 30000 / 1001
PERIOD_S = 1 / RATE_HZ


class Encoder:
    """`units` holds the access units of each size, by width."""

    def __init__(self, camera: SimulatedThetaV, units: dict[int, list[bytes]]) -> None:
        self.sent: list[int] = []
        """Checksums of the pictures that went out, in order."""
        self.late = 0
        """Times the encoder itself fell behind by more than a picture: the guest is too slow."""
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
                width, index = demand.width, -(-index // KEY_INTERVAL) * KEY_INTERVAL
            at = index % len(self._units[width])
            # Noted first: on the other side of the wire it may be there before `offer` returns.
            self.sent.append(self._sums[width][at])
            if not self._camera.offer(self._units[width][at], at % KEY_INTERVAL == 0):
                self.sent.pop()
            index += 1
