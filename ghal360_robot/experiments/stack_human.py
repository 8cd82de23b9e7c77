"""The paper's human in front of the real stack: one act every two seconds, with a head that takes time to turn.

Stands where `simulation.operator_desk.OperatorDesk` does: it is told what the page shows, sees what a
picture would show, and sends what the page would send.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.angles import wrap
from ghal360_robot.experiments.search import BACK, FORWARD, LOOK_LEFT, LOOK_RIGHT, TICK_S, Options
from ghal360_robot.guidance.egocentric import N_WEDGES, WEDGE_WIDTH, wedge_centre, wedge_of
from ghal360_robot.messages import Cue, HeadPose, OperatorInput, Pose2, Twist
from ghal360_robot.simulation.eyes import Eyes

if TYPE_CHECKING:
    from collections.abc import Callable

    from ghal360_robot.simulation.operator_desk import PageStatus
    from ghal360_robot.simulation.world import World

NS = 1_000_000_000
TURN_RATE = math.radians(60)
REACTION_S = 0.3
SPEED = 0.5
"""m/s forward by stick; back as fast as the robot allows."""
ARM_EVERY_S = 2.0
EAST = 2
"""Yaw 0 looks east, which is wedge 2 of a map whose wedge 0 is north."""


@dataclass(frozen=True, slots=True)
class Shown:
    """What the page shows beside the brain's cue: the planner's arrow, as a world yaw; None without a planner."""

    yaw: float | None = None


class StackHuman:
    """Notices, follows cues and acts at random as in `search`; `planner` is asked for its arrow before each act."""

    def __init__(
        self,
        world: World,
        options: Options,
        seed: int,
        *,
        drives: bool,
        confirm: bool,
        planner: Callable[[Pose2, int], Shown] | None = None,
    ) -> None:
        self._options, self._drives, self._confirm, self._planner = options, drives, confirm, planner
        self._eyes = Eyes(world)
        self._rng = np.random.default_rng([seed, 77])
        self._status: PageStatus | None = None
        self._gaze = -wedge_centre(int(self._rng.integers(8)))
        self._aim = self._gaze
        self._stick: Twist | None = None
        self._act_ns: int | None = None
        self._now_ns = 0
        self._armed_ns: int | None = None
        self._arms = self._founds = 0
        self.found_in_view: bool | None = None
        self.shown_s = {"arrow": 0.0, "planner": 0.0, "nothing": 0.0}

    @property
    def heading(self) -> int:
        """The wedge of a map, clockwise from north (+y), that the human faces."""
        return (wedge_of(-self._aim) + EAST) % N_WEDGES

    def tell(self, status: PageStatus, now_ns: int) -> None:
        """News from the robot."""
        self._status = status

    def step(self, pose: Pose2, now_ns: int) -> OperatorInput:
        """What the page sends now."""
        dt_s, self._now_ns = (now_ns - self._now_ns) / NS, now_ns
        status = self._status
        if status is not None and status.armed:
            if self._act_ns is None:
                self._act_ns = now_ns
            if now_ns >= self._act_ns:
                self._act(pose, Cue(status.cue), now_ns)
                self._act_ns += round(TICK_S * NS)
        elif status is not None and status.ready:
            self._arm(now_ns)
        if self._act_ns is not None and now_ns - (self._act_ns - TICK_S * NS) >= REACTION_S * NS:
            most = TURN_RATE * dt_s
            self._gaze = wrap(self._gaze + max(-most, min(most, wrap(self._aim - self._gaze))))
        head = HeadPose(wrap(self._gaze - pose.yaw), 0.0, math.radians(self._options.fov_deg))
        return OperatorInput(
            now_ns,
            head,
            deadman=status is not None and status.armed,
            stick=self._stick,
            arm_presses=self._arms,
            found_presses=self._founds,
        )

    def _arm(self, now_ns: int) -> None:
        if self._armed_ns is None or now_ns - self._armed_ns >= ARM_EVERY_S * NS:
            self._arms, self._armed_ns = self._arms + 1, now_ns

    def _act(self, pose: Pose2, cue: Cue, now_ns: int) -> None:
        """Look; if the target is not noticed, follow what is shown or do anything."""
        asked = cue is Cue.CONFIRM and self._confirm
        if self._notices(pose, asked=asked):
            self._founds += 1
            self.found_in_view = True
            return
        arrow = {Cue.LEFT: WEDGE_WIDTH, Cue.RIGHT: -WEDGE_WIDTH}.get(cue)
        shown = Shown() if self._planner is None or arrow is not None else self._planner(pose, now_ns)
        self.shown_s["arrow" if arrow is not None else "planner" if shown.yaw is not None else "nothing"] += TICK_S
        obeys = self._rng.random() < self._options.follow
        anything = int(4 * self._rng.random())
        self._stick = Twist() if self._drives else None
        if arrow is not None and obeys:
            # To the middle of the next wedge, as the tables have it.
            self._aim = wrap(-wedge_centre(wedge_of(-self._gaze)) + arrow)
        elif cue is Cue.CONFIRM and obeys:
            pass  # asked for something too far away or hidden: keep looking there
        elif shown.yaw is not None and obeys:
            self._aim = shown.yaw
        elif anything in {LOOK_LEFT, LOOK_RIGHT}:
            self._aim = wrap(self._aim + (WEDGE_WIDTH if anything == LOOK_LEFT else -WEDGE_WIDTH))
        elif self._drives and anything in {FORWARD, BACK}:
            self._stick = self._towards(pose, forward=anything == FORWARD)

    def _towards(self, pose: Pose2, *, forward: bool) -> Twist:
        """Along the view: a base that looks elsewhere has to turn first, which the tables do not know."""
        off = wrap(self._gaze + (0.0 if forward else math.pi) - pose.yaw)
        if abs(off) > math.pi / 2:
            off = wrap(off + math.pi)
            return Twist(-SPEED if abs(off) < WEDGE_WIDTH / 2 else 0.0, off / TICK_S)
        return Twist(SPEED if abs(off) < WEDGE_WIDTH / 2 else 0.0, off / TICK_S)

    def _notices(self, pose: Pose2, *, asked: bool) -> bool:
        options = self._options
        fov = math.radians(options.fov_deg)
        view = self._eyes.look(pose, wrap(self._gaze - pose.yaw), fov, marked=asked)
        if view.target_yaw is None:
            return False
        chance = options.notice_confirmed if asked else options.notice_clear
        return bool(self._rng.random() < chance)
