"""The simulated hardware's process: one world, one body, and three devices that speak their own wires.

Started by `session.SimulatedHardware` with the descriptor of a socket pair; ends when that closes. The
devices listen on loopback: the camera behind USB/IP, the lidar behind SOPAS, the base behind socketcand.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import logging
import socket
import sys
import time
from contextlib import AsyncExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, cast

from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.serve import SimulatedRmp, serve
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.usbip_server import UsbIpServer
from drivers.tim571.simulator.behaviour import DeviceSettings
from drivers.tim571.simulator.server import Tim571Simulator
from ghal360_robot.errors import GhalError
from ghal360_robot.messages import Twist
from ghal360_robot.simulation.link import Cut, Endpoints, Scenario, Truth, receive, send
from ghal360_robot.simulation.operator_desk import OperatorDesk, PageStatus
from ghal360_robot.simulation.picture_source import FolderPictureSource, PictureSource, RenderedPictureSource
from ghal360_robot.simulation.plant import Body, move
from ghal360_robot.simulation.view import lidar_view
from ghal360_robot.simulation.world import ROBOT_RADIUS_M, World, build_world

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

logger = logging.getLogger(__name__)

PHYSICS_S = 0.01
"""The base's own control tick."""

TRUTH_S = 0.05
"""Twenty times a second: what a human's eyes need, and a smooth line in the recording."""

BOOT_S = 0.5
"""A real base takes nine seconds from power-on to standby; nobody wants to watch that every time."""


class Devices:
    """The three simulators around one body in one world."""

    def __init__(self, scenario: Scenario, world: World) -> None:
        self.scenario = scenario
        self.world = world
        self.body = Body(world.start)
        self.camera = SimulatedThetaV()
        self.usbip = UsbIpServer(self.camera)
        self.lidar = Tim571Simulator(
            lidar_view(world, lambda: self.body.pose),
            dialect=scenario.lidar_dialect,
            seed=scenario.seed,
            settings=DeviceSettings(startup_s=0.0),
            replay=Path(scenario.lidar_replay) if scenario.lidar_replay else None,
        )
        self.pictures = _picture_source(scenario)
        self.desk = OperatorDesk(world, scenario.seed, time.monotonic_ns()) if scenario.operator else None
        self.base: SimulatedRmp

    async def enter(self, stack: AsyncExitStack) -> Endpoints:
        stack.enter_context(self.usbip)
        await stack.enter_async_context(self.lidar)
        self.base = await stack.enter_async_context(serve(model=RmpModel(time.monotonic_ns(), boot_s=BOOT_S)))
        offer = stack.enter_context(_offering(self.camera, self.scenario.camera_tape))
        self.pictures.on_access_unit(lambda _stamp_ns, unit: offer(unit))
        running = asyncio.get_running_loop()
        self.camera_failed: asyncio.Future[None] = running.create_future()
        self.pictures.on_error(lambda error: running.call_soon_threadsafe(self._fail, error))
        await asyncio.to_thread(stack.enter_context, self.pictures)
        self.pictures.set_pose(self.body.pose)
        return Endpoints(self.usbip.port, self.lidar.port, self.base.port)

    def _fail(self, error: Exception) -> None:
        if not self.camera_failed.done():
            self.camera_failed.set_exception(error)

    async def physics(self) -> None:
        """Move the body as the wheels turn; a wheel against a wall stands still."""
        last_ns = time.monotonic_ns()
        while True:
            await asyncio.sleep(PHYSICS_S)
            now_ns = time.monotonic_ns()
            v, w = self.base.model.twist
            self.body = move(self.world, self.body, Twist(v, w), (now_ns - last_ns) / 1e9, ROBOT_RADIUS_M)
            if self.body.touching and v > 0:
                self.base.model.block()
            else:
                self.base.model.unblock()
            self.pictures.set_pose(self.body.pose)
            last_ns = now_ns

    async def cut(self, cut: Cut) -> None:
        """Unplug one device for a while."""
        await asyncio.sleep(cut.at_s)
        logger.info("%s is unplugged for %g s", cut.device, cut.for_s)
        match cut.device:
            case "theta":
                self.camera.unplug()
                await asyncio.sleep(cut.for_s)
                self.camera.replug()
            case "tim571":
                await self.lidar.unplug()
                await asyncio.sleep(cut.for_s)
                await self.lidar.replug()
            case "rmp110":
                self.base.unplug()
                await asyncio.sleep(cut.for_s)
                self.base.plug()
        logger.info("%s is back", cut.device)


@contextlib.contextmanager
def _offering(camera: SimulatedThetaV, tape_path: str | None) -> Iterator[Callable[[bytes], object]]:
    """Where access units go: into the camera, and what it took onto the tape, if there is one."""
    if tape_path is None:
        yield camera.offer
        return
    with Path(tape_path).open("w", buffering=1, encoding="ascii") as tape:
        yield lambda unit: camera.offer(unit) and tape.write(hashlib.sha256(unit).hexdigest() + "\n")


def _picture_source(scenario: Scenario) -> PictureSource:
    if scenario.camera_images is not None:
        return FolderPictureSource(Path(scenario.camera_images), scenario.camera_hz)
    return RenderedPictureSource(
        scenario.world, scenario.seed, scenario.target, scenario.camera_hz, painted=scenario.painted
    )


async def simulate(link: socket.socket) -> None:
    """One simulation, from its scenario to the end of the link."""
    reader, writer = await asyncio.open_connection(sock=link)
    message = await receive(reader)
    if message is None:
        return
    scenario = Scenario.from_json(message[1])
    async with AsyncExitStack() as stack:
        try:
            world = build_world(scenario.world, scenario.seed, scenario.target)
            devices = Devices(scenario, world)
            endpoints = await devices.enter(stack)
        except (GhalError, ValueError, OSError, ImportError) as error:
            send(writer, "error", str(error))
            await writer.drain()
            return
        send(writer, "endpoints", endpoints)
        try:
            await _live(devices, scenario, reader, writer)
        except GhalError as error:
            send(writer, "error", str(error))
            await writer.drain()


async def _live(
    devices: Devices, scenario: Scenario, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    tasks = {asyncio.create_task(devices.physics()), asyncio.create_task(_tell(devices, writer))}
    tasks |= {asyncio.create_task(devices.cut(cut)) for cut in scenario.cuts}
    listening = asyncio.create_task(_listen(devices, reader, tasks))
    try:
        while not listening.done():
            watched = {listening, devices.camera_failed, *tasks}
            done, _ = await asyncio.wait(watched, return_when=asyncio.FIRST_COMPLETED)
            for ended in done - {listening}:
                ended.result()  # a failed picture source raises here as well
                tasks.discard(cast("asyncio.Task[None]", ended))
    finally:
        for task in (listening, *tasks):
            task.cancel()
        await asyncio.gather(listening, *tasks, return_exceptions=True)


async def _listen(devices: Devices, reader: asyncio.StreamReader, tasks: set[asyncio.Task[None]]) -> None:
    while (message := await receive(reader)) is not None:
        kind, value = message
        if kind == "status" and devices.desk is not None:
            devices.desk.tell(PageStatus(**value), time.monotonic_ns())
        elif kind == "cut":
            tasks.add(asyncio.create_task(devices.cut(Cut(value["device"], 0.0, value["for_s"]))))


async def _tell(devices: Devices, writer: asyncio.StreamWriter) -> None:
    desk = devices.desk
    while True:
        now_ns = time.monotonic_ns()
        if desk is not None:
            send(writer, "operator", desk.step(devices.body.pose, now_ns))
        in_view = None if desk is None else desk.found_in_view
        send(writer, "truth", Truth(now_ns, devices.body, asdict(devices.pictures.statistics()), in_view))
        await writer.drain()
        await asyncio.sleep(TRUTH_S)


def main() -> None:
    logging.basicConfig(level=logging.WARNING, format="simulated hardware: %(message)s")
    link = socket.socket(fileno=int(sys.argv[1]))
    with contextlib.suppress(ConnectionError):  # the robot's process is gone, and so is the reason to go on
        asyncio.run(simulate(link))


if __name__ == "__main__":
    main()
