"""A driver who asks for anything: straight on, arcs, turns, backwards, places far away, and plain nonsense.

Like any human in front of a robot that does not move, they try something else after a while. Seeded, no clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ghal360_robot.angles import wrap
from ghal360_robot.intent.controller import DriveSettings, drive_towards
from ghal360_robot.intent.steering import choose_heading
from ghal360_robot.messages import STILL, Pose2, Twist
from ghal360_robot.simulation.walking_ground import ROBOT_WAY_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.simulation.walking_ground import Ground

Style = Literal["stick", "stick to places", "autonomy", "autonomy to places"]
STYLES: tuple[Style, ...] = ("stick", "stick to places", "autonomy", "autonomy to places")
STYLE_SHARES = (0.4, 0.15, 0.15, 0.3)

HOLD_S = (0.5, 3.0)
"""How long one wish lasts."""
WILD = (math.nan, math.inf, -math.inf, 1e30, -1e30, 7.0, -7.0, 1e5, -1e5, 5e-324, -0.0)
"""What no finger asks for, and what a broken client might send."""
IMPATIENT_S = 3.0
"""Who has not got this far in so long tries something else, and goes on trying until then."""
MOVED_M, MOVED_RAD = 0.15, math.radians(20.0)
TRY_S = 1.0
TRIES = (
    Twist(0.0, 0.6),
    Twist(0.0, -0.6),
    Twist(-0.15, 0.0),
    Twist(0.2, 0.0),
    Twist(0.15, 0.5),
    Twist(0.15, -0.5),
    Twist(-0.1, 0.4),
    Twist(-0.1, -0.4),
)
WHIM = 0.08
"""How often a driver on the way to a place does something else for a moment."""
THERE_M = 0.5
"""A place is reached this close to it."""


@dataclass(frozen=True, slots=True)
class Wish:
    """What the driver asks for now. `deadman` released asks for nothing."""

    twist: Twist = STILL
    deadman: bool = True

    @property
    def finite(self) -> bool:
        return math.isfinite(self.twist.v) and math.isfinite(self.twist.w)

    @property
    def motion(self) -> bool:
        """Whether a robot that did nothing at all would disappoint."""
        return self.deadman and self.finite and (abs(self.twist.v) >= 0.03 or abs(self.twist.w) >= 0.1)


class RandomDriver:
    """Decides anew every half to three seconds; `to_places` drives to places of the ground by steering."""

    def __init__(self, ground: Ground, seed: int, style: Style, settings: DriveSettings) -> None:
        self.style = style
        self._ground = ground
        self._rng = np.random.default_rng([seed, 2])
        self._settings = settings
        self._wish = Wish()
        self._until_s = 0.0
        self._moved_s, self._moved = 0.0, Pose2()
        self._place = self._next_place()
        self._course: float | None = None
        self._steering = False
        """Towards the place, decided with each scan; otherwise the wish stands until it has lasted."""
        self._try: int | None = None

    @property
    def to_places(self) -> bool:
        return self.style.endswith("places")

    def step(self, now_s: float, pose: Pose2, points: NDArray[np.float64]) -> Wish:
        """The wish at an instant; call whenever there is a new scan. `points` (n, 2) are in the base frame."""
        away = math.hypot(pose.x - self._moved.x, pose.y - self._moved.y)
        turned = abs(wrap(pose.yaw - self._moved.yaw))
        if away > MOVED_M or turned > MOVED_RAD or not self._wish.motion:
            self._moved_s, self._moved = now_s, pose
        if now_s >= self._until_s:
            self._decide(now_s)
        if self._steering:
            self._wish = Wish(self._towards_place(pose, points))
        return self._wish

    def _decide(self, now_s: float) -> None:
        rng = self._rng
        if now_s - self._moved_s > IMPATIENT_S:
            self._try = int(rng.integers(len(TRIES))) if self._try is None else (self._try + 1) % len(TRIES)
            self._wish, self._steering = Wish(TRIES[self._try]), False
            self._until_s = now_s + TRY_S
            return
        self._try = None
        self._until_s = now_s + float(rng.uniform(*HOLD_S))
        self._steering = self.to_places and rng.random() > WHIM
        if not self._steering:
            self._wish = Wish(self._any_twist(), deadman=rng.random() > 0.03)

    def _any_twist(self) -> Twist:
        rng = self._rng
        kind = rng.choice(6, p=(0.34, 0.26, 0.14, 0.16, 0.06, 0.04))
        if kind == 0:
            return Twist(float(rng.uniform(0.1, 0.7)), float(rng.normal(0.0, 0.05)))
        if kind == 1:
            return Twist(float(rng.uniform(0.1, 0.6)), float(rng.uniform(-0.9, 0.9)))
        if kind == 2:
            return Twist(0.0, float(rng.uniform(-1.2, 1.2)))
        if kind == 3:
            return Twist(-float(rng.uniform(0.05, 0.5)), float(rng.uniform(-0.4, 0.4)))
        if kind == 4:
            return Twist(float(rng.choice(WILD)), float(rng.choice(WILD)))
        return STILL

    def _towards_place(self, pose: Pose2, points: NDArray[np.float64]) -> Twist:
        """As the controller drives: steer to the free heading nearest to the way's, turn where there is none."""
        aim, left_m = self._ground.aim(ROBOT_WAY_M, (pose.x, pose.y), self._place)
        if left_m < THERE_M or not math.isfinite(left_m):
            self._place = self._next_place()
            return Twist(0.0, 0.4)
        wanted = wrap(math.atan2(aim[1] - pose.y, aim[0] - pose.x) - pose.yaw)
        previous = None if self._course is None else wrap(self._course - pose.yaw)
        heading = choose_heading(self._settings.steering, wanted, points, previous)
        if heading is None:
            self._course = None
            return Twist(0.0, math.copysign(0.4, wanted)) if abs(wanted) > 0.3 else Twist(0.2, 0.0)
        self._course = wrap(heading + pose.yaw)
        return drive_towards(self._settings, heading, STILL)

    def _next_place(self) -> tuple[float, float]:
        x, y = self._ground.places[self._rng.integers(len(self._ground.places))]
        return float(x), float(y)
