"""The board where every input leaves its newest value, and from which each tick takes one snapshot."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ghal360_robot.freshness import RateWatch
from ghal360_robot.messages import Inputs

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ghal360_robot.config import RobotConfig
    from ghal360_robot.messages import BaseState, Detections, LidarScan, OperatorInput

INPUTS = ("theta", "tim571", "rmp110", "operator")
LIDAR_HZ = 15.0
BASE_HZ = 20.0
"""Slower polling than this would not do; motion frames and polls bring 50."""

MAX_NUMBER = 1e6
MAX_PRESSES = 1_000_000_000


@dataclass(slots=True)
class Board:
    """Newest values by input. Written from driver tasks and threads, read by the control tick.

    `watches` judges arrivals: the camera's are pictures that were decoded whole, because that is what an
    operator drives by, whether or not something was detected in them.
    """

    watches: Mapping[str, RateWatch]
    base: BaseState | None = None
    scan: LidarScan | None = None
    detections: Detections | None = None
    operator: OperatorInput | None = None
    refused: int = 0
    """Messages of the operator that made no sense."""
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
        """A picture was decoded and nothing of it is missing; called from the decoder's thread."""
        self._arrived("theta", stamp_ns)

    def put_detections(self, detections: Detections) -> None:
        self.detections = detections

    def put_operator(self, message: OperatorInput) -> None:
        """Take a message in, unless it makes no sense: it comes from outside and steers the robot."""
        if not is_sane(message):
            self.refused += 1
            return
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


def is_sane(message: OperatorInput) -> bool:
    """Whether every number is finite and every count a whole number that a finger can reach."""
    head, stick = message.head, message.stick
    angles = (head.yaw, head.pitch, head.fov, *((stick.v, stick.w) if stick is not None else ()))
    counts = (message.arm_presses, message.disarm_presses, message.estop_presses, message.found_presses)
    return all(isinstance(x, float | int) and math.isfinite(x) and abs(x) < MAX_NUMBER for x in angles) and all(
        isinstance(n, int) and 0 <= n < MAX_PRESSES for n in counts
    )


def make_board(config: RobotConfig, operator_hz: float) -> Board:
    """A board that knows how often each input comes, and from what age on it holds the robot still."""
    safety = config.safety
    return Board(
        {
            "theta": RateWatch(config.theta.rate_hz, safety.video_hold_s),
            "tim571": RateWatch(LIDAR_HZ, safety.lidar_hold_s),
            "rmp110": RateWatch(BASE_HZ, safety.base_hold_s),
            "operator": RateWatch(operator_hz, safety.operator_hold_s),
        }
    )
