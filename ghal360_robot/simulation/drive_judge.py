"""Whose fault a contact is, and when a robot that was asked to move stood still without need. Strict on the robot.

A contact is the robot's disc touching a wall, furniture, or a person's body disc. At its first instant it is
- the robot's OWN MOTION, if it touches something that stands still for ever, or if it moves towards the person
  at more than `TOWARDS_MPS` and the lidar had seen the person for longer than the robot needs to tell somebody who
  walks from furniture and to stop, counted from the speed that it had when the person came into sight;
- OUT OF HIDING, if it moves towards the person, who was not in sight for so long (behind a corner, a desk, or in
  the quarter behind the robot where the lidar is blind);
- STEPPED IN, if all of that holds, but at the last instant at which braking helped the person was standing, and had
  both gone on as they did they would not have met: nothing then told them from furniture beside the way;
- WALKED INTO, if it stands, turns on the spot, or moves away.
Whether a person who was walking could be expected there plays no part in that, but is told as `foreseeable`.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.messages import Pose2, Twist
from ghal360_robot.simulation.plant import advance

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from ghal360_robot.simulation.walkers import Crowd, Moving
    from ghal360_robot.simulation.world import World

TOWARDS_MPS = 0.02
"""Slower than this towards somebody is standing."""
SEEN_BEAMS = 2
"""Beams of a scan that have to end on somebody's legs for them to be in sight; one alone may be dust."""
NOTICE_S = 0.3
"""To see that somebody walks, who was not in sight before, takes three scans: two with them elsewhere than in one 0.2 s
older (`safety.people`)."""
SIGHT_LOST_S = 0.25
"""Not seen for so long: out of sight. A leg behind the other, or three scans."""
MEMORY_S = 3.0
"""Longer than the robot needs to stop from any speed that it is allowed."""
STANDING_M, STANDING_S = 0.10, 1.0
"""Who has moved less in so long was standing: four sigma of a range, and what odometry may be out by."""
FORESEEN_M, FORESEEN_S = 0.15, 0.3
"""Going on as they did, both would have come this close, at most so much later."""
PARTED_M = 0.05
"""Who came into contact and is this far away again may come into contact anew."""

STUCK_S = 10.0
STUCK_M, STUCK_RAD = 0.05, math.radians(10.0)
ASKED_SHARE = 0.9
"""The driver asked for motion in this share of the time; drivers lift their finger for a moment."""
SAMPLE_S = 0.2
FREE_S, FREE_STEPS = 1.0, 10
"""A motion is free if for one second nothing comes into its way, people going on as they do."""
FREE_TWISTS = (
    *(Twist(v, w) for v in (0.3, 0.1, -0.1) for w in (0.0, 0.5, -0.5)),
    Twist(0.0, 0.5),
    Twist(0.0, -0.5),
)
WEDGED_SHARE = 0.5
WEDGED_SPARE_M, WEDGED_ALONE_M, CRAWL = 0.10, 1.0, 0.1
"""A robot is wedged if for half of ten seconds it refuses to drive forwards, although at a crawl (m/s) the way
asked for is free with so much room to spare and nobody is near. It may turn."""


class Fault(Enum):
    """What a contact was."""

    OWN_MOTION = "own motion"
    OUT_OF_HIDING = "out of hiding"
    STEPPED_IN = "stepped in"
    WALKED_INTO = "walked into"


@dataclass(frozen=True, slots=True)
class Contact:
    """The first instant of a contact."""

    at_s: float
    fault: Fault
    person: int | None
    """None for what stands still for ever."""
    towards_mps: float
    """Of the robot towards what it touches; negative away from it."""
    person_mps: float
    """Of the person towards the robot."""
    seen_s: float
    """How long the person had been in sight."""
    need_s: float
    """How long the robot needs to notice, react and brake."""
    bearing_deg: float
    """Where it touches, from straight ahead; of what stands only whether ahead (0) or behind (180)."""
    foreseeable: bool = True


@dataclass(frozen=True, slots=True)
class Standstill:
    """Ten seconds without a motion that was asked for; `free` are those that were possible at their end.

    Stuck is a robot that would have let none of them through; one that would is asked for the wrong thing.
    """

    at_s: float
    free: tuple[Twist, ...]


class ContactJudge:
    """Sees every sweep and every step of one drive."""

    def __init__(self, people: int, reaction_s: float, decel: float) -> None:
        self._reaction_s, self._decel = reaction_s, decel
        self._first_s = np.full(people, -math.inf)
        self._last_s = np.full(people, -math.inf)
        self._speed_then = np.zeros(people)
        self._touching = np.zeros(people, bool)
        self._past: deque[tuple[float, Moving, NDArray[np.float64], NDArray[np.float64]]] = deque()
        self._collisions = 0
        self.contacts: list[Contact] = []

    def saw(self, stamp_s: float, beams_on_legs: NDArray[np.intp], speed: float) -> None:
        """A sweep whose last beam is of `stamp_s`; two legs a person, `speed` the robot's."""
        in_sight = beams_on_legs.reshape(-1, 2).sum(axis=1) >= SEEN_BEAMS
        anew = in_sight & (stamp_s - self._last_s > SIGHT_LOST_S)
        self._first_s[anew], self._speed_then[anew] = stamp_s, abs(speed)
        self._last_s[in_sight] = stamp_s

    def touched_solid(self, now_s: float, collisions: int, v: float) -> None:
        """The body's own count of collisions with what stands, and its speed; seen since ever."""
        bearing = 0.0 if v >= 0.0 else 180.0
        for _ in range(collisions - self._collisions):
            self.contacts.append(Contact(now_s, Fault.OWN_MOTION, None, abs(v), 0.0, math.inf, 0.0, bearing))
        self._collisions = collisions

    def look(self, now_s: float, crowd: Crowd, robot: Moving, yaw: float) -> None:
        """Contacts with people at this instant."""
        self._past.append((now_s, robot, crowd.at, crowd.velocity))
        if now_s - self._past[0][0] > MEMORY_S:
            self._past.popleft()
        gaps = crowd.gaps(robot)
        for i in np.flatnonzero((gaps < 0.0) & ~self._touching):
            self.contacts.append(self._contact(now_s, int(i), crowd, robot, yaw))
        self._touching = (gaps < 0.0) | (self._touching & (gaps < PARTED_M))

    def _contact(self, now_s: float, i: int, crowd: Crowd, robot: Moving, yaw: float) -> Contact:
        away_x, away_y = float(crowd.at[i, 0]) - robot.x, float(crowd.at[i, 1]) - robot.y
        far = max(math.hypot(away_x, away_y), 1e-9)
        nx, ny = away_x / far, away_y / far
        towards = robot.vx * nx + robot.vy * ny
        person = -float(crowd.velocity[i, 0] * nx + crowd.velocity[i, 1] * ny)
        in_sight = now_s - self._last_s[i] <= SIGHT_LOST_S
        seen_s = now_s - float(self._first_s[i]) if in_sight else 0.0
        need_s = NOTICE_S + self._reaction_s + float(self._speed_then[i] if in_sight else abs(towards)) / self._decel
        foreseeable, stood = self._before(now_s, i, float(crowd.radius[i]))
        fault = Fault.WALKED_INTO
        if towards > TOWARDS_MPS and seen_s <= need_s:
            fault = Fault.OUT_OF_HIDING
        elif towards > TOWARDS_MPS:
            fault = Fault.STEPPED_IN if stood and not foreseeable else Fault.OWN_MOTION
        bearing = math.degrees(math.remainder(math.atan2(ny, nx) - yaw, math.tau))
        return Contact(now_s, fault, i, towards, person, seen_s, need_s, bearing, foreseeable)

    def _before(self, now_s: float, i: int, radius: float) -> tuple[bool, bool]:
        """At the last instant at which braking helped: whether they would have met, and whether the person stood."""
        for then_s, robot, at, velocity in reversed(self._past):
            left_s = now_s - then_s
            if left_s < self._reaction_s + math.hypot(robot.vx, robot.vy) / self._decel:
                continue  # too late to stop
            later_s = np.linspace(0.0, left_s + FORESEEN_S, 30)
            x = at[i, 0] - robot.x + later_s * (velocity[i, 0] - robot.vx)
            y = at[i, 1] - robot.y + later_s * (velocity[i, 1] - robot.vy)
            met = bool(np.hypot(x, y).min() < radius + robot.radius + FORESEEN_M)
            earlier = next((at for at_s, _, at, _ in self._past if then_s - at_s <= STANDING_S), at)
            return met, math.dist(at[i], earlier[i]) < STANDING_M
        return False, False


class StandstillJudge:
    """Looks for ten seconds in which a robot that was asked to move did not, although it could have."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._samples: deque[tuple[Pose2, bool, bool]] = deque(maxlen=round(STUCK_S / SAMPLE_S) + 1)
        self.stuck: list[Standstill] = []
        self.wedged: list[Standstill] = []

    def sample(
        self,
        now_s: float,
        pose: Pose2,
        asked: Twist | None,
        crowd: Crowd,
        radius: float,
        lets: Callable[[Twist], bool],
    ) -> None:
        """Call every `SAMPLE_S`; `asked` is the motion asked for, None where none was.

        `lets` says whether the robot would let any of a motion through.
        """
        samples = self._samples
        stands = bool(samples) and math.hypot(samples[-1][0].x - pose.x, samples[-1][0].y - pose.y) < STUCK_M / 10
        refused = stands and asked is not None and self._may_crawl(pose, asked, crowd, radius)
        samples.append((pose, asked is not None, refused))
        if len(samples) < (samples.maxlen or 0):
            return
        first = samples[0][0]
        if max(math.hypot(p.x - first.x, p.y - first.y) for p, _, _ in samples) > STUCK_M:
            return
        turned = max(abs(math.remainder(p.yaw - first.yaw, math.tau)) for p, _, _ in samples)
        if turned <= STUCK_RAD and _share(asked for _, asked, _ in samples) >= ASKED_SHARE:
            free = tuple(twist for twist in FREE_TWISTS if self._is_free(pose, twist, crowd, radius))
            if free and not any(map(lets, free)):
                self.stuck.append(Standstill(now_s, free))
            samples.clear()
        elif _share(refused for _, _, refused in samples) >= WEDGED_SHARE:
            self.wedged.append(Standstill(now_s, ()))
            samples.clear()

    def _may_crawl(self, pose: Pose2, asked: Twist, crowd: Crowd, radius: float) -> bool:
        """Whether what is asked is a drive forwards, and free, slowly along the same curve, with nobody near."""
        if asked.v < 0.03 or (np.hypot(*(crowd.at - (pose.x, pose.y)).T) < radius + WEDGED_ALONE_M).any():
            return False
        return self._is_free(pose, Twist(CRAWL, CRAWL * asked.w / asked.v), crowd, radius + WEDGED_SPARE_M)

    def _is_free(self, pose: Pose2, twist: Twist, crowd: Crowd, radius: float) -> bool:
        for k in range(1, FREE_STEPS + 1):
            later_s = FREE_S * k / FREE_STEPS
            there = advance(pose, twist, later_s)
            if twist.v and self._world.clearance(there.x, there.y) < radius:
                return False
            people = crowd.at + crowd.velocity * later_s
            away = np.hypot(people[:, 0] - there.x, people[:, 1] - there.y) - crowd.radius - radius
            if (away < 0.0).any():
                return False
        return True


def _share(values: Iterable[bool]) -> float:
    listed = list(values)
    return sum(listed) / len(listed)
