from __future__ import annotations

import numpy as np
import pytest

from calibration.mounting import LidarMount
from ghal360_robot.messages import (
    BaseMode,
    BaseState,
    Freshness,
    HeadPose,
    Inputs,
    LidarScan,
    OperatorInput,
    Pose2,
    Surroundings,
    Twist,
)
from ghal360_robot.surroundings import look_around

TICK_NS = 20_000_000
YAW = np.radians(np.linspace(-135, 135, 811)).astype(np.float32)


def scan(ranges: np.ndarray | float = 5.0) -> LidarScan:
    values = np.broadcast_to(np.asarray(ranges, np.float32), YAW.shape).copy()
    return LidarScan(0, values, YAW, 0, 0, 0)


def around(seen: LidarScan) -> Surroundings:
    return look_around(seen, LidarMount())


def inputs(tick: int, **changes: object) -> Inputs:
    """A healthy tick: all inputs fresh, base in drive mode, dead man held, open space of five metres."""
    stamp = tick * TICK_NS
    fresh = Freshness(alive=True, rate_ok=True, valid=True, age_s=0.01)
    values: dict[str, object] = {
        "base": BaseState(stamp, BaseMode.DRIVE, Pose2(), Twist(), 90.0),
        "scan": scan(),
        "detections": None,
        "operator": OperatorInput(stamp, HeadPose(), deadman=True, arm_presses=0 if tick == 0 else 1),
        "freshness": dict.fromkeys(("operator", "tim571", "rmp110", "theta"), fresh),
    }
    values.update(changes)
    if isinstance(values["scan"], LidarScan):
        values.setdefault("surroundings", around(values["scan"]))
    return Inputs(stamp, tick, **values)  # type: ignore[arg-type]


@pytest.fixture
def healthy() -> object:
    return inputs
