"""Whole searches in simulated time: the robot's own brain and safety chain around the simulated base and body.

No wires, no clock: a search of a minute takes seconds, so that many seeds can be tried. It leaves out the codecs
and, unless it is given a camera that renders, the pictures: an ideal detector reports what is in line of sight.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from drivers.rmp110.codec.commands import motion, request_mode
from drivers.rmp110.codec.motion import MotionScale, normalise
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, OperationalState
from drivers.rmp110.simulator.model import RmpModel
from drivers.tim571.geometry import BEAM_YAW
from ghal360_robot.assembly import lidar_mount, make_brain, make_safety
from ghal360_robot.brain import BrainState
from ghal360_robot.journal import Journal
from ghal360_robot.messages import (
    ArmState,
    BaseMode,
    BaseState,
    Detection,
    Detections,
    Freshness,
    Inputs,
    LidarScan,
    OperatorInput,
    Pose2,
    Twist,
)
from ghal360_robot.safety.chain import SafetyState
from ghal360_robot.simulation.operator_desk import OperatorDesk, PageStatus
from ghal360_robot.simulation.plant import Body, advance, move
from ghal360_robot.simulation.view import lidar_view
from ghal360_robot.simulation.world import CAMERA_HEIGHT_M, ROBOT_RADIUS_M, Role, World
from ghal360_robot.surroundings import look_around

if TYPE_CHECKING:
    from ghal360_robot.config import RobotConfig
    from ghal360_robot.messages import Applied, Decision, Surroundings

TICK_NS = 20_000_000
TICK_S = TICK_NS / 1e9
OPERATOR_EVERY, SCAN_EVERY = 3, 3
"""Ticks between messages of the operator and between scans (17 Hz)."""

SCAN_NOISE_M = 0.020
DETECTED_M = 8.0
FRESH = Freshness(alive=True, rate_ok=True, valid=True, age_s=0.02)
HEALTHY = dict.fromkeys(("theta", "tim571", "rmp110", "operator"), FRESH)


@dataclass(frozen=True, slots=True)
class Camera:
    """Where detections come from: `look(pose, stamp_ns, picture)`, every so many ticks, known so many later."""

    look: Callable[[Pose2, int, int], Detections]
    every_ticks: int = 12
    """4 Hz."""
    delay_ticks: int = 8
    """Camera, decoder and a fast detector: 0.16 s on two cores."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a search ended."""

    found: bool
    """The operator pressed "found" and the target was in view."""
    seconds: float
    distance_m: float
    collisions: int
    least_clearance_m: float
    """Smallest distance from the body's centre to anything solid."""
    cues: dict[str, int]
    path: tuple[tuple[float, float], ...]
    """The body's position twice a second."""


class Lockstep:
    """One robot in one world, advanced tick by tick."""

    def __init__(
        self,
        world: World,
        config: RobotConfig,
        seed: int,
        on_tick: Callable[[Inputs, Decision, Applied], None] | None = None,
        camera: Camera | None = None,
    ) -> None:
        """With the ideal detector unless another camera is given."""
        self.world = world
        self.brain, self.safety = make_brain(config), make_safety(config)
        self.brain_state, self.safety_state = BrainState(), SafetyState()
        self.model = RmpModel(0, boot_s=0.1)
        self.scale = MotionScale(
            RMP110_STORED["max_velocity"], RMP110_STORED["max_yaw_rate"], config.safety.v_max, config.safety.w_max
        )
        self.body = Body(world.start)
        self.odometry = Pose2()
        self.desk = OperatorDesk(world, seed)
        self.journal = Journal(0)
        self._on_tick = on_tick
        self._camera = camera or Camera(partial(ideal_detections, world))
        self.tick = 0
        self.least_clearance_m = math.inf
        self._rng = np.random.default_rng(seed)
        self._see = lidar_view(world, lambda: self.body.pose)
        self._scan: LidarScan | None = None
        self._around: Surroundings | None = None
        self._mount = lidar_mount(config)
        self._detections: Detections | None = None
        self._upcoming: list[Detections] = []
        self._operator: OperatorInput | None = None

    def step(self) -> None:
        """One control tick and two of the base's."""
        now_ns = self.tick * TICK_NS
        self._sense(now_ns)
        armed = self.safety_state.arming.state is ArmState.ARMED
        state = self._base_state(now_ns)
        inputs = Inputs(
            now_ns,
            self.tick,
            state,
            self._scan,
            self._detections,
            self._operator,
            HEALTHY,
            armed,
            surroundings=self._around,
        )
        self.brain_state, decision = self.brain.step(self.brain_state, inputs)
        self.safety_state, applied = self.safety.step(self.safety_state, inputs, decision.wanted)
        self.journal.observe(inputs, decision, applied)
        if self._on_tick is not None:
            self._on_tick(inputs, decision, applied)
        self._drive(now_ns, applied.arm, applied.twist)
        status = PageStatus(
            decision.cue.value,
            applied.arm is ArmState.ARMED,
            not self.safety.not_ready(self.safety_state, inputs),
            trouble=False,
        )
        self.desk.tell(status, now_ns)
        self.tick += 1

    def _sense(self, now_ns: int) -> None:
        pose = self.body.pose
        if self.tick % SCAN_EVERY == 0:
            distance = self._see(now_ns)[0] + self._rng.normal(0.0, SCAN_NOISE_M, len(BEAM_YAW))
            distance[(distance < 0.05) | (distance > 25.0)] = np.nan
            number = self.tick // SCAN_EVERY % 65536
            yaw = np.asarray(BEAM_YAW, np.float32)
            self._scan = LidarScan(now_ns, distance.astype(np.float32), yaw, number, number, now_ns // 1000)
            self._around = look_around(self._scan, self._mount)
        if self.tick % self._camera.every_ticks == 0:
            self._upcoming.append(self._camera.look(pose, now_ns, self.tick))
        if self._upcoming and self._upcoming[0].picture + self._camera.delay_ticks <= self.tick:
            self._detections = self._upcoming.pop(0)
        if self.tick % OPERATOR_EVERY == 0:
            self._operator = self.desk.step(pose, now_ns)

    def _base_state(self, now_ns: int) -> BaseState:
        mode = BaseMode.DRIVE if self.model.state is OperationalState.TRACTOR else BaseMode.STANDBY
        v, w = self.model.twist
        return BaseState(now_ns, mode, self.odometry, Twist(v, w), self.model.battery_percent)

    def _drive(self, now_ns: int, arm: ArmState, twist: Twist) -> None:
        """The same frames that the driver would send, then what the wheels do to the body."""
        wanted = ModeRequest.TRACTOR if arm is ArmState.ARMED else ModeRequest.STANDBY
        driving = self.model.state is OperationalState.TRACTOR
        if driving is not (wanted is ModeRequest.TRACTOR):
            self.model.receive(now_ns, request_mode(wanted))
        if driving:
            command = normalise(twist.v, twist.w, self.scale)
            self.model.receive(now_ns, motion(command.velocity, command.yaw_rate))
        for part in (TICK_NS // 2, TICK_NS):
            self.model.step(now_ns + part)
            moved = Twist(*self.model.twist)
            self.body = move(self.world, self.body, moved, TICK_S / 2, ROBOT_RADIUS_M)
            self.odometry = advance(self.odometry, moved, TICK_S / 2)
        pose = self.body.pose
        self.least_clearance_m = min(self.least_clearance_m, self.world.clearance(pose.x, pose.y))


def search(world: World, config: RobotConfig, seed: int, limit_s: float) -> Outcome:
    """One search, until the operator says "found" or the time is over."""
    run = Lockstep(world, config, seed)
    path: list[tuple[float, float]] = []
    while run.journal.found_ns is None and run.tick * TICK_S < limit_s:
        if run.tick % 25 == 0:
            path.append((run.body.pose.x, run.body.pose.y))
        run.step()
    return Outcome(
        found=run.journal.found_ns is not None and run.desk.found_in_view is True,
        seconds=run.tick * TICK_S,
        distance_m=run.body.distance_m,
        collisions=run.body.collisions,
        least_clearance_m=run.least_clearance_m,
        cues=dict(run.journal.cues),
        path=tuple(path),
    )


def ideal_detections(world: World, pose: Pose2, stamp_ns: int, picture: int) -> Detections:
    """Every detectable object in line of sight within reach, at its true direction."""
    found = []
    for item in world.objects:
        if item.role not in {Role.TARGET, Role.CLUTTER}:
            continue
        dx, dy = item.x - pose.x, item.y - pose.y
        distance = math.hypot(dx, dy)
        if distance <= DETECTED_M and world.visible(pose.x, pose.y, CAMERA_HEIGHT_M, item):
            yaw = math.remainder(math.atan2(dy, dx) - pose.yaw, math.tau)
            pitch = math.atan2(item.z + item.size[2] / 2 - CAMERA_HEIGHT_M, distance)
            found.append(Detection(item.name, 0.9, yaw, pitch, item.size[0] / distance, item.size[2] / distance))
    return Detections(stamp_ns, picture, "ideal", tuple(found))
