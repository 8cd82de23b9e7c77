"""The people and devices around the robot in simulated time: what they send, and what they stop sending."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass, field

import numpy as np

from drivers.rmp110.codec.feedback import COMPACT_BITMAPS
from drivers.rmp110.codec.parameters import RMP110_STORED, Stored
from drivers.rmp110.simulator.model import RmpModel
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.messages import HeadPose, LidarScan, OperatorInput, Twist
from tests.virtual_time.chain import OPERATOR_HZ, Chain
from tests.virtual_time.checker import WireChecker, Witness
from tests.virtual_time.clock import Clock
from tests.virtual_time.wire import OnWire, VirtualBus

FEEDBACK = {f"feedback_bitmap_{n}": word for n, word in enumerate(COMPACT_BITMAPS, start=1)}
BEAM_YAW = np.radians(np.linspace(-135.0, 135.0, 271, dtype=np.float32))
SCAN_S, PICTURE_S, MESSAGE_S = 1 / 15, 1 / 29.97, 1 / OPERATOR_HZ
FAR_M = 5.0
ACROSS = math.radians(75)
"""To either side; walls are as wide as that, the rest of the room is far away."""
NONSENSE = 1e6
"""No stick and no head gives such a number; NaN is none either."""
POSSIBLE_PRESSES = 10**9
"""Nobody pressed a button more often; such a count is no stop, but nonsense."""
BOOT_S = 0.3
"""Shorter than a real base's nine seconds; the order of states is the same."""
FAST_RESTART = {"rmp110": {"interface": "virtual"}}


@dataclass
class Hands:
    """What the operator does; `send` says so 20 times a second."""

    stick: Twist | None = Twist()
    deadman: bool = False
    arm: int = 0
    disarm: int = 0
    estop: int = 0
    sending: bool = True
    stamp_shift_s: float = 0.0
    """Messages claim to be so much younger than they are; negative: older."""


@dataclass
class Surround:
    """What lidar and camera deliver."""

    wall_m: float = FAR_M
    scans: bool = True
    covered: bool = False
    healthy: bool = True
    scan_shift_s: float = 0.0
    pictures: bool = True


@dataclass
class Stage:
    """One base on one bus, one robot at a time around it, and a judge. Inside a virtual loop."""

    clock: Clock
    hands: Hands = field(default_factory=Hands)
    surround: Surround = field(default_factory=Surround)

    def __post_init__(self) -> None:
        model = RmpModel(self.clock.now_ns, Stored.of({**RMP110_STORED, **FEEDBACK}), boot_s=BOOT_S)
        self.witness = Witness()
        self.checker = WireChecker(self.witness)
        self.bus = VirtualBus(self.clock, model, self._on_wire)
        self.tape: list[OnWire] | None = None
        """Every frame, where a test wants them."""
        self.config: RobotConfig = with_overrides(RobotConfig(), FAST_RESTART)
        self.chain: Chain | None = None
        self._devices: list[asyncio.Task[None]] = []
        self._newest_message_s = -math.inf
        self._scans = 0

    async def open(self) -> None:
        """Devices on, robot started."""
        self._devices = [
            asyncio.create_task(self._repeat(MESSAGE_S, self._message), name="operator"),
            asyncio.create_task(self._repeat(SCAN_S, self._scan), name="lidar"),
            asyncio.create_task(self._repeat(PICTURE_S, self._picture), name="camera"),
        ]
        await self.start_robot()

    async def close(self) -> None:
        if self.chain is not None:
            await self.stop_robot()
        for task in self._devices:
            task.cancel()
        await asyncio.wait(self._devices)

    async def start_robot(self) -> None:
        self.witness.restart()
        self.witness.arm_count = None
        self._newest_message_s = -math.inf
        chain = Chain(self.bus, self.config)
        await chain.start()
        self.chain = chain

    async def stop_robot(self, *, orderly: bool = True) -> None:
        """End the robot's process; a killed one says nothing more."""
        chain, self.chain = self.chain, None
        if chain is None:
            return
        await (chain.stop() if orderly else chain.kill())
        self._excuse()
        self.checker.robot_gone(self.clock.seconds(), orderly=orderly)

    async def run(self, seconds: float) -> None:
        """Let everybody live; in steps, so that the judge can look in between."""
        end_s = self.clock.seconds() + seconds
        while (left_s := end_s - self.clock.seconds()) > 1e-9:
            self._excuse()
            await asyncio.sleep(min(0.05, left_s))
            self._excuse()
            self.checker.look(self.clock.seconds())

    async def armed_and_driving(self, stick: Twist = Twist(0.4, 0.0), seconds: float = 1.5) -> None:  # noqa: B008
        """From a standing start to motion; the test that needs it checks `moving`."""
        await self.until_streaming()
        self.hands.deadman, self.hands.stick = True, Twist()
        await self.run(0.6)
        self.hands.arm += 1
        await self.run(0.4)
        self.hands.stick = stick
        await self.run(seconds)

    async def until_streaming(self, timeout_s: float = 15.0) -> None:
        end_s = self.clock.seconds() + timeout_s
        while not (self.chain and self.chain.streaming and self.bus.model.state >= 3):
            assert self.clock.seconds() < end_s, "the base was not found"
            await self.run(0.1)

    @property
    def future_s(self) -> float:
        """How far in the future the newest message claims to be from."""
        return max(0.0, self._newest_message_s - self.clock.seconds())

    def problems(self) -> list[str]:
        """Everything that must not be: on the wire, or a part of the robot that died."""
        return self.checker.violations + (self.chain.failures() if self.chain else [])

    def message(self, message: OperatorInput) -> None:
        """One message of the operator reaches the robot now."""
        if self.chain is None:
            return
        now_s, stamp_s = self.clock.seconds(), message.stamp_ns / 1e9
        stick = message.stick
        numbers = (message.head.yaw, *((stick.v, stick.w) if stick else ()))
        counts = (message.arm_presses, message.disarm_presses, message.estop_presses)
        countable = all(0 <= count < POSSIBLE_PRESSES for count in counts)
        sane = countable and all(abs(x) < NONSENSE for x in numbers)
        in_order = stamp_s > self._newest_message_s
        if countable:  # whatever else is wrong with a message: a stop is a stop
            self.witness.presses(now_s, *counts, steers=sane, first=math.isinf(self._newest_message_s))
        if sane:
            self.witness.lives("operator", now_s, stamp_s)
            # Only a message in order takes the dead man away: the robot may ignore one that was overtaken.
            self.witness.deadman = message.deadman or (self.witness.deadman and not (in_order and stamp_s <= now_s))
            self._newest_message_s = max(self._newest_message_s, stamp_s)
        self.chain.board.put_operator(message)

    def scan(self, scan: LidarScan) -> None:
        """One scan reaches the robot now."""
        if self.chain is None:
            return
        self.witness.lives("lidar", self.clock.seconds(), scan.stamp_ns / 1e9)
        if not scan.device_ok:
            self.witness.revoke("the lidar reported itself unfit")
        seen = np.isfinite(scan.ranges)
        ahead_m = (scan.ranges * np.cos(scan.yaw))[seen & (np.abs(scan.yaw) < ACROSS)]
        self.witness.wall_m = float(ahead_m.min()) if len(ahead_m) else -math.inf
        self.chain.board.put_scan(scan, self.clock.now_ns)

    def _message(self) -> None:
        hands = self.hands
        if hands.sending:
            self.message(
                OperatorInput(
                    stamp_ns=self.clock.now_ns + round(hands.stamp_shift_s * 1e9),
                    head=HeadPose(),
                    deadman=hands.deadman,
                    stick=hands.stick,
                    arm_presses=hands.arm,
                    disarm_presses=hands.disarm,
                    estop_presses=hands.estop,
                )
            )

    def _scan(self) -> None:
        around = self.surround
        if around.scans:
            self._scans += 1
            wall_m = np.where(np.abs(BEAM_YAW) < ACROSS, around.wall_m / np.cos(BEAM_YAW), FAR_M)
            ranges = np.where(around.covered, math.nan, np.minimum(wall_m, FAR_M)).astype(np.float32)
            stamp_ns = self.clock.now_ns + round(around.scan_shift_s * 1e9)
            number = self._scans % 65536
            self.scan(LidarScan(stamp_ns, ranges, BEAM_YAW, number, number, stamp_ns // 1000, around.healthy))

    def _picture(self) -> None:
        if self.surround.pictures and self.chain is not None:
            self.witness.lives("video", self.clock.seconds(), self.clock.seconds())
            self.chain.board.put_picture(self.clock.now_ns)

    def _excuse(self) -> None:
        if self.bus.down or self.bus.full or self.chain is None:
            self.checker.excuse(self.clock.seconds())

    def _on_wire(self, frame: OnWire) -> None:
        self.checker.feed(frame)
        if self.tape is not None:
            self.tape.append(frame)

    async def _repeat(self, period_s: float, act: object) -> None:
        while True:
            act()  # type: ignore[operator]
            await asyncio.sleep(period_s)
