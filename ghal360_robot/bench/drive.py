"""What a control tick meets on a drive: the base's replies, sweeps of the lidar, walking people, a driver's wishes.

The robot drives between the places of the simulated office, and half of the people around it do not look where it
goes. Everything here happens between two ticks and is not measured. No clock: every drive is the same.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from drivers.rmp110.codec.commands import request_mode
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, Stored
from drivers.rmp110.simulator.model import RmpModel
from ghal360_robot.assembly import lidar_mount
from ghal360_robot.intent.controller import DriveSettings
from ghal360_robot.messages import Pose2, Twist
from ghal360_robot.simulation.lidar_sweep import STEP_NS, Sweep, SweepingLidar
from ghal360_robot.simulation.plant import Body
from ghal360_robot.simulation.random_driver import RandomDriver, Wish
from ghal360_robot.simulation.walkers import Crowd, Moving
from ghal360_robot.simulation.walking_ground import Ground
from ghal360_robot.simulation.wired_base import BITMAPS
from ghal360_robot.simulation.world import build_world
from ghal360_robot.surroundings import look_around

if TYPE_CHECKING:
    from drivers.rmp110.codec.frames import Frame
    from ghal360_robot.config import RobotConfig

TICK_NS = 2 * STEP_NS
PEOPLE = 4
SEED = 1


class Moment(NamedTuple):
    """What one tick meets."""

    frames: tuple[Frame, ...]
    sweeps: tuple[Sweep, ...]
    wanted: Twist


class Replay:
    """A drive once more from its tape: the same commands meet the same moments, and no simulator runs in between."""

    def __init__(self, drive: Drive) -> None:
        self.stored = drive.stored
        self._moments = iter(drive.tape)

    def step(self, _now_ns: int, _frame: Frame) -> Moment:
        return next(self._moments)


class Drive:
    """`step` it once a tick, with the frame that the tick before has made."""

    def __init__(self, now_ns: int, config: RobotConfig) -> None:
        self.stored = Stored.of({**RMP110_STORED, **BITMAPS})
        self.wish = Wish()
        self.tape: list[Moment] = []
        """Every moment so far."""
        self._model = RmpModel(now_ns, self.stored, boot_s=0.0)
        self._model.receive(now_ns + TICK_NS, request_mode(ModeRequest.TRACTOR))
        self._ground = Ground(build_world("office", SEED))
        rng = np.random.default_rng(SEED)
        x, y = self._ground.draw(rng)
        self._body = Body(Pose2(x, y, float(rng.uniform(-math.pi, math.pi))))
        self._mount = lidar_mount(config)
        self._lidar = SweepingLidar(self._ground.world, rng)
        self._crowds = [Crowd(self._ground, SEED + n, PEOPLE // 2, self._robot(), courteous=bool(n)) for n in range(2)]
        self._driver = RandomDriver(self._ground, SEED, "stick to places", DriveSettings())

    def step(self, now_ns: int, frame: Frame) -> Moment:
        """Until `now_ns`: what the base replied to `frame`, and the sweeps that were finished meanwhile."""
        sweeps = []
        for at_ns in (now_ns - STEP_NS, now_ns):
            self._model.step(at_ns)
            self._body, _ = self._ground.rolled(self._body, Twist(*self._model.twist), STEP_NS / 1e9)
            sweep = self._lidar.step(at_ns, self._body.pose, self._legs)
            if sweep is not None:
                sweeps.append(sweep)
                points = look_around(sweep.scan, self._mount).points
                self.wish = self._driver.step(at_ns / 1e9, self._body.pose, points)
        for crowd in self._crowds:
            crowd.step(TICK_NS / 1e9, self._robot())
        moment = Moment(self._model.receive(now_ns, frame), tuple(sweeps), self.wish.twist)
        self.tape.append(moment)
        return moment

    def _legs(self) -> np.ndarray:
        return np.concatenate([crowd.legs() for crowd in self._crowds])

    def _robot(self) -> Moving:
        return Moving.robot(self._body.pose, self._model.twist[0])
