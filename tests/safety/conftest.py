from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibration.mounting import LidarMount
from ghal360_robot.messages import (
    STILL,
    Applied,
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
from ghal360_robot.safety.chain import Safety, SafetyState
from ghal360_robot.simulation.plant import advance
from ghal360_robot.surroundings import look_around

TICK_NS = 20_000_000
TICK_S = TICK_NS / 1e9
YAW = np.radians(np.linspace(-135, 135, 811)).astype(np.float32)
FRESH = Freshness(alive=True, rate_ok=True, valid=True, age_s=0.01)
LIDAR_X = 0.2

Ranges = np.ndarray | float


def scan(ranges: Ranges = 5.0, stamp_ns: int = 0) -> LidarScan:
    values = np.broadcast_to(np.asarray(ranges, np.float32), YAW.shape).copy()
    return LidarScan(stamp_ns, values, YAW, 0, 0, 0)


def around(seen: LidarScan) -> Surroundings:
    return look_around(seen, LidarMount())


def inputs(tick: int, **changes: object) -> Inputs:
    """A healthy tick: all inputs fresh, base in drive mode, dead man held, open space of five metres."""
    stamp = tick * TICK_NS
    values: dict[str, object] = {
        "base": BaseState(stamp, BaseMode.DRIVE, Pose2(), Twist(), 90.0),
        "scan": scan(stamp_ns=stamp),
        "detections": None,
        "operator": OperatorInput(stamp, HeadPose(), deadman=True, arm_presses=0 if tick == 0 else 1),
        "freshness": dict.fromkeys(("operator", "tim571", "rmp110", "theta"), FRESH),
    }
    values.update(changes)
    if isinstance(values["scan"], LidarScan):
        values.setdefault("surroundings", around(values["scan"]))
    return Inputs(stamp, tick, **values)  # type: ignore[arg-type]


def circles_ranges(pose: Pose2, circles: np.ndarray, far: float = 6.0) -> np.ndarray:
    """What a lidar on the robot at `pose` measures of circles (n, 3): x, y, radius, world frame; a wall at `far`."""
    x, y = pose.x + LIDAR_X * np.cos(pose.yaw), pose.y + LIDAR_X * np.sin(pose.yaw)
    yaw = pose.yaw + YAW.astype(np.float64)
    dx, dy = circles[:, 0] - x, circles[:, 1] - y
    along = np.cos(yaw)[:, None] * dx + np.sin(yaw)[:, None] * dy
    aside = np.cos(yaw)[:, None] * dy - np.sin(yaw)[:, None] * dx
    half = np.sqrt(np.maximum(circles[:, 2] ** 2 - aside**2, 0.0))
    hit = (half > 0) & (along > 0)
    return np.minimum(np.where(hit, along - half, far).min(axis=1, initial=far), far)


class Rig:
    """The chain around a base that does what it is told, tick by tick; armed from the second tick on.

    `seen` gives the ranges from a pose; a new scan every `scan_every` ticks. `tick` takes what is wanted and
    any change of the inputs.
    """

    def __init__(
        self, safety: Safety | None = None, seen: Callable[[Pose2], Ranges] | Ranges = 5.0, scan_every: int = 3
    ) -> None:
        self.safety = safety or Safety()
        self.state = SafetyState()
        self.seen, self.scan_every = seen, scan_every
        self.n = 0
        self.pose, self.twist = Pose2(), STILL
        self.presses = 0
        self.applied: Applied | None = None
        self._scan = scan()

    def inputs(self, **changes: object) -> Inputs:
        stamp = self.n * TICK_NS
        if self.n % self.scan_every == 0:
            ranges = self.seen(self.pose) if callable(self.seen) else self.seen
            self._scan = scan(ranges, stamp)
        self.presses = max(self.presses, min(self.n, 1))
        healthy: dict[str, object] = {
            "base": BaseState(stamp, BaseMode.DRIVE, self.pose, self.twist, 90.0),
            "scan": self._scan,
            "operator": OperatorInput(stamp, HeadPose(), deadman=True, arm_presses=self.presses),
        }
        return inputs(self.n, **{**healthy, **changes})

    def tick(self, wanted: Twist = STILL, **changes: object) -> Applied:
        return self.give(self.inputs(**changes), wanted)

    def give(self, tick: Inputs, wanted: Twist = STILL) -> Applied:
        self.state, self.applied = self.safety.step(self.state, tick, wanted)
        self.twist = self.applied.twist
        self.pose = advance(self.pose, self.twist, TICK_S)
        self.n += 1
        return self.applied

    def run(self, ticks: int, wanted: Twist = STILL, **changes: object) -> list[Applied]:
        return [self.tick(wanted, **changes) for _ in range(ticks)]

    def stick(self, twist: Twist, **changes: object) -> Applied:
        """One tick with the operator's hand on the stick."""
        tick = self.inputs(**changes)
        assert tick.operator is not None
        return self.give(replace(tick, operator=replace(tick.operator, stick=twist)))


@pytest.fixture
def healthy() -> object:
    return inputs
