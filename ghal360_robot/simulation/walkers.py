"""People who walk through the simulated world: bodies that can be run into, legs that the lidar sees.

Each walks between places by ways of their own, at their own pace, keeps off the furniture and a little off
the others. Whether they keep off the robot is a setting: those who do not are the worst case. No clock, no
input or output; the same seed gives the same walks around the same robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.simulation.walking_ground import PERSON_WAY_M
from ghal360_robot.simulation.world import ROBOT_RADIUS_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import Pose2
    from ghal360_robot.simulation.walking_ground import Ground

    Floats = NDArray[np.float64]

BODY_M = (0.20, 0.25)
"""Radius of a standing person with arms, shoulders turned; the disc is what counts as touched."""
PACE_MPS = (0.3, 1.2)
"""From strolling to walking briskly indoors."""
ACCEL, BRAKE, HARD_BRAKE = 1.0, 1.5, 3.0
"""m/s^2: speeding up and turning, slowing down, and before a wall."""
TURN_RATE = 4.0
"""rad/s of the hips on the spot."""
DECIDE_S = 0.2
"""People look where they go about five times a second."""
PAUSE_S, LONG_PAUSE_S, LONG_SHARE = (0.3, 2.5), 8.0, 0.15
"""Standing at a place, and how often somebody stays there."""
INTEREST = 0.35
"""Chance that a walker goes where the robot is: people stroll all over the building, robots attract them."""
ARRIVED_M = 0.25
STALLED_S = 2.0
"""Who cannot get on for so long goes elsewhere."""
BUMPED_S = 4.0
"""Who walked into the robot keeps off it for so long."""
NEAR_M = 1.2
"""Further apart nobody can run into another before the next decision."""
APART_M, ROBOT_APART_M = 0.25, 0.40
"""Room that people like to keep between themselves, and to a robot they look at."""
TOUCH_M = 0.03
"""Who looks at the robot stops this close to it; who does not is stopped by it."""
CONTACT_ROOM_M = 0.10
"""Who touched the robot steps back this far."""
STEP_BACK_MPS = 0.5

LEG_RADIUS_M = 0.07
"""A calf in trousers at the height of the lidar, 0.25 m."""
HIP_M = 0.10
"""Each leg is this far from the middle: feet 0.2 m apart."""
STEP_M, STEP_PER_MPS = 0.35, 0.27
"""Length of a step: 0.43 m strolling, 0.67 m at 1.2 m/s."""
SHIN = 0.72
"""A leg of 0.9 m swings this much of the foot's travel at the lidar's height."""
STANDING_MPS = 0.3
"""Below this pace the feet come together."""

OFFSETS = np.radians([0.0, 20.0, -20.0, 45.0, -45.0, 75.0, -75.0, 110.0, -110.0])
SHARES = np.array([1.0, 0.6, 0.25])
LOOK_STEPS, LOOK_S = 6, 0.2
"""A choice is thought through 1.2 s ahead."""
WALL_M = 0.12
"""Closer to a wall than this is uncomfortable."""


@dataclass(frozen=True, slots=True)
class Moving:
    """A disc that moves: what walkers know of the robot. Metres, m/s, world frame."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float

    @classmethod
    def robot(cls, pose: Pose2, v: float) -> Moving:
        """The robot at `pose`, driving at `v` m/s."""
        return cls(pose.x, pose.y, v * math.cos(pose.yaw), v * math.sin(pose.yaw), ROBOT_RADIUS_M)


class Crowd:
    """`count` people on one floor. Arrays run over people; `step` moves all of them."""

    def __init__(self, ground: Ground, seed: int, count: int, robot: Moving, *, courteous: bool) -> None:
        self.ground = ground
        self.courteous = courteous
        """They see the robot and go around it; otherwise they walk as if it were not there."""
        self._rng = np.random.default_rng([seed, 1])
        rng = self._rng
        self.radius = rng.uniform(*BODY_M, count)
        self.pace = rng.uniform(*PACE_MPS, count)
        self.at = np.zeros((count, 2))
        for i in range(count):
            self.at[i] = self._entry(i, robot)
        self.velocity = np.zeros((count, 2))
        self.heading = rng.uniform(-math.pi, math.pi, count)
        self._phase = rng.uniform(0.0, 1.0, count)
        self._legs: Floats | None = None
        self._wanted = np.zeros((count, 2))
        self._hard = np.zeros(count, bool)
        self._close: list[tuple[int, int]] = []
        self._now_s = 0.0
        self._decide_s = 0.0
        self._rest_until_s = rng.uniform(0.0, 1.5, count)
        self._stalled_s = np.zeros(count)
        self._bumped_until_s = np.full(count, -1.0)
        self._goals = [self._goal(i, robot) for i in range(count)]

    def __len__(self) -> int:
        return len(self.radius)

    def step(self, dt_s: float, robot: Moving) -> None:
        """Walk on for `dt_s` around (or into) a robot."""
        if not len(self):
            return
        self._now_s += dt_s
        self._legs = None
        self._bump(robot)
        if self._now_s >= self._decide_s:
            self._decide_s += DECIDE_S
            self._decide(robot)
        self._move(dt_s, robot)

    def legs(self) -> Floats:
        """(2n, 3) circles at the height of the lidar: x, y, radius; left and right leg of each in turn."""
        if self._legs is None:
            self._legs = self._stand_on()
        return self._legs

    def _stand_on(self) -> Floats:
        ahead = np.column_stack((np.cos(self.heading), np.sin(self.heading)))
        aside = np.column_stack((-ahead[:, 1], ahead[:, 0]))
        speed = np.hypot(*self.velocity.T)
        swing = SHIN * _step_m(speed) / 2 * np.minimum(speed / STANDING_MPS, 1.0)
        circles = np.empty((len(self), 2, 3))
        circles[:, :, 2] = LEG_RADIUS_M
        for leg, side in enumerate((HIP_M, -HIP_M)):
            phase = (self._phase + leg / 2) % 1.0
            # First half: the foot stands and the body passes over it; second half: it swings forward.
            along = np.where(phase < 0.5, 1.0 - 4.0 * phase, 4.0 * phase - 3.0) * swing
            circles[:, leg, :2] = self.at + along[:, None] * ahead + side * aside
        return circles.reshape(-1, 3)

    def gaps(self, robot: Moving) -> Floats:
        """(n,) distance between each body and the robot's; negative where they overlap."""
        away = np.hypot(self.at[:, 0] - robot.x, self.at[:, 1] - robot.y)
        return away - self.radius - robot.radius

    def _entry(self, i: int, robot: Moving) -> tuple[float, float]:
        """Where somebody stands at first: not upon anybody, and not before the robot's feet."""
        for _ in range(200):
            x, y = self.ground.draw(self._rng)
            near = any(math.dist((x, y), self.at[j]) < 0.8 for j in range(i))
            if not near and math.hypot(x - robot.x, y - robot.y) > 1.5:
                return x, y
        raise RuntimeError(f"There is no room for {i + 1} people in the {self.ground.world.name}.")

    def _goal(self, i: int, robot: Moving) -> tuple[float, float]:
        places = self.ground.places
        away = np.hypot(places[:, 0] - robot.x, places[:, 1] - robot.y)
        if self._rng.random() < INTEREST:
            choice = int(np.argsort(away)[self._rng.integers(2)])
        else:
            choice = int(self._rng.integers(len(places)))
        return float(places[choice, 0]), float(places[choice, 1])

    def _bump(self, robot: Moving) -> None:
        """Who touches the robot notices it, whatever else they look at."""
        touched = self.gaps(robot) < 0.0
        self._bumped_until_s[touched] = self._now_s + BUMPED_S
        for i in np.flatnonzero(touched & (self._stalled_s < STALLED_S)):
            self._goals[i] = self._goal(int(i), robot)

    def _decide(self, robot: Moving) -> None:
        aims, speeds = self.at.copy(), np.zeros(len(self))
        for i in range(len(self)):
            here = (float(self.at[i, 0]), float(self.at[i, 1]))
            aim, left_m = self.ground.aim(PERSON_WAY_M, here, self._goals[i])
            if left_m < ARRIVED_M:
                longest = LONG_PAUSE_S if self._rng.random() < LONG_SHARE else PAUSE_S[1]
                self._rest_until_s[i] = self._now_s + self._rng.uniform(PAUSE_S[0], longest)
                self._goals[i] = self._goal(i, robot)
            elif self._stalled_s[i] > STALLED_S or not math.isfinite(left_m):
                self._goals[i] = self._goal(i, robot)
                self._stalled_s[i] = 0.0
            if self._now_s >= self._rest_until_s[i]:
                aims[i] = aim
                speeds[i] = min(self.pace[i], math.sqrt(2.0 * ACCEL * max(left_m, 0.0)) + 0.1)
        self._choose(aims, speeds, robot)
        everyone = range(len(self))
        self._close = [(i, j) for i in everyone for j in range(i) if math.dist(self.at[i], self.at[j]) < NEAR_M]
        close, back = self._backing_off(robot)
        self._wanted[close] = back[close]
        slow = np.hypot(*self.velocity.T) < 0.1
        self._stalled_s = np.where(slow & (speeds > 0.0), self._stalled_s + DECIDE_S, 0.0)

    def _backing_off(self, robot: Moving) -> tuple[NDArray[np.bool_], Floats]:
        """Who is too close to the robot after a bump (n,), and the velocities (n, 2) away from it."""
        away = self.at - (robot.x, robot.y)
        away /= np.maximum(np.hypot(*away.T), 1e-6)[:, None]
        close = (self._now_s < self._bumped_until_s) & (self.gaps(robot) < CONTACT_ROOM_M)
        return close, STEP_BACK_MPS * away

    def _choose(self, aims: Floats, speeds: Floats, robot: Moving) -> None:
        """Of a fan of velocities the one that costs least when thought through with everybody going on."""
        towards = aims - self.at
        bearing = np.arctan2(towards[:, 1], towards[:, 0])
        angles = (bearing[:, None] + OFFSETS).repeat(len(SHARES), axis=1)
        fan = np.cos(OFFSETS).repeat(len(SHARES))
        shares = np.tile(SHARES, len(OFFSETS))
        pace = speeds[:, None] * shares
        options = np.stack((pace * np.cos(angles), pace * np.sin(angles)), axis=2)
        options = np.concatenate((options, np.zeros((len(self), 1, 2))), axis=1)
        cost = np.append((1.0 - fan) + 0.8 * (1.0 - shares), 1.1) + self._troubles(options, robot)
        best = cost.argmin(axis=1)
        everyone = np.arange(len(self))
        self._wanted = options[everyone, best]
        self._hard = ~np.isfinite(cost[everyone, best])
        self._wanted[self._hard | (speeds == 0.0)] = 0.0

    def _troubles(self, options: Floats, robot: Moving) -> Floats:
        """(n, options) cost of walls and of others on the way of each option."""
        place, velocity = self.at[:, None], np.repeat(self.velocity[:, None], options.shape[1], axis=1)
        places = []
        for _ in range(LOOK_STEPS):
            change = options - velocity
            size = np.hypot(change[..., 0], change[..., 1])
            velocity = velocity + change * np.minimum(1.0, BRAKE * LOOK_S / np.maximum(size, 1e-9))[..., None]
            place = place + velocity * LOOK_S
            places.append(place)
        way = np.stack(places, axis=2)
        later_s = LOOK_S * np.arange(1, LOOK_STEPS + 1)
        least_room = self.ground.room(way[..., 0], way[..., 1]).min(axis=2) - self.radius[:, None]
        wall = np.where(least_room < 0.0, np.inf, 2.0 * np.maximum(WALL_M - least_room, 0.0))
        # Everybody and the robot, as they will be if they go on: (others, steps, 2).
        there = np.vstack((self.at, (robot.x, robot.y)))
        going = np.vstack((self.velocity, (robot.vx, robot.vy)))
        later = there[:, None] + going[:, None] * later_s[:, None]
        apart = np.append(self.radius + APART_M, robot.radius + ROBOT_APART_M)
        away = way[:, :, None] - later
        gap = np.hypot(away[..., 0], away[..., 1]) - apart[:, None] - self.radius[:, None, None, None]
        crowd = (5.0 * (1.0 - 0.5 * later_s / later_s[-1]) * np.maximum(-gap, 0.0)).max(axis=3)
        everyone = np.arange(len(self))
        crowd[everyone, :, everyone] = 0.0
        if not self.courteous:
            crowd[self._now_s >= self._bumped_until_s, :, -1] = 0.0
        troubles: Floats = wall + crowd.max(axis=2)
        return troubles

    def _move(self, dt_s: float, robot: Moving) -> None:
        change = self._wanted - self.velocity
        size = np.hypot(*change.T)
        braking = np.einsum("ij,ij->i", change, self.velocity) < 0.0
        limit = np.where(self._hard, HARD_BRAKE, np.where(braking, BRAKE, ACCEL)) * dt_s
        velocity = self.velocity + change * np.minimum(1.0, limit / np.maximum(size, 1e-9))[:, None]
        there = self.at + velocity * dt_s
        # Off a wall, and off each other, one may always step.
        room, before = self.ground.room(*np.stack((there, self.at)).transpose(2, 0, 1))
        blocked = (room < self.radius) & (room <= before)
        reach = self.radius + robot.radius
        gap_before, gap = (np.hypot(*(place - (robot.x, robot.y)).T) - reach for place in (self.at, there))
        stopped = gap < TOUCH_M if self.courteous else gap_before < 0.0
        blocked |= stopped & (gap < gap_before)
        for i, j in self._close:
            apart = math.dist(there[i], there[j])
            if apart < self.radius[i] + self.radius[j] and apart < math.dist(self.at[i], self.at[j]):
                blocked[i] = blocked[j] = True
        self.velocity = np.where(blocked[:, None], 0.0, velocity)
        self.at = np.where(blocked[:, None], self.at, there)
        speed = np.hypot(*self.velocity.T)
        turn = np.arctan2(self.velocity[:, 1], self.velocity[:, 0]) - self.heading
        turn = np.where(speed > 0.1, (turn + math.pi) % math.tau - math.pi, 0.0)
        self.heading = self.heading + np.clip(turn, -TURN_RATE * dt_s, TURN_RATE * dt_s)
        self._phase = (self._phase + speed * dt_s / (2.0 * _step_m(speed))) % 1.0


def _step_m(speed: Floats) -> Floats:
    return STEP_M + STEP_PER_MPS * speed
