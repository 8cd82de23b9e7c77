"""The lidar's scans onto the board, its telegrams into the logbook as received."""

from __future__ import annotations

from contextlib import AsyncExitStack
from typing import TYPE_CHECKING

from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.device.config import TimConfig
from drivers.tim571.device.lidar import TiM571
from drivers.tim571.transport.tcp import TcpTransport
from ghal360_robot.hardware.link_stats import link_stats
from ghal360_robot.messages import LidarScan

if TYPE_CHECKING:
    from drivers.tim571.device.scan import Scan
    from ghal360_robot.board import Board
    from ghal360_robot.config import Tim571Section
    from ghal360_robot.logbook.recorder import Recorder
    from ghal360_robot.messages import LinkStats

DIALECTS = {"auto": None, "a": Dialect.A, "b": Dialect.B}


class LidarInput:
    """A TiM571 that runs until the robot ends, whatever happens to the device."""

    name = "tim571"

    def __init__(self, config: Tim571Section, board: Board, recorder: Recorder) -> None:
        self._board = board
        self._recorder = recorder
        self._lidar = TiM571(
            lambda: TcpTransport(config.host, config.port),
            TimConfig(dialect=DIALECTS[config.dialect]),
            recorder.lidar_telegram,
        )

    async def enter(self, stack: AsyncExitStack) -> None:
        await stack.enter_async_context(self._lidar)

    async def run(self) -> None:
        async for scan in self._lidar.scans():
            message = lidar_scan(scan)
            self._board.put_scan(message, scan.arrival_ns)
            self._recorder.lidar_scan(message)

    def stats(self) -> LinkStats:
        stats = self._lidar.stats
        return link_stats(stats.state.value, stats)


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
