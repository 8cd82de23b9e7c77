"""What the inner half of a control tick costs on one core: feedback in, safety chain, motion frame out.

`decode` is eleven CAN frames to a BaseState; `chain` is that, and a new scan where there is one, to the
board, a snapshot with every input's freshness, and the safety chain; `encode` is a twist to a motion frame
that passed the whitelist.

The base is the simulated one, the scans are of the simulated office, the code is the robot's own. Costs
are this thread's CPU time, so that other programs do not count; every tick is followed by an empty turn
of the event loop, so that the ratio of the two can be compared between machines.
"""

from __future__ import annotations

import asyncio
import gc
import math
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.rmp110.codec.commands import motion, request_mode
from drivers.rmp110.codec.feedback import COMPACT_BITMAPS, Dialect
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, Stored
from drivers.rmp110.codec.whitelist import forbidden
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.identify import conclude
from drivers.rmp110.device.odometry import Odometry
from drivers.rmp110.device.slip import SlipWatch
from drivers.rmp110.device.state import all_finite, read_state
from drivers.rmp110.simulator.model import RmpModel
from drivers.tim571.geometry import BEAM_YAW
from drivers.tim571.simulator.scanner import NOISE_SIGMA_M, sample
from ghal360_robot.assembly import make_safety
from ghal360_robot.board import LIDAR_HZ, make_board
from ghal360_robot.config import RobotConfig
from ghal360_robot.errors import GhalError
from ghal360_robot.hardware.base import base_state
from ghal360_robot.messages import ArmState, BaseState, HeadPose, LidarScan, OperatorInput, Pose2, Twist
from ghal360_robot.robot import SWITCH_INTERVAL_S
from ghal360_robot.safety.chain import SafetyState
from ghal360_robot.simulation.view import lidar_view
from ghal360_robot.simulation.world import build_world

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.rmp110.codec.frames import Frame
    from drivers.rmp110.device.language import Language, Report
    from drivers.rmp110.device.state import State

LIMIT_MS = 0.5
"""p99 of encode, decode and chain together: a fortieth of the control period."""
TICKS = 20_000
TICK_NS = 20_000_000
TICKS_PER_S = 50
SCANS = 150
"""Ten seconds of scans while the robot turns once around itself; then they come again."""
WANTED = Twist(0.4, 0.3)
"""A bend: the stop zone is looked for along an arc, which costs more than a straight line."""
OPERATOR_EVERY = 2
"""Ticks from one message of the operator to the next: 25 a second."""
WARM_UP = 500
"""Ticks not counted: arming, the base's way into tractor, and Python's own warming up."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Percentiles of one duration, microseconds."""

    p50_us: float
    p99_us: float
    max_us: float

    @classmethod
    def of(cls, durations_ns: np.ndarray) -> Spread:
        p50, p99, longest = (float(x) / 1e3 for x in np.percentile(durations_ns, (50, 99, 100)))
        return cls(p50, p99, longest)

    def to_json(self) -> dict[str, float]:
        return {"p50_us": round(self.p50_us, 1), "p99_us": round(self.p99_us, 1), "max_us": round(self.max_us, 1)}


@dataclass(frozen=True, slots=True)
class TickCost:
    """Cost of the whole and of its parts; `floor` is an empty turn of the event loop in the same run."""

    ticks: int
    decode: Spread
    chain: Spread
    encode: Spread
    total: Spread
    floor: Spread

    @property
    def passed(self) -> bool:
        return self.total.p99_us <= LIMIT_MS * 1e3

    @property
    def ratio(self) -> float:
        """Whole to floor, medians."""
        return self.total.p50_us / self.floor.p50_us

    def to_json(self) -> dict[str, Any]:
        return {
            "ticks": self.ticks,
            "passed": self.passed,
            "limit_p99_us": LIMIT_MS * 1e3,
            "total": self.total.to_json(),
            "decode": self.decode.to_json(),
            "chain": self.chain.to_json(),
            "encode": self.encode.to_json(),
            "floor": self.floor.to_json(),
            "ratio_to_floor": round(self.ratio, 1),
        }


class Decoder:
    """Feedback frames to the robot's message, as the driver's stream and the robot's shell do it."""

    def __init__(self, config: Rmp110Config, stored: Stored) -> None:
        self.identity = conclude(Dialect.B2, stored, config)
        self._track_m = config.track_m
        self._listener = self.identity.language.listener()
        self._slip = SlipWatch.of(stored)
        self._odometry = Odometry()

    def decode(self, now_ns: int, frames: tuple[Frame, ...]) -> BaseState:
        """One whole packet. Raises GhalError where it is none."""
        for frame in frames:
            report = self._listener.feed(now_ns, frame)
            if report is not None and all_finite(report.values):
                return base_state(self._state(report))
        raise GhalError("the simulated base answered with something that is no packet")

    def _state(self, report: Report) -> State:
        values = report.values
        self._odometry = self._odometry.advance(
            values["right_front_pos_m"],
            values["left_front_pos_m"],
            values["operational_time"],
            self._track_m,
            stamp_ns=report.first_ns,
            speeds_mps=(values["right_front_vel_mps"], values["left_front_vel_mps"]),
        )
        self._slip = self._slip.step(values)
        return read_state(report.first_ns, values, self._odometry, self.identity, self._track_m, self._slip)


def encode(twist: Twist, language: Language) -> Frame:
    """A twist as the motion frame that may go onto the wire. Raises GhalError where it may not."""
    frame, _ = language.motion(twist.v, twist.w)
    reason = forbidden(frame)
    if reason is not None:
        raise GhalError(f"the safety chain let something through that must not be sent: {reason}")
    return frame


class Ticker:
    """The inner half of the robot with a simulated base and prepared scans, one `tick` at a time."""

    def __init__(self) -> None:
        config = RobotConfig()
        stored = Stored.of(
            {**RMP110_STORED, **{f"feedback_bitmap_{n}": word for n, word in enumerate(COMPACT_BITMAPS, start=1)}}
        )
        self.now_ns = 1_000_000_000
        self._count = 0
        self._model = RmpModel(self.now_ns, stored, boot_s=0.0)
        self._decoder = Decoder(Rmp110Config(max_v_mps=config.safety.v_max, max_w_rps=config.safety.w_max), stored)
        self._board = make_board(config, TICKS_PER_S / OPERATOR_EVERY)
        self._safety = make_safety(config)
        self._state = SafetyState()
        self._scans = _scans()
        self._next = motion(0.0, 0.0)
        self._presses = 0
        self._model.receive(self.now_ns + TICK_NS, request_mode(ModeRequest.TRACTOR))

    def tick(self) -> tuple[tuple[int, int, int], bool]:
        """Nanoseconds of decode, chain and encode; and whether motion was let through."""
        self.now_ns += TICK_NS
        frames, scan = self._surroundings()
        began = time.thread_time_ns()
        state = self._decoder.decode(self.now_ns, frames)
        decoded = time.thread_time_ns()
        self._board.put_base(state)
        if scan is not None:
            self._board.put_scan(scan, self.now_ns)
        armed = self._state.arming.state is ArmState.ARMED
        inputs = self._board.snapshot(self.now_ns, self._count, armed=armed)
        self._state, applied = self._safety.step(self._state, inputs, WANTED)
        judged = time.thread_time_ns()
        self._next = encode(applied.twist, self._decoder.identity.language)
        encoded = time.thread_time_ns()
        self._count += 1
        moved = applied.arm is ArmState.ARMED and applied.twist != Twist()
        return (decoded - began, judged - decoded, encoded - judged), moved

    def _surroundings(self) -> tuple[tuple[Frame, ...], LidarScan | None]:
        """What happens between two ticks: the base answers, and there may be a new scan, picture or message."""
        frames = self._model.receive(self.now_ns, self._next)
        before, now = (int(tick * LIDAR_HZ / TICKS_PER_S) for tick in (self._count - 1, self._count))
        scan = None if now == before else _stamped(self._scans[now % SCANS], self.now_ns, now)
        self._board.put_picture(self.now_ns)
        if self._count % OPERATOR_EVERY == 0:
            armed = self._state.arming.state is ArmState.ARMED
            self._presses += 0 if armed else 1
            self._board.put_operator(
                OperatorInput(self.now_ns, HeadPose(), deadman=True, stick=WANTED, arm_presses=self._presses)
            )
        return frames, scan


def _scans() -> list[LidarScan]:
    """One turn on the spot where the robot starts in the simulated office, with a TiM571's noise."""
    world = build_world("office", 0)
    scans = []
    for k in range(SCANS):
        here = Pose2(world.start.x, world.start.y, world.start.yaw + k * math.tau / SCANS)
        distances, _ = lidar_view(world, lambda here=here: here)(0)  # type: ignore[misc]
        millimetres, _ = sample(distances, None, np.random.default_rng(k), NOISE_SIGMA_M)
        ranges = np.where(millimetres < 16, np.nan, millimetres * np.float32(1e-3)).astype(np.float32)
        scans.append(LidarScan(0, ranges, np.asarray(BEAM_YAW, np.float32), k, k, 0))
    return scans


def _stamped(scan: LidarScan, now_ns: int, number: int) -> LidarScan:
    return LidarScan(now_ns, scan.ranges, scan.yaw, number, number, now_ns // 1000)


@contextmanager
def _as_in_the_robot() -> Iterator[None]:
    """Garbage collection and thread switching as `Robot` sets them, and back."""
    interval_s = sys.getswitchinterval()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(interval_s)
        gc.unfreeze()


def measure(ticks: int = TICKS) -> TickCost:
    """Cost of so many ticks, after a warm-up. Raises GhalError where the robot did not move in all of them."""
    cost, standing = asyncio.run(_measure(ticks))
    if standing:
        raise GhalError(f"the simulated robot stood still in {standing} of {ticks} ticks: driving was not measured")
    return cost


async def _measure(ticks: int) -> tuple[TickCost, int]:
    ticker = Ticker()
    parts = np.zeros((ticks, 3), np.int64)
    floor = np.zeros(ticks, np.int64)
    standing = 0
    with _as_in_the_robot():
        for _ in range(WARM_UP):
            ticker.tick()
        for k in range(ticks):
            parts[k], moved = ticker.tick()
            standing += not moved
            began = time.thread_time_ns()
            await asyncio.sleep(0)
            floor[k] = time.thread_time_ns() - began
    decode, chain, encoded = (Spread.of(parts[:, k]) for k in range(3))
    return TickCost(ticks, decode, chain, encoded, Spread.of(parts.sum(axis=1)), Spread.of(floor)), standing
