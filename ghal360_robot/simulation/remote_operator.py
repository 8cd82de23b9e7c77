"""The virtual operator as the robot knows them: messages that arrive, and a page to keep informed."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from ghal360_robot.messages import ArmState
from ghal360_robot.simulation.operator_desk import PageStatus
from ghal360_robot.simulation.virtual_operator import RATE_HZ

if TYPE_CHECKING:
    from ghal360_robot.messages import OperatorInput
    from ghal360_robot.robot import Robot
    from ghal360_robot.simulation.session import SimulatedHardware

STATUS_S = 0.05


class RemoteOperator:
    """Connects the robot to the operator at the other end of the simulation's link."""

    rate_hz = RATE_HZ

    def __init__(self, hardware: SimulatedHardware) -> None:
        self._hardware = hardware

    async def run(self, robot: Robot) -> None:
        def arrived(message: OperatorInput) -> None:
            # An operator's clock is not the robot's: what counts is when the message was here.
            message = replace(message, stamp_ns=time.monotonic_ns())
            robot.take_operator(message)

        self._hardware.on_operator = arrived
        try:
            while True:
                self._hardware.tell_operator(self._status(robot))
                await asyncio.sleep(STATUS_S)
        finally:
            self._hardware.on_operator = None

    @staticmethod
    def _status(robot: Robot) -> PageStatus:
        newest = robot.loop.newest
        if newest is None:
            return PageStatus()
        _, decision, applied = newest
        blocked = robot.not_ready()
        trouble = any(link.link != "streaming" for link in robot.links().values())
        return PageStatus(decision.cue.value, applied.arm is ArmState.ARMED, not blocked, trouble)
