"""One session of the robot service from the command line: signals, status line, ends, summary."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import signal
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from ghal360_robot.cli.status import status
from ghal360_robot.cli.terminal import log_lines, status_line
from ghal360_robot.config import with_overrides
from ghal360_robot.messages import Bookmark
from ghal360_robot.robot import Operator, Robot
from ghal360_robot.simulation.remote_operator import RemoteOperator
from ghal360_robot.simulation.session import SimulatedHardware, SimulationError
from ghal360_robot.telepresence.operator import PageOperator
from ghal360_robot.telepresence.settings import PageSettings

if TYPE_CHECKING:
    from ghal360_robot.config import RobotConfig
    from ghal360_robot.journal import RunReport
    from ghal360_robot.simulation.link import Scenario

AFTER_FOUND_S = 1.0
"""A second of standing in front of what was found, so that the recording shows it."""

WATCH_S = 0.1


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
    """Nothing on the terminal but warnings and the last line."""
    page: bool = False
    """Whether the driver sits at the telepresence page."""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a session ended."""

    report: RunReport
    interrupted: bool
    """By SIGTERM or Ctrl-C, not by its own rules."""


def run_session(session: Session) -> Ended:
    """Run to the end of the session, by duration, by "found", or by SIGTERM and Ctrl-C. Raises GhalError."""
    console = Console(stderr=True)
    with log_lines(console, logging.WARNING if session.quiet else logging.INFO):
        return asyncio.run(_run(session, console))


async def _run(session: Session, console: Console) -> Ended:
    stop, interrupted = asyncio.Event(), asyncio.Event()

    def interrupt() -> None:
        interrupted.set()
        stop.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, interrupt)
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)  # until there is something to mark: by default it ends the process
    async with AsyncExitStack() as stack:
        config, hardware = session.config, None
        operator: Operator | None = None
        if session.scenario is not None:
            if not session.quiet:
                console.print(f"simulating the {session.scenario.world}, seed {session.scenario.seed} ...")
            hardware = await stack.enter_async_context(SimulatedHardware(session.scenario))
            config = simulated(config, hardware)
            if session.virtual_operator:
                operator = RemoteOperator(hardware)
        page = await stack.enter_async_context(PageOperator(PageSettings.of(config))) if session.page else None
        if page is not None:
            console.print(f"the page is at {page.url}", highlight=False, soft_wrap=True)
        robot = Robot(config, page or operator, session.record_to, None if page is None else page.offer)
        if hardware is not None:
            hardware.record_into(robot)
        asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, _bookmark, robot)
        watching = asyncio.create_task(_watch(session, robot, hardware, stop, console), name="watch")
        watching.add_done_callback(lambda _: stop.set())
        try:
            report = await robot.run(stop)
        finally:
            watching.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await watching
        if hardware is not None:
            report = replace(report, simulation=hardware.summary())
        return Ended(report, interrupted.is_set())


def _bookmark(robot: Robot) -> None:
    robot.bookmark(Bookmark(time.monotonic_ns(), "SIGUSR1"))


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


async def _watch(
    session: Session, robot: Robot, hardware: SimulatedHardware | None, stop: asyncio.Event, console: Console
) -> None:
    """The status line, and the reasons to stop that are not signals. Raises SimulationError."""
    await robot.started.wait()
    began_s = time.monotonic()
    found_s: float | None = None
    target = session.config.perception.target

    def picture() -> Table:
        seconds = time.monotonic() - began_s
        missing = robot.recorder.stats.not_recorded
        return status(robot.loop.newest, robot.links(), robot.loop.lateness, target, seconds, missing)

    with status_line(Console(quiet=True) if session.quiet else console, picture):
        while not stop.is_set():
            seconds = time.monotonic() - began_s
            if robot.found.is_set() and found_s is None:
                found_s = seconds
            late = session.duration_s is not None and seconds >= session.duration_s
            if late or (session.until_found and found_s is not None and seconds >= found_s + AFTER_FOUND_S):
                return
            if hardware is not None and hardware.gone.is_set():
                raise SimulationError("the simulated hardware ended in the middle of the run")
            await asyncio.sleep(WATCH_S)


def print_json(report: RunReport) -> None:
    """The contract: one JSON object on the last line of stdout."""
    print(json.dumps(report.to_json()))
