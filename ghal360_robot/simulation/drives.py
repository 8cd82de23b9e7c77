"""Random drives among walking people: the robot's own safety chain between a random driver and the simulated base.

Everything pure that a live robot runs is run here, at its own rates and delays: the board's freshness, the
chain at 50 Hz, normalised wire frames, the base's latency and limits, odometry from its feedback, sweeps of the
lidar that arrive late. No clock: a number names a drive, and the same number is always the same drive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.assembly import lidar_mount, make_brain, make_safety
from ghal360_robot.board import make_board
from ghal360_robot.config import with_overrides
from ghal360_robot.messages import STILL, Applied, ArmState, HeadPose, OperatorInput, Pose2, Twist
from ghal360_robot.safety.chain import SafetyState
from ghal360_robot.safety.collision import watch
from ghal360_robot.safety.mux import TELEOP
from ghal360_robot.simulation.drive_judge import SAMPLE_S, Contact, ContactJudge, Fault, Standstill, StandstillJudge
from ghal360_robot.simulation.lidar_sweep import STEP_NS, SweepingLidar
from ghal360_robot.simulation.plant import Body
from ghal360_robot.simulation.random_driver import STYLE_SHARES, STYLES, RandomDriver, Style, Wish
from ghal360_robot.simulation.walkers import Crowd, Moving
from ghal360_robot.simulation.walking_ground import Ground
from ghal360_robot.simulation.wired_base import WiredBase
from ghal360_robot.simulation.world import ROBOT_RADIUS_M, TARGETS, build_world
from ghal360_robot.surroundings import look_around

if TYPE_CHECKING:
    from ghal360_robot.config import RobotConfig
    from ghal360_robot.intent.controller import DriveSettings

TICK_NS = 2 * STEP_NS
TICK_S = TICK_NS / 1e9
DRIVE_S = 30.0
OPERATOR_NS = 50_000_000
PICTURE_NS = 33_366_700
ARM_AGAIN_S = 0.5
"""A driver who sees that the robot is not armed presses again after so long."""
WHEELS = 0.01
"""Tyres and track are known to a percent once they are calibrated; odometry is off by as much."""
WORLDS = 100
"""Half of them offices, half homes; drives are numbered so that consecutive ones are in different worlds."""
PEOPLE = (1, 4)


@dataclass(frozen=True, slots=True)
class Drive:
    """What a number stands for."""

    number: int
    world: str
    seed: int
    people: int
    courteous: bool
    style: Style
    seconds: float = DRIVE_S


@dataclass(frozen=True, slots=True)
class Moment:
    """One tick as it truly was, for pictures."""

    pose: Pose2
    wish: Wish
    applied: Applied
    people: tuple[tuple[float, float, float], ...]
    """x, y, radius of each body."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a drive went."""

    drive: Drive
    contacts: tuple[Contact, ...]
    stuck: tuple[Standstill, ...]
    wedged: tuple[Standstill, ...]
    distance_m: float
    asked_s: float
    """Time in which the driver asked for motion."""
    moved_s: float
    """Part of that time in which the robot moved."""
    armed_s: float
    least_clearance_m: float
    """Smallest distance from the body's centre to what stands, as far as it came near."""
    odometry_off_m: float
    moments: tuple[Moment, ...] = field(default=(), repr=False)

    def count(self, fault: Fault) -> int:
        return sum(contact.fault is fault for contact in self.contacts)

    @property
    def failed(self) -> bool:
        """Whether the robot did what it must never do."""
        return bool(self.stuck) or self.count(Fault.OWN_MOTION) > 0


def drive_of(number: int, seconds: float = DRIVE_S) -> Drive:
    """The drive of that number, 0 or more."""
    rng = np.random.default_rng([number, 0])
    index = number % WORLDS
    return Drive(
        number=number,
        world=("office", "home")[index % 2],
        seed=index // 2,
        people=int(rng.integers(PEOPLE[0], PEOPLE[1] + 1)),
        courteous=bool(rng.random() < 0.5),
        style=STYLES[rng.choice(len(STYLES), p=STYLE_SHARES)],
        seconds=seconds,
    )


@lru_cache(maxsize=4)
def ground_of(world: str, seed: int) -> Ground:
    """The floor of a world; kept while drives of the same world follow each other."""
    return Ground(build_world(world, seed, TARGETS[seed % len(TARGETS)]))


def _drive_settings(config: RobotConfig) -> DriveSettings:
    """How the brain drives; planning a policy of guidance for it would cost as much as seconds of driving."""
    return make_brain(with_overrides(config, {"guidance": {"policy": "none"}})).drive


def run(drive: Drive, config: RobotConfig, *, keep: bool = False) -> Outcome:
    """One drive from start to end; `keep` records every tick."""
    robot = _Run(drive, config)
    moments: list[Moment] = []
    for _ in range(round(drive.seconds / TICK_S)):
        robot.tick()
        if keep:
            moments.append(robot.moment())
    return robot.outcome(tuple(moments))


class _Run:
    def __init__(self, drive: Drive, config: RobotConfig) -> None:
        self.drive = drive
        self.ground = ground_of(drive.world, drive.seed)
        self.world = self.ground.world
        rng = np.random.default_rng([drive.number, 3])
        x, y = self.ground.draw(rng)
        self.body = Body(Pose2(x, y, float(rng.uniform(-math.pi, math.pi))))
        self.start = self.body.pose
        tyre, track = np.random.default_rng([drive.number, 4]).uniform(1.0 - WHEELS, 1.0 + WHEELS, 2).tolist()
        self.base = WiredBase(config.safety.v_max, config.safety.w_max, tyre=tyre, track=track)
        self.board = make_board(config, 1e9 / OPERATOR_NS)
        self.safety, self.safety_state = make_safety(config), SafetyState()
        self.lidar = SweepingLidar(self.world, rng)
        self.mount = lidar_mount(config)
        self.crowd = Crowd(self.ground, drive.number, drive.people, self._moving(STILL), courteous=drive.courteous)
        self.driver = RandomDriver(self.ground, drive.number, drive.style, _drive_settings(config))
        self.contacts = ContactJudge(drive.people, config.safety.reaction_s, config.safety.decel)
        self.standstills = StandstillJudge(self.world)
        self.applied = Applied(STILL, ArmState.DISARMED, ())
        self.ticks = 0
        self.wish = Wish(STILL)
        self.asked = self.moved = self.armed = 0
        self.least_clearance_m = math.inf
        self._presses, self._pressed_s = 0, 0.0
        self._operator_ns, self._picture_ns = 0, 0
        self._base_state = self.base.exchange(0, STILL, drive=False)
        self._inputs = self.board.snapshot(0, 0, armed=False)

    def tick(self) -> None:
        """One control tick, and the two steps of the world until the next."""
        now_ns = self.ticks * TICK_NS
        now_s = now_ns / 1e9
        self._send_inputs(now_ns)
        armed = self.safety_state.arming.state is ArmState.ARMED
        self._inputs = self.board.snapshot(now_ns, self.ticks, armed=armed)
        self.safety_state, applied = self.safety.step(self.safety_state, self._inputs, self._wanted())
        self._base_state = self.base.exchange(now_ns, applied.twist, drive=applied.arm is ArmState.ARMED)
        moving = STILL
        for part in (1, 2):
            moving = self._step_world(now_ns + part * STEP_NS)
        robot = self._moving(moving)
        self.crowd.step(TICK_S, robot)
        self.contacts.look(now_s + TICK_S, self.crowd, robot, self.body.pose.yaw)
        self._keep_count(now_s, moving, applied)
        self.applied = applied
        self.ticks += 1

    def moment(self) -> Moment:
        bodies = np.column_stack((self.crowd.at, self.crowd.radius)).tolist()
        return Moment(self.body.pose, self.wish, self.applied, tuple((x, y, r) for x, y, r in bodies))

    def outcome(self, moments: tuple[Moment, ...]) -> Outcome:
        odometry = self._base_state.pose
        turned = math.cos(self.start.yaw), math.sin(self.start.yaw)
        x = self.start.x + turned[0] * odometry.x - turned[1] * odometry.y
        y = self.start.y + turned[1] * odometry.x + turned[0] * odometry.y
        return Outcome(
            self.drive,
            tuple(self.contacts.contacts),
            tuple(self.standstills.stuck),
            tuple(self.standstills.wedged),
            self.body.distance_m,
            self.asked * TICK_S,
            self.moved * TICK_S,
            self.armed * TICK_S,
            self.least_clearance_m,
            math.hypot(x - self.body.pose.x, y - self.body.pose.y),
            moments,
        )

    def _send_inputs(self, now_ns: int) -> None:
        self.board.put_base(self._base_state)
        while self._picture_ns <= now_ns:
            self.board.put_picture(self._picture_ns)
            self._picture_ns += PICTURE_NS
        if now_ns >= self._operator_ns:
            self._operator_ns += OPERATOR_NS
            self.board.put_operator(self._message(now_ns))

    def _message(self, now_ns: int) -> OperatorInput:
        now_s = now_ns / 1e9
        if self.safety_state.arming.state is not ArmState.ARMED and now_s - self._pressed_s > ARM_AGAIN_S:
            self._presses, self._pressed_s = self._presses + 1, now_s
        stick = self.wish.twist if self.drive.style.startswith("stick") else None
        return OperatorInput(now_ns, HeadPose(), self.wish.deadman, stick, self._presses)

    def _wanted(self) -> Twist:
        """What the brain would want: nothing of its own while the operator's hand is on the stick."""
        return STILL if self.drive.style.startswith("stick") else self.wish.twist

    def _step_world(self, now_ns: int) -> Twist:
        self.base.model.step(now_ns)
        moving = self.base.twist
        self._move(now_ns / 1e9, moving)
        sweep = self.lidar.step(now_ns, self.body.pose, self.crowd.legs)
        if sweep is not None:
            self.board.put_scan(sweep.scan, sweep.arrival_ns)
            self.contacts.saw(sweep.scan.stamp_ns / 1e9, sweep.beams_on, moving.v)
            points = look_around(sweep.scan, self.mount).points
            self.wish = self.driver.step(now_ns / 1e9, self.body.pose, points)
        return moving

    def _move(self, now_s: float, moving: Twist) -> None:
        self.body, near = self.ground.rolled(self.body, moving, STEP_NS / 1e9)
        if not near:
            self.base.model.unblock()
            return
        clearance = self.world.clearance(self.body.pose.x, self.body.pose.y)
        self.least_clearance_m = min(self.least_clearance_m, clearance)
        self.contacts.touched_solid(now_s, self.body.collisions, moving.v)
        if self.body.touching and abs(moving.v) > 0:
            self.base.model.block()
        else:
            self.base.model.unblock()

    def _moving(self, twist: Twist) -> Moving:
        return Moving.robot(self.body.pose, twist.v)

    def _keep_count(self, now_s: float, moving: Twist, applied: Applied) -> None:
        self.asked += self.wish.motion
        self.moved += self.wish.motion and (abs(moving.v) > 0.02 or abs(moving.w) > 0.05)
        self.armed += applied.arm is ArmState.ARMED
        if self.ticks % round(SAMPLE_S / TICK_S) == 0:
            asked = self.wish.twist if self.wish.motion else None
            self.standstills.sample(now_s, self.body.pose, asked, self.crowd, ROBOT_RADIUS_M, self._lets)

    def _lets(self, twist: Twist) -> bool:
        """Whether the robot would let any of this motion through, were it asked for by hand."""
        limits, memory = self.safety.limits, self.safety_state.memory
        monitor = watch(limits, memory, self._inputs, TELEOP, 0.0)
        return not isinstance(monitor, str) and monitor.check(twist)[0] != STILL
