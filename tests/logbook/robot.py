"""A made-up robot for these tests: messages with awkward numbers, and a run of ticks."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.messages import (
    STILL,
    Applied,
    ArmState,
    BaseMode,
    BaseState,
    Command,
    Cue,
    Decision,
    Detection,
    Detections,
    Freshness,
    HeadPose,
    Inputs,
    Lease,
    LidarScan,
    Lock,
    OperatorInput,
    Pose2,
    Stops,
    Twist,
)

if TYPE_CHECKING:
    from collections.abc import Callable

TICK_NS = 20_000_000
YAW = np.linspace(-2.35, 2.35, 811, dtype=np.float32)


def wait_for(condition: Callable[[], bool], timeout_s: float = 10.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "the condition did not come true in time"
        time.sleep(0.01)


def base_state(stamp_ns: int, k: int) -> BaseState:
    faults = ("the left wheel does not answer",) if k % 7 == 3 else ()
    mode = BaseMode.DRIVE if k % 5 else BaseMode.STANDBY
    pose = Pose2(0.1 * k, math.sin(k), -math.pi / 3 * k)
    twist, battery, temperature = Twist(0.1 + k / 3, -0.1), 87.3 - k / 10, 31 + k / 3 if k % 4 else None
    warnings = ("the left wheel slips", "slow") if k % 11 > 7 else ()
    covariance = (k // 9 / 3, 0.0, -1e-300, 1 / 3, 0.0, 0.1)
    return BaseState(stamp_ns, mode, pose, twist, battery, faults, temperature, covariance, warnings)


def scan(stamp_ns: int, k: int, *, rssi: bool = True) -> LidarScan:
    rng = np.random.default_rng(k)
    millimetres = rng.integers(50, 10_000, 811)
    ranges = (millimetres / 1000).astype(np.float32)
    ranges[::50] = np.nan
    echoes = rng.integers(0, 255, 811).astype(np.float32) if rssi else None
    return LidarScan(stamp_ns, ranges, YAW, k, 2 * k, (1 << 40) + k, k % 3 != 0, echoes)


def detections(stamp_ns: int, k: int) -> Detections:
    objects = tuple(Detection(f"thing {n}", 1 / (n + 3), 3.1 - n, 0.1 * n, 0.2, 1 / 3) for n in range(k % 4))
    return Detections(stamp_ns, k, "painted", objects)


def operator(stamp_ns: int, k: int) -> OperatorInput:
    stick = Twist(0.1 * k, -1 / 3) if k % 2 else None
    head, holder = HeadPose(math.sin(k), 0.1, 1.5), ("", "page 1", "Zoë")[k // 5 % 3]
    return OperatorInput(stamp_ns, head, k % 3 == 0, stick, k, 2 * k, 0, 1, holder, k // 8 / 7)


def inputs(stamp_ns: int, tick: int) -> Inputs:
    return Inputs(
        stamp_ns,
        tick,
        base_state(stamp_ns - 1, tick),
        scan(stamp_ns - 2, 1) if tick > 2 else None,
        detections(stamp_ns - 3, 2) if tick > 4 else None,
        None,
        {
            "theta": Freshness(alive=True, rate_ok=False, valid=True, age_s=1 / (tick + 3)),
            "operator": Freshness(alive=False, rate_ok=False, valid=False, age_s=math.inf),
        },
        commands=(Command("test", stamp_ns - 4, Twist(1 / 3, -0.1)), Command("dock", 5, STILL))[: tick // 6 % 3],
        locks=(Lock("pause", stamp_ns, tick % 2 == 0), Lock("door", 7, engaged=True))[: tick // 4 % 3],
        lease=None if tick // 8 % 2 else Lease("page 1", tick // 50),
        stops=Stops(tick // 30, tick // 100),
    )


def decision(tick: int) -> Decision:
    """Parts of it change at different ticks, so that rows left out as unchanged really matter."""
    return Decision(
        cue=list(Cue)[tick // 7 % 4],
        target_yaw=None if tick // 3 % 2 else 1 / 3 + tick // 6,
        wedges=(0, 1, 2, 3, 0, 0, tick // 11 % 4, 0),
        q=None if tick // 5 % 2 else (0.1 + tick // 10, -1 / 3, 1e-300),
        belief=tuple(1 / (8 + tick // 13 + n) for n in range(8)),
        intention=None if tick // 17 % 2 else tick // 17 % 8,
        wanted=Twist(0.0, 0.0) if tick % 40 < 20 else Twist(0.01 * tick, -1 / (tick + 3)),
        reasons=("the operator looks at wedge 3",) * (tick // 9 % 3),
        target_chances=() if tick // 19 % 2 else tuple(1 / (9 + tick // 12 + n) for n in range(9)),
    )


def applied(tick: int) -> Applied:
    arm = list(ArmState)[tick // 25 % 3]
    reasons = ("a person is 0.9 m ahead", "curve") if tick // 15 % 2 else ()
    clearance, source = None if tick // 10 % 2 else 1 / (tick + 1), ("", "teleop", "autonomy")[tick // 12 % 3]
    return Applied(Twist(0.001 * (tick // 4), 0.0), arm, reasons, clearance, source)
