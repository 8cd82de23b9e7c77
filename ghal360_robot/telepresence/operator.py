"""The robot's end of the page: starts its process, takes in what the driver does, tells it what the robot does.

Nothing here waits for the process: what it does not fetch is dropped, and where it dies it is started again while
the robot stands still.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ghal360_robot.errors import GhalError
from ghal360_robot.messages import Bookmark, Cue, HeadPose, Lease, Lock, OperatorInput, Received, Twist
from ghal360_robot.telepresence import link
from ghal360_robot.telepresence.access import in_address
from ghal360_robot.telepresence.state import Watch, scan, state

if TYPE_CHECKING:
    from types import TracebackType

    from drivers.theta_v.codec.access_units import AccessUnit
    from ghal360_robot.messages import Applied, Decision, Inputs
    from ghal360_robot.robot import Robot
    from ghal360_robot.telepresence.settings import PageSettings

RATE_HZ = 20.0
"""How often a page reports, at least."""

START_S = 20.0
"""Python and its libraries take one second; ten times that, and as much again, on a busy small computer."""

END_S = 5.0
AGAIN_S = 1.0
"""Between the end of a process and the start of the next."""

LOOK_S = 0.02
STATE_NS = 50_000_000
SCAN_NS = 120_000_000
"""A ring on the horizon needs no more than eight scans a second."""

MAX_LINES = 100
"""Taken in before the event loop is let go: half a second's worth of one driver."""

logger = logging.getLogger(__name__)
said = logging.getLogger("ghal360_robot.telepresence")


class PageError(GhalError):
    """The page cannot be served."""


class PageOperator:
    """`async with PageOperator(settings) as page:` serves it; then it is the robot's operator."""

    rate_hz = RATE_HZ

    def __init__(self, settings: PageSettings) -> None:
        self.settings = settings
        self.port = 0
        self.restarts = 0
        self._process: asyncio.subprocess.Process | None = None
        self._reader: asyncio.StreamReader
        self._writer: asyncio.StreamWriter
        self._tap: link.VideoTap | None = None

    @property
    def url(self) -> str:
        """Where the page is, as seen from this machine."""
        s = self.settings
        host = "127.0.0.1" if s.listen in {"0.0.0.0", "::"} else s.listen  # noqa: S104 - compared with, not bound to
        return f"{'https' if s.tls else 'http'}://{in_address(host)}:{self.port}/"

    @property
    def pid(self) -> int | None:
        return None if self._process is None else self._process.pid

    async def __aenter__(self) -> PageOperator:
        await self._start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._end()

    def offer(self, unit: AccessUnit) -> None:
        """One access unit, on the camera's thread; returns at once."""
        tap = self._tap
        if tap is not None:
            tap.offer(unit)

    async def run(self, robot: Robot) -> None:
        """Until cancelled; a process that dies is started again."""
        while True:
            works = (self._listen(robot), self._tell(robot))
            tasks = {asyncio.create_task(work, name="page") for work in works}
            try:
                done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in tasks:
                    task.cancel()
                robot.board.put_lease(None)
            failed = next((task.exception() for task in done if task.exception()), None)
            why = f"the page failed: {failed!r}" if failed else "the page's process has ended"
            logger.error("%s; the robot stands still while it is started again", why)
            await self._end()
            self.restarts += 1
            await self._start_again()

    async def _start_again(self) -> None:
        while True:
            await asyncio.sleep(AGAIN_S)
            try:
                await self._start()
            except GhalError as error:
                logger.error("%s", error)  # noqa: TRY400 - its sentence says it all
            else:
                return

    async def _start(self) -> None:
        ours, theirs = socket.socketpair()
        video, theirs_video = socket.socketpair()
        try:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "ghal360_robot.telepresence.page_process",
                str(theirs.fileno()),
                str(theirs_video.fileno()),
                pass_fds=(theirs.fileno(), theirs_video.fileno()),
                stdin=asyncio.subprocess.DEVNULL,
                process_group=0,  # Ctrl-C is the robot's to handle
                env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
        finally:
            theirs.close()
            theirs_video.close()
        self._reader, self._writer = await asyncio.open_connection(sock=ours, limit=link.MAX_LINE_BYTES)
        # Started again, it listens where pages look for it.
        link.send(self._writer, "settings", replace(self.settings, port=self.port or self.settings.port))
        try:
            self.port = await asyncio.wait_for(self._started(), START_S)
        except BaseException as error:
            video.close()
            await self._end()
            if isinstance(error, TimeoutError):
                raise PageError(f"the page's process was not ready within {START_S:g} s") from error
            raise
        self._tap = link.VideoTap(video)

    async def _started(self) -> int:
        first = await link.receive(self._reader)
        if first is None:
            raise PageError("the page's process ended before it was ready; its own error is above")
        kind, value = first
        if kind != "listening":
            raise PageError(str(value))
        return int(value)

    async def _end(self) -> None:
        tap, self._tap = self._tap, None
        if tap is not None:
            tap.close()
        self._writer.close()
        with contextlib.suppress(ConnectionError):
            await self._writer.wait_closed()
        process, self._process = self._process, None
        if process is None:
            return
        try:
            await asyncio.wait_for(process.wait(), END_S)
        except TimeoutError:
            logger.warning("the page's process did not end by itself and is killed")
            process.kill()
            await process.wait()

    async def _listen(self, robot: Robot) -> None:
        """What the page's process says, until it is gone."""
        lines = 0
        while (line := await link.receive(self._reader)) is not None:
            try:
                self._take(robot, *line)
            except (TypeError, KeyError, ValueError) as error:
                logger.error("the page's process said %.80r, which makes no sense: %s", line, error)  # noqa: TRY400
            lines += 1
            if lines % MAX_LINES == 0:
                await asyncio.sleep(0)

    def _take(self, robot: Robot, kind: str, value: Any) -> None:
        board = robot.board
        match kind:
            case "operator":
                robot.take_operator(_operator(value))
            case "received":
                robot.recorder.received(Received(**value))
            case "lease":
                board.put_lease(None if value is None else Lease(**value))
            case "lock":
                board.put_lock(Lock(**value))
            case "stop":
                (board.estop if value == "estop" else board.stop)()
            case "bookmark":
                robot.bookmark(Bookmark(**value))
            case "log":
                level, text = value
                said.log(level if level in {logging.INFO, logging.WARNING} else logging.ERROR, "%s", text)
            case _:
                raise ValueError("unknown kind")

    async def _tell(self, robot: Robot) -> None:
        """State at 20 Hz and at once when cue or arming change, and the scans."""
        sent_ns = scanned_ns = cue_ns = 0
        watch, before = Watch(), (Cue.NONE, "")
        while True:
            newest = robot.loop.newest
            if newest is not None:
                inputs, decision, applied = newest
                now = (decision.cue, applied.arm.value)
                if now[0] is not before[0]:
                    cue_ns = inputs.stamp_ns
                if now != before or inputs.stamp_ns - sent_ns >= STATE_NS:
                    watch = watch.step(robot.loop.safety_state.memory.people, inputs.stamp_ns)
                    self._say_state(robot, newest, watch, cue_ns)
                    sent_ns, before = inputs.stamp_ns, now
                around = inputs.surroundings
                if around is not None and around.stamp_ns - scanned_ns >= SCAN_NS:
                    scanned_ns = around.stamp_ns
                    link.send(self._writer, "scan", scan(around))
            await asyncio.sleep(LOOK_S)

    def _say_state(self, robot: Robot, newest: tuple[Inputs, Decision, Applied], watch: Watch, cue_ns: int) -> None:
        inputs, decision, applied = newest
        told = state(
            inputs,
            decision,
            applied,
            blockers=robot.not_ready(),
            links=robot.links(),
            found=robot.found.is_set(),
            cue_ns=cue_ns,
            target=self.settings.target,
            approaching=() if inputs.base is None else watch.approaching(inputs.base.pose),
        )
        link.send(self._writer, "state", told)


def _operator(value: dict[str, Any]) -> OperatorInput:
    stick = value["stick"]
    return OperatorInput(
        **{**value, "head": HeadPose(**value["head"]), "stick": None if stick is None else Twist(**stick)}
    )
