"""The board where every input leaves its newest value, and from which each tick takes one snapshot."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ghal360_robot.freshness import RateWatch
from ghal360_robot.messages import Inputs

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ghal360_robot.messages import BaseState, Detections, LidarScan, LinkStats, OperatorInput

DEVICES = ("theta", "tim571", "rmp110")
INPUTS = (*DEVICES, "operator")


@dataclass(slots=True)
class Board:
    """Newest values by input. Written from driver tasks and threads, read by the control tick.

    `watches` judges arrivals: the camera's are access units, not detections, because the operator drives
    by the picture whether or not something was detected in it.
    """

    watches: Mapping[str, RateWatch]
    base: BaseState | None = None
    scan: LidarScan | None = None
    detections: Detections | None = None
    operator: OperatorInput | None = None
    links: dict[str, LinkStats] = field(default_factory=dict)
    valid: dict[str, bool] = field(default_factory=lambda: dict.fromkeys(INPUTS, True))
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def put_base(self, state: BaseState) -> None:
        self.base = state
        self._arrived("rmp110", state.stamp_ns)

    def put_scan(self, scan: LidarScan, arrival_ns: int) -> None:
        """A scan's stamp is its last beam's; it is its arrival that says whether the device is alive."""
        self.scan = scan
        self.valid["tim571"] = scan.device_ok
        self._arrived("tim571", arrival_ns)

    def put_picture(self, stamp_ns: int) -> None:
        self._arrived("theta", stamp_ns)

    def put_detections(self, detections: Detections) -> None:
        self.detections = detections

    def put_operator(self, message: OperatorInput) -> None:
        self.operator = message
        self._arrived("operator", message.stamp_ns)

    def snapshot(self, now_ns: int, tick: int, *, armed: bool) -> Inputs:
        """What the tick at `now_ns` sees."""
        with self._lock:
            freshness = {name: self.watches[name].at(now_ns, valid=self.valid[name]) for name in INPUTS}
        return Inputs(now_ns, tick, self.base, self.scan, self.detections, self.operator, freshness, armed)

    def _arrived(self, name: str, stamp_ns: int) -> None:
        with self._lock:
            self.watches[name].note(stamp_ns)


def make_board(camera_hz: float, operator_hz: float) -> Board:
    """A board with the rates this robot's inputs should have: 15 Hz lidar, base at half the tick rate."""
    return Board(
        {
            "theta": RateWatch(camera_hz, 0.7),
            "tim571": RateWatch(15.0, 0.25),
            "rmp110": RateWatch(20.0, 0.3),
            "operator": RateWatch(operator_hz, 0.2),
        }
    )
