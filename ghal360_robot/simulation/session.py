"""The robot's handle on its simulated hardware: a process of its own that speaks the three device wires."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import sys
from typing import TYPE_CHECKING, Any

from ghal360_robot.errors import GhalError
from ghal360_robot.messages import Pose2
from ghal360_robot.simulation.ground_map import RESOLUTION_M, in_odometry, occupancy
from ghal360_robot.simulation.link import Endpoints, Scenario, Truth, operator_from_json, receive, send
from ghal360_robot.simulation.world import build_world

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from ghal360_robot.messages import OperatorInput
    from ghal360_robot.robot import Robot
    from ghal360_robot.simulation.operator_desk import PageStatus

logger = logging.getLogger(__name__)

START_S = 60.0
"""Building the world and opening the renderer takes 2 to 5 s on two cores; ten times that is a failure."""

END_S = 5.0
"""The hardware process ends by itself when its link closes; longer than this it is killed."""


MAP_NS = 10_000_000_000
"""How often the recorder is given the map, of which it writes what is new to the part."""


class SimulationError(GhalError):
    """The simulated hardware could not start, or died."""


class SimulatedHardware:
    """`async with SimulatedHardware(scenario) as hardware:` starts the process and waits until it listens.

    Raises SimulationError with the process's own sentence when it cannot start.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.truth: Truth | None = None
        self.gone = asyncio.Event()
        """Set when the process ended although nobody asked it to."""
        self._world = build_world(scenario.world, scenario.seed, scenario.target)
        self._on_truth: Callable[[Truth], None] | None = None
        self.on_operator: Callable[[OperatorInput], None] | None = None
        self._endpoints: Endpoints | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._listening: asyncio.Task[None] | None = None

    @property
    def endpoints(self) -> Endpoints:
        if self._endpoints is None:
            raise SimulationError("the simulated hardware is not running")
        return self._endpoints

    def record_into(self, robot: Robot) -> None:
        """Let the robot's recording have the truth: the map, the target, and where the body really is."""
        world = self._world
        target = world.target_object()
        there = in_odometry(world.start, Pose2(target.x, target.y))
        cells, corner = occupancy(world), in_odometry(world.start, Pose2())
        mapped_ns = -MAP_NS

        def record(truth: Truth) -> None:
            nonlocal mapped_ns
            if not robot.started.is_set():
                return
            if truth.stamp_ns - mapped_ns >= MAP_NS:
                mapped_ns = truth.stamp_ns
                robot.recorder.true_map(truth.stamp_ns, cells, RESOLUTION_M, corner)
            pose = in_odometry(world.start, truth.body.pose)
            robot.recorder.truth(truth.stamp_ns, pose, (there.x, there.y))

        self._on_truth = record

    @property
    def pid(self) -> int | None:
        return None if self._process is None else self._process.pid

    def cut(self, device: str, for_s: float) -> None:
        """Unplug a device now, for `for_s` seconds."""
        if self._writer is not None:
            send(self._writer, "cut", {"device": device, "for_s": for_s})

    def tell_operator(self, status: PageStatus) -> None:
        """What the virtual operator's page shows from now on."""
        if self._writer is not None:
            send(self._writer, "status", status)

    async def __aenter__(self) -> SimulatedHardware:
        ours, theirs = socket.socketpair()
        try:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "ghal360_robot.simulation.hardware",
                str(theirs.fileno()),
                pass_fds=(theirs.fileno(),),
                stdin=asyncio.subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is the robot's to handle: it still needs its devices to stop
            )
        finally:
            theirs.close()
        reader, self._writer = await asyncio.open_connection(sock=ours)
        send(self._writer, "scenario", self.scenario)
        try:
            self._endpoints = await asyncio.wait_for(self._started(reader), START_S)
        except BaseException:
            await self._end()
            raise
        self._listening = asyncio.create_task(self._listen(reader), name="simulation truth")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._end()

    async def _started(self, reader: asyncio.StreamReader) -> Endpoints:
        message = await receive(reader)
        if message is None:
            raise SimulationError("the simulated hardware ended before it was ready; its own error is above")
        kind, value = message
        if kind == "error":
            raise SimulationError(str(value))
        return Endpoints(**value)

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        while (message := await receive(reader)) is not None:
            kind, value = message
            if kind == "truth":
                self.truth = Truth.from_json(value)
                if self._on_truth is not None:
                    self._on_truth(self.truth)
            elif kind == "error":
                logger.error("%s", value)
            elif kind == "operator" and self.on_operator is not None:
                self.on_operator(operator_from_json(value))
        logger.error("the simulated hardware is gone")
        self.gone.set()

    async def _end(self) -> None:
        if self._listening is not None:
            self._listening.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._listening
        if self._writer is not None:
            self._writer.close()
            with contextlib.suppress(ConnectionError):
                await self._writer.wait_closed()
        if self._process is not None:
            try:
                await asyncio.wait_for(self._process.wait(), END_S)
            except TimeoutError:
                logger.warning("the simulated hardware did not end by itself and is killed")
                self._process.kill()
                await self._process.wait()

    def summary(self) -> dict[str, Any]:
        """Truth for the run's report: collisions above all."""
        truth = self.truth
        if truth is None:
            return {"world": self.scenario.world, "seed": self.scenario.seed}
        return {
            "world": self.scenario.world,
            "seed": self.scenario.seed,
            "collisions": truth.body.collisions,
            "target_in_view": truth.target_in_view,
            "distance_m": round(truth.body.distance_m, 2),
            "camera": truth.camera,
        }
