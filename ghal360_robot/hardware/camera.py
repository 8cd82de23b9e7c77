"""The camera's access units: into the logbook as received, and to the decoder."""

from __future__ import annotations

from contextlib import AsyncExitStack
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from drivers.theta_v.device.camera import ThetaV, TransportFactory
from drivers.theta_v.device.config import Mode, ThetaConfig
from drivers.theta_v.transport.libusb import LibUsbTransport
from drivers.theta_v.transport.usbip import UsbIpTransport
from ghal360_robot.hardware.link_stats import link_stats

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.theta_v.codec.access_units import AccessUnit
    from ghal360_robot.config import ThetaSection
    from ghal360_robot.logbook.recorder import Recorder
    from ghal360_robot.messages import LinkStats
    from ghal360_robot.perception.decode import PictureDecoder

MODES = {"2k": Mode.TWO_K, "4k": Mode.FOUR_K}


def transport_factory(config: ThetaSection) -> TransportFactory:
    """Where the configured camera is: on this machine's USB, or at a USB/IP server."""
    if config.transport == "usb":
        return LibUsbTransport
    return partial(UsbIpTransport, config.host, config.port)


class CameraInput:
    """A THETA V that runs until the robot ends, whatever happens to the device."""

    name = "theta"

    def __init__(
        self,
        config: ThetaSection,
        recorder: Recorder,
        decoder: PictureDecoder,
        audience: Callable[[AccessUnit], None] | None = None,
    ) -> None:
        self._decoder = decoder
        self._audience = audience
        self._recorder = recorder
        self._camera = ThetaV(
            transport_factory(config),
            ThetaConfig(mode=MODES[config.resolution], serial=config.serial or None),
            on_access_unit=self._record,
        )

    async def enter(self, stack: AsyncExitStack) -> None:
        await stack.enter_async_context(self._camera)

    async def run(self) -> None:
        async for unit in self._camera.access_units():
            self._decoder.submit(unit.data, unit.stamp_ns, tainted=unit.tainted)

    def stats(self) -> LinkStats:
        """With what the camera says of its battery, and, while pictures come, what it complains about: heat first."""
        stats = self._camera.stats
        link = link_stats(stats.link.value, stats)
        if stats.battery_percent is None or link.link != "streaming":
            return link
        condition = f"battery {stats.battery_percent} %, {stats.charging}"
        return replace(link, detail=link.detail or "; ".join(stats.faults), condition=condition)

    def _record(self, unit: AccessUnit) -> None:
        self._recorder.access_unit(unit.stamp_ns, unit.raw, unit.sequence, unit.keyframe, unit.tainted)
        if self._audience is not None:
            self._audience(unit)
