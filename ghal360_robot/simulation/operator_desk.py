"""Where the virtual operator sits: on the far side of the link, seeing the world's truth as a picture would show it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.messages import Cue
from ghal360_robot.simulation import virtual_operator
from ghal360_robot.simulation.eyes import Eyes, Sight
from ghal360_robot.simulation.virtual_operator import Temper

if TYPE_CHECKING:
    from ghal360_robot.messages import OperatorInput, Pose2
    from ghal360_robot.simulation.world import World

STATUS_LOST_NS = 1_000_000_000
"""A page that hears nothing from the robot for so long says so; nobody presses buttons then."""


@dataclass(frozen=True, slots=True)
class PageStatus:
    """What the robot tells the operator's page."""

    cue: str = Cue.NONE.value
    armed: bool = False
    ready: bool = False
    trouble: bool = True


class OperatorDesk:
    """One virtual operator in front of one robot. `step` is called at the page's rate."""

    def __init__(self, world: World, seed: int, now_ns: int = 0) -> None:
        self._eyes = Eyes(world)
        self._state = virtual_operator.start(Temper(seed=seed), world.start, now_ns)
        self._status = PageStatus()
        self._heard_ns = now_ns
        self._head_yaw = 0.0
        self._found = 0
        self.found_in_view: bool | None = None
        """Whether the target really was in view when the operator pressed "found"; None before."""

    def tell(self, status: PageStatus, now_ns: int) -> None:
        """News from the robot."""
        self._status = status
        self._heard_ns = now_ns

    def step(self, pose: Pose2, now_ns: int) -> OperatorInput:
        """Look at the picture taken from `pose`, act, and say what the page sends."""
        status = self._status
        marked = status.cue == Cue.CONFIRM.value
        view = self._eyes.look(pose, self._head_yaw, self._state.temper.fov, marked=marked)
        silent = now_ns - self._heard_ns > STATUS_LOST_NS
        sight = Sight(view, Cue(status.cue), status.armed, status.ready, status.trouble or silent)
        self._state, message = virtual_operator.step(self._state, sight, now_ns)
        self._head_yaw = message.head.yaw
        if message.found_presses > self._found:
            self._found = message.found_presses
            self.found_in_view = view.target_yaw is not None
        return message
