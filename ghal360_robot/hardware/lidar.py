"""The lidar's scans onto the board, its telegrams into the logbook as received."""

from __future__ import annotations

import logging
from contextlib import AsyncExitStack
from typing import TYPE_CHECKING

from drivers.tim571.codec.commands import OutputContent
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.device.config import TimConfig
from drivers.tim571.device.lidar import TiM571
from drivers.tim571.device.scan import DeviceStatus
from drivers.tim571.transport.tcp import TcpTransport
from drivers.tim571.transport.usb import UsbTransport
from ghal360_robot.hardware.link_stats import link_stats
from ghal360_robot.messages import LidarScan

if TYPE_CHECKING:
    from drivers.tim571.device.scan import Scan
    from drivers.tim571.transport import Transport
    from ghal360_robot.board import Board
    from ghal360_robot.config import Tim571Section
    from ghal360_robot.logbook.recorder import Recorder
    from ghal360_robot.messages import LinkStats

logger = logging.getLogger(__name__)

DIALECTS = {"auto": None, "a": Dialect.A, "b": Dialect.B}
SWITCHES = {"leave": None, "a": Dialect.A, "b": Dialect.B}
CONTENTS = {
    "leave": None,
    "off": OutputContent(rssi=False, rssi_bits=8),
    "8": OutputContent(rssi=True, rssi_bits=8),
    "16": OutputContent(rssi=True, rssi_bits=16),
}
"""What the telegrams shall contain, by the setting's name."""
TRY_FIRST = {"tcp": (Dialect.B, Dialect.A), "usb": (Dialect.A, Dialect.B)}
"""On USB a wrong first try costs more: a device there speaks what it was delivered with."""


class LidarInput:
    """A TiM571 that runs until the robot ends, whatever happens to the device."""

    name = "tim571"

    def __init__(self, config: Tim571Section, board: Board, recorder: Recorder) -> None:
        self._board = board
        self._recorder = recorder
        self._lidar = TiM571(
            lambda: transport(config),
            driver_config(config),
            recorder.lidar_telegram,
        )
        self._said = ""

    async def enter(self, stack: AsyncExitStack) -> None:
        await stack.enter_async_context(self._lidar)

    async def run(self) -> None:
        async for scan in self._lidar.scans():
            message = lidar_scan(scan)
            self._board.put_scan(message, scan.arrival_ns)
            self._recorder.lidar_scan(message)
            self._say()

    def _say(self) -> None:
        """What the person at the robot should know although scans come: once, not fifteen times a second."""
        stats = self._lidar.stats
        sentence = stats.warning or ("" if stats.status is DeviceStatus.OK else f"lidar: {stats.status}")
        if sentence and sentence != self._said:
            logger.warning("%s", sentence)
        self._said = sentence

    def stats(self) -> LinkStats:
        stats = self._lidar.stats
        return link_stats(stats.state.value, stats)


def transport(config: Tim571Section) -> Transport:
    """The way to the lidar that the configuration names; a fresh one for every connection."""
    return UsbTransport(config.serial or None) if config.transport == "usb" else TcpTransport(config.host, config.port)


def driver_config(config: Tim571Section) -> TimConfig:
    """What the driver may do with the lidar; as the configuration stands, it changes nothing in it."""
    return TimConfig(
        dialect=DIALECTS[config.dialect],
        dialects=TRY_FIRST[config.transport],
        output=CONTENTS[config.rssi],
        switch_to=SWITCHES[config.switch_to],
        insist=config.insist,
    )


def lidar_scan(scan: Scan) -> LidarScan:
    """The driver's scan as the robot's message."""
    return LidarScan(
        stamp_ns=scan.stamp_ns,
        ranges=scan.ranges,
        yaw=scan.yaw,
        scan_counter=scan.scan_counter,
        telegram_counter=scan.telegram_counter,
        device_time_us=scan.device_time_us,
        device_ok=scan.device_ok,
        rssi=scan.rssi,
    )
