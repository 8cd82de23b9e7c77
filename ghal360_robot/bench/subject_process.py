"""The test stand's hand on the measured process: start it, give orders, hear what it says, end it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

from ghal360_robot.errors import GhalError

if TYPE_CHECKING:
    from types import TracebackType

    from ghal360_robot.bench.subject import Order
    from ghal360_robot.simulation.link import Endpoints

ANSWER_S = 5.0
"""An order is carried out within a turn of the robot's event loop; this is for a very busy computer."""
MAX_SAID = 1000
LAST_WORDS = 3


class SubjectError(GhalError):
    """The measured process did not do what the measurement needs."""


@dataclass(frozen=True, slots=True)
class Said:
    """A reason or warning of the robot, and when it was the robot's."""

    stamp_ns: int
    text: str


class SubjectProcess:
    """`async with SubjectProcess(endpoints, folder) as subject:` runs a robot; leaving kills it, whatever it does."""

    def __init__(self, endpoints: Endpoints, folder: Path) -> None:
        self._endpoints = endpoints
        self._folder = folder
        self.said: list[Said] = []
        self._struck: asyncio.Queue[int] = asyncio.Queue()
        self._process: asyncio.subprocess.Process
        self._hearing: asyncio.Task[None]

    async def __aenter__(self) -> Self:
        with self._complaints.open("wb") as complaints:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "ghal360_robot.bench.subject",
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=complaints,
                start_new_session=True,  # Ctrl-C is the test stand's: it ends this process by its id
            )
        self._hearing = asyncio.create_task(self._hear(), name="hearing the robot")
        self._write(json.dumps({**asdict(self._endpoints), "record_to": str(self._folder)}))
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._hearing.cancel()
        await self._process.wait()

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def alive(self) -> bool:
        return self._process.returncode is None

    async def order(self, order: Order) -> int:
        """Have the order carried out; the instant it was. Raises SubjectError."""
        self._write(order.value)
        answer = asyncio.create_task(self._struck.get())
        await asyncio.wait({answer, self._hearing}, timeout=ANSWER_S, return_when=asyncio.FIRST_COMPLETED)
        if answer.done():
            return answer.result()
        answer.cancel()
        raise SubjectError(f"the robot's process did not carry out '{order}': {self.last_words()}")

    def send_signal(self, number: signal.Signals) -> int:
        """Send a signal; the instant before."""
        stamp_ns = time.monotonic_ns()
        self._process.send_signal(number)
        return stamp_ns

    async def exit_status(self, within_s: float) -> int | None:
        """How the process ended; None where it did not end in time."""
        with contextlib.suppress(TimeoutError):
            return await asyncio.wait_for(self._process.wait(), within_s)
        return None

    def last_words(self) -> str:
        """What it said last, on its pipe or on stderr."""
        lines = self._complaints.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        words = list(dict.fromkeys([*lines[-1:], *(said.text for said in self.said)]))
        return "; ".join(words[-LAST_WORDS:]) or "it said nothing"

    @property
    def _complaints(self) -> Path:
        return self._folder / "stderr.txt"

    def _write(self, line: str) -> None:
        if self._process.stdin is not None and not self._process.stdin.is_closing():
            self._process.stdin.write(line.encode() + b"\n")

    async def _hear(self) -> None:
        assert self._process.stdout is not None  # noqa: S101 - a pipe was asked for
        while line := await self._process.stdout.readline():
            message = json.loads(line)
            if "struck" in message:
                self._struck.put_nowait(message["struck"])
            elif len(self.said) < MAX_SAID:
                self.said.append(Said(message["t"], message["said"]))
