"""One session of the robot service from the command line: signals, status line, summary."""

from __future__ import annotations

import asyncio
import json
import logging
import signal
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.logging import RichHandler

from ghal360_robot.cli.status import status
from ghal360_robot.config import with_overrides
from ghal360_robot.robot import Robot
from ghal360_robot.simulation.remote_operator import RemoteOperator
from ghal360_robot.simulation.session import SimulatedHardware

if TYPE_CHECKING:
    from ghal360_robot.config import RobotConfig
    from ghal360_robot.journal import RunReport
    from ghal360_robot.simulation.link import Scenario

STATUS_HZ = 4
AFTER_FOUND_S = 1.0
"""A second of standing in front of what was found, so that the recording shows it."""


@dataclass(frozen=True, slots=True)
class Session:
    """What to run and when to stop."""

    config: RobotConfig
    scenario: Scenario | None
    """Simulated devices instead of the configured ones."""
    virtual_operator: bool
    duration_s: float | None
    until_found: bool
    record_to: Path
    quiet: bool
    """Nothing on the terminal but the last line."""


def run_session(session: Session) -> RunReport:
    """Run to the end of the session, by duration, by "found", or by SIGTERM and Ctrl-C. Raises GhalError."""
    console = Console(stderr=True)
    level = logging.WARNING if session.quiet else logging.INFO
    handler = RichHandler(level, console, show_path=False, markup=False, rich_tracebacks=False)
    logging.basicConfig(level=logging.INFO, format="%(message)s", handlers=[handler])
    return asyncio.run(_run(session, console))


async def _run(session: Session, console: Console) -> RunReport:
    stop = asyncio.Event()
    running = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        running.add_signal_handler(number, stop.set)
    async with AsyncExitStack() as stack:
        config, operator, hardware = session.config, None, None
        if session.scenario is not None:
            if not session.quiet:
                console.print(f"simulating the {session.scenario.world}, seed {session.scenario.seed} ...")
            hardware = await stack.enter_async_context(SimulatedHardware(session.scenario))
            config = simulated(config, hardware)
            if session.virtual_operator:
                operator = RemoteOperator(hardware)
        robot = Robot(config, operator, session.record_to)
        if hardware is not None:
            hardware.record_into(robot)
        watching = asyncio.create_task(_watch(session, robot, stop, console))
        try:
            report = await robot.run(stop)
        finally:
            watching.cancel()
            await asyncio.wait({watching})
            if not watching.cancelled():
                watching.result()
        return report if hardware is None else replace(report, simulation=hardware.summary())


def simulated(config: RobotConfig, hardware: SimulatedHardware) -> RobotConfig:
    """The same robot with its three devices at the simulated hardware's ports."""
    ports = hardware.endpoints
    return with_overrides(
        config,
        {
            "theta": {
                "transport": "usbip",
                "host": "127.0.0.1",
                "port": ports.theta,
                "serial": "",
                "rate_hz": hardware.scenario.camera_hz,
            },
            "tim571": {"host": "127.0.0.1", "port": ports.tim571},
            "rmp110": {"interface": "socketcand", "channel": "can0", "host": "127.0.0.1", "port": ports.rmp110},
        },
    )


async def _watch(session: Session, robot: Robot, stop: asyncio.Event, console: Console) -> None:
    """The status line, and the two reasons to stop that are not signals."""
    await robot.started.wait()
    began_s = time.monotonic()
    live = Live(console=console, refresh_per_second=STATUS_HZ, transient=True)
    found_s: float | None = None
    with live if not session.quiet and console.is_terminal else _NoLive():
        while not stop.is_set():
            seconds = time.monotonic() - began_s
            if robot.found.is_set() and found_s is None:
                found_s = seconds
            late = session.duration_s is not None and seconds >= session.duration_s
            if late or (session.until_found and found_s is not None and seconds >= found_s + AFTER_FOUND_S):
                stop.set()
            target = session.config.perception.target
            live.update(status(robot.loop.newest, robot.links(), robot.loop.lateness, target, seconds))
            await asyncio.sleep(1.0 / STATUS_HZ)


class _NoLive:
    """Stands in for the status line where there is no terminal to draw it on."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, *_: object) -> None:
        return None


def print_json(report: RunReport) -> None:
    """The contract: one JSON object on the last line of stdout."""
    print(json.dumps(report.to_json()))
