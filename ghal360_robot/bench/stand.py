"""The test stand: three simulated devices on loopback, in a hall that travels along and never ends."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING, Self

import numpy as np

from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.usbip_server import UsbIpServer
from drivers.tim571.geometry import BEAMS
from drivers.tim571.simulator.behaviour import DeviceSettings
from drivers.tim571.simulator.server import Tim571Simulator
from ghal360_robot.bench.base import TracedBase
from ghal360_robot.bench.cable import Cable
from ghal360_robot.simulation.encoder import ThetaEncoder
from ghal360_robot.simulation.link import Endpoints

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

    from numpy.typing import NDArray

WALL_M = 8.0
"""Out of the stop zone's reach, and well within what a TiM571 sees."""
CAMERA_HZ = 29.97
PICTURE = (64, 32)
"""Width and height: what a picture shows does not matter here, and two cores have other things to do."""


class Stand:
    """`base`, a lidar and a camera; `endpoints` says where they listen once the context is entered."""

    def __init__(self, film: Sequence[bytes] = ()) -> None:
        """`film` is a second of access units, shown again and again; without, tiny pictures."""
        self._units = film
        self.base = TracedBase()
        self.endpoints: Endpoints
        self._lidar = Tim571Simulator(_hall, dialect="b", settings=DeviceSettings(startup_s=0.0))
        self._lidar_cable: Cable
        self._camera = SimulatedThetaV()
        self._stack = AsyncExitStack()

    def silence_lidar(self) -> None:
        """From now on the lidar's connection stays open and carries nothing."""
        self._lidar_cable.cut()

    async def __aenter__(self) -> Self:
        async with AsyncExitStack() as stack:
            await stack.enter_async_context(self.base)
            await stack.enter_async_context(self._lidar)
            self._lidar_cable = await stack.enter_async_context(Cable(self._lidar.port))
            usbip = stack.enter_context(UsbIpServer(self._camera))
            filming = asyncio.create_task(self._film(self._units or _pictures()), name="pictures")
            stack.callback(filming.cancel)
            self.endpoints = Endpoints(usbip.port, self._lidar_cable.port, self.base.port)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.aclose()

    async def _film(self, units: Sequence[bytes]) -> None:
        index = 0
        while True:
            if self._camera.wants_keyframe:
                index = 0  # the only key picture
            self._camera.offer(units[index])
            index = (index + 1) % len(units)
            await asyncio.sleep(1.0 / CAMERA_HZ)


def _hall(_stamp_ns: int) -> tuple[NDArray[np.float64], None]:
    return np.full(BEAMS, WALL_M), None


def _pictures() -> list[bytes]:
    """One second of film that may be shown again and again."""
    width, height = PICTURE
    grey = np.linspace(0, 255, width, dtype=np.uint8)
    with ThetaEncoder(width, height, CAMERA_HZ) as encoder:
        return [
            encoder.encode(np.ascontiguousarray(np.broadcast_to(np.roll(grey, k)[None, :, None], (height, width, 3))))
            for k in range(round(CAMERA_HZ))
        ]
