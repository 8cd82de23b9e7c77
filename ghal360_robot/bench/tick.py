"""What the inner half of a control tick costs on one core: feedback in, safety chain, motion frame out.

`decode` is eleven CAN frames to a BaseState; `chain` is that to the board, a snapshot with every input's freshness,
and the safety chain, which takes in a new scan where there is one; `encode` is a twist to a motion frame that passed
the whitelist. `scan` is told beside them: what the lidar's task does when a scan arrives, between two ticks.

The robot drives between the places of the simulated office, with people walking around it (`bench.drive`), first
with the simulators and then once more from the tape, which is what is measured; the code is its own. Costs are this
thread's CPU time, so that other programs do not count; every tick is followed by an empty turn of the event loop, so
that the ratio of the two can be compared between machines.
"""

from __future__ import annotations

import asyncio
import gc
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.rmp110.codec.commands import motion
from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.whitelist import forbidden
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.identify import conclude
from drivers.rmp110.device.odometry import Odometry
from drivers.rmp110.device.slip import SlipWatch
from drivers.rmp110.device.state import all_finite, read_state
from ghal360_robot.assembly import make_safety
from ghal360_robot.bench.drive import TICK_NS, Drive, Replay
from ghal360_robot.board import make_board
from ghal360_robot.config import RobotConfig
from ghal360_robot.errors import GhalError
from ghal360_robot.hardware.base import base_state
from ghal360_robot.messages import STILL, ArmState, BaseState, HeadPose, OperatorInput, Twist
from ghal360_robot.robot import SWITCH_INTERVAL_S
from ghal360_robot.safety.chain import SafetyState

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.rmp110.codec.frames import Frame
    from drivers.rmp110.codec.parameters import Stored
    from drivers.rmp110.device.language import Language, Report
    from drivers.rmp110.device.state import State

LIMIT_MS = 0.5
"""p99 of encode, decode and chain together: a fortieth of the control period."""
TICKS = 20_000
BEGIN_NS = 1_000_000_000
TICKS_PER_S = 50
OPERATOR_EVERY = 2
"""Ticks from one message of the operator to the next: 25 a second."""
LEAST_MOVED = 0.5
"""Of the ticks must let the robot move, or it was not driving that was measured."""
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
    scan: Spread
    """Of a scan that arrives, to what is around in the base frame; in no tick."""
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
            "scan": self.scan.to_json(),
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
    """The inner half of the robot on a drive through the simulated office, one `tick` at a time."""

    def __init__(self, drive: Drive | Replay) -> None:
        config = RobotConfig()
        self.now_ns = BEGIN_NS
        self.twist = STILL
        """What went out last."""
        self._count = 0
        self._drive = drive
        self._decoder = Decoder(
            Rmp110Config(max_v_mps=config.safety.v_max, max_w_rps=config.safety.w_max), self._drive.stored
        )
        self._board = make_board(config, TICKS_PER_S / OPERATOR_EVERY)
        self._safety = make_safety(config)
        self._state = SafetyState()
        self._next = motion(0.0, 0.0)
        self._presses = 0

    def tick(self) -> tuple[tuple[int, int, int, int], bool]:
        """Nanoseconds of decode, chain, encode, and of scans that arrived (0: none); whether motion was let through."""
        self.now_ns += TICK_NS
        frames, sweeps, wanted = self._drive.step(self.now_ns, self._next)
        self._hear_operator(wanted)
        arrived = time.thread_time_ns()
        for sweep in sweeps:
            self._board.put_scan(sweep.scan, sweep.arrival_ns)
        began = time.thread_time_ns()
        scans = began - arrived if sweeps else 0
        state = self._decoder.decode(self.now_ns, frames)
        decoded = time.thread_time_ns()
        self._board.put_base(state)
        armed = self._state.arming.state is ArmState.ARMED
        inputs = self._board.snapshot(self.now_ns, self._count, armed=armed)
        self._state, applied = self._safety.step(self._state, inputs, wanted)
        judged = time.thread_time_ns()
        self._next = encode(applied.twist, self._decoder.identity.language)
        encoded = time.thread_time_ns()
        self._count += 1
        self.twist = applied.twist
        moved = applied.arm is ArmState.ARMED and applied.twist != STILL
        return (decoded - began, judged - decoded, encoded - judged, scans), moved

    def _hear_operator(self, wanted: Twist) -> None:
        """Between two ticks there may be a new picture and a message."""
        self._board.put_picture(self.now_ns)
        if self._count % OPERATOR_EVERY == 0:
            self._presses += self._state.arming.state is not ArmState.ARMED
            self._board.put_operator(
                OperatorInput(self.now_ns, HeadPose(), deadman=True, stick=wanted, arm_presses=self._presses)
            )


def taped(ticks: int) -> tuple[Ticker, Twist]:
    """A ticker on the tape of a drive of so many ticks, and the command that it has to end with."""
    drive = Drive(BEGIN_NS, RobotConfig())
    live = Ticker(drive)
    for _ in range(ticks):
        live.tick()
    return Ticker(Replay(drive)), live.twist


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
    """Cost of so many ticks, after a warm-up. Raises GhalError where the robot stood still in most of them."""
    cost, moved = asyncio.run(_measure(ticks))
    if moved < LEAST_MOVED * ticks:
        raise GhalError(f"the simulated robot moved in {moved} of {ticks} ticks: driving was not measured")
    return cost


async def _measure(ticks: int) -> tuple[TickCost, int]:
    ticker, at_last = taped(WARM_UP + ticks)
    parts = np.zeros((ticks, 4), np.int64)
    floor = np.zeros(ticks, np.int64)
    moving = 0
    with _as_in_the_robot():
        for _ in range(WARM_UP):
            ticker.tick()
        for k in range(ticks):
            parts[k], moved = ticker.tick()
            moving += moved
            began = time.thread_time_ns()
            await asyncio.sleep(0)
            floor[k] = time.thread_time_ns() - began
    if ticker.twist != at_last:
        raise GhalError("the same drive led to another command the second time: the safety chain is not pure")
    decode, chain, encoded = (Spread.of(parts[:, k]) for k in range(3))
    total, scans = Spread.of(parts[:, :3].sum(axis=1)), parts[:, 3]
    return TickCost(ticks, decode, chain, encoded, total, Spread.of(scans[scans > 0]), Spread.of(floor)), moving
