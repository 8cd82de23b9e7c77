"""The robot's end of the live view: feeds a server process over a pipe, and never waits for it.

Rerun's own server can block whoever logs, and grow without bound behind a slow viewer (fact sheet rerun_and_style,
A3). So it lives in a process of its own, which may be slow, stuck or dead: what its pipe does not take waits in a
bounded queue, which drops whole groups of pictures.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from collections import deque
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from ghal360_robot.logbook import entities
from ghal360_robot.logbook.encoding import identified, to_bytes
from ghal360_robot.logbook.mailbox import Mailbox

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]

    from ghal360_robot.logbook.settings import LiveSettings
    from ghal360_robot.logbook.statics import Run
    from ghal360_robot.logbook.table import Table

LENGTH = struct.Struct("<I")

# Two seconds of everything at the camera's highest 2K rate: what is older is no live view any more.
QUEUE_BYTES = 12 << 20
QUEUE_ENTRIES = 4000
ENTRY_BYTES = 500

# A server that dies is started again, at first soon, then ever more rarely.
FIRST_RESTART_S, LAST_RESTART_S = 1.0, 30.0
# One that has lived so long was well: its death starts the waiting times anew.
WELL_S = 60.0

WAIT_S = 0.2
KILLED_S = 0.5
SAID_LINES = 5

SAYS = "live view: "
"""What the server has to say to people begins with this; anything else is Rerun's own chatter."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class LiveStats:
    """How the live view is doing."""

    up: bool
    sent: int
    """Batches that went into the server's pipe."""
    dropped_video: int
    """Batches of pictures that the server did not take in time."""
    dropped_rest: int
    restarts: int
    said: str
    """The server's last word."""


@dataclass(frozen=True, slots=True)
class _Parcel:
    data: bytes
    video: bool
    keyframe: bool

    @property
    def weight(self) -> int:
        return len(self.data) + ENTRY_BYTES


class LiveFeed:
    """Starts the server, feeds it from a thread of its own, starts it again when it dies."""

    def __init__(self, settings: LiveSettings, run: Run) -> None:
        self._hello = json.dumps({"settings": asdict(settings), "run": asdict(run)}).encode()
        self._mailbox: Mailbox[_Parcel] = Mailbox(QUEUE_BYTES, QUEUE_ENTRIES)
        self._thread = threading.Thread(target=self._run, name="live-feed", daemon=True)
        self._closed = threading.Event()
        self._waiting = threading.Event()
        self._anew = False
        self._server: subprocess.Popen[bytes] | None = None
        self._said: deque[str] = deque(maxlen=SAID_LINES)
        self._heard = b""
        self._dropped_rest = 0
        self.sent = 0
        self.starts = 0

    def start(self) -> None:
        self._thread.start()

    def offer(self, table: Table, batch: pa.RecordBatch) -> None:
        """Queue a batch for whoever watches; dropped while there is no server, or where it is too slow."""
        if self._server is None or self._closed.is_set():
            return
        video = table is entities.THETA_VIDEO
        keyframe = video and batch.column(batch.schema.names.index(entities.KEYFRAME_COLUMN))[0].is_valid
        self._mailbox.put(_Parcel(to_bytes(identified(batch)), video, keyframe))
        self._waiting.set()

    def wants_everything_anew(self) -> bool:
        """Whether viewers lack what is only logged on change: asked once, told once."""
        dropped = self._mailbox.dropped_rest
        anew = self._anew or dropped > self._dropped_rest
        self._anew, self._dropped_rest = False, dropped
        return anew

    def stats(self) -> LiveStats:
        mailbox = self._mailbox
        return LiveStats(
            up=self._server is not None,
            sent=self.sent,
            dropped_video=mailbox.dropped_video,
            dropped_rest=mailbox.dropped_rest,
            restarts=max(0, self.starts - 1),
            said=self._said[-1] if self._said else "",
        )

    def abandon(self) -> None:
        """Leave viewers and server behind: nobody waits for them."""
        self._closed.set()
        self._waiting.set()
        server = self._server
        if server is not None:
            _kill(server)

    def join(self, timeout_s: float) -> None:
        """Wait for the thread to have taken in what it abandoned, if there is time for it."""
        if self._thread.is_alive():
            self._thread.join(max(0.0, timeout_s))

    def _run(self) -> None:
        wait_s = FIRST_RESTART_S
        while not self._closed.is_set():
            began_s = time.monotonic()
            try:
                self._serve()
            except OSError as error:
                if str(error):  # a pipe that broke says nothing, and its server has said why
                    self._said.append(str(error))
            if self._closed.is_set():
                return
            if time.monotonic() - began_s > WELL_S:
                wait_s = FIRST_RESTART_S
            logger.warning("the live view has ended (%s); starting again in %.0f s", self._last_word(), wait_s)
            self._closed.wait(wait_s)
            wait_s = min(2 * wait_s, LAST_RESTART_S)

    def _serve(self) -> None:
        """One life of the server. Raises OSError where it cannot be started or has died."""
        self._heard = b""
        server = subprocess.Popen(
            [sys.executable, "-m", "ghal360_robot.logbook.live_server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            bufsize=0,
            start_new_session=True,  # Ctrl-C is for the robot
        )
        if server.stdin is None or server.stdout is None:
            raise OSError("no pipe to the live view's server")
        self.starts += 1
        try:
            for pipe in (server.stdin, server.stdout):
                os.set_blocking(pipe.fileno(), False)
            self._mailbox.start_anew()
            self._anew = True
            self._server = server
            if self._closed.is_set():
                return
            self._write(server, LENGTH.pack(len(self._hello)) + self._hello)
            while not self._closed.is_set():
                self._waiting.clear()
                for parcel in self._mailbox.take(16):
                    self._write(server, LENGTH.pack(len(parcel.data)) + parcel.data)
                    self.sent += 1
                self._listen(server)
                if server.poll() is not None:
                    raise BrokenPipeError
                if not len(self._mailbox):
                    self._waiting.wait(WAIT_S)
        finally:
            self._server = None
            _kill(server)
            with contextlib.suppress(subprocess.TimeoutExpired):
                server.wait(KILLED_S)
            self._listen(server)
            server.stdin.close()
            server.stdout.close()

    def _write(self, server: subprocess.Popen[bytes], data: bytes) -> None:
        """Into the pipe, however long that takes: meanwhile the mailbox drops. Raises OSError when it breaks."""
        left = memoryview(data)
        pipe = server.stdin.fileno() if server.stdin else -1
        while left and not self._closed.is_set():
            try:
                left = left[os.write(pipe, left) :]
            except BlockingIOError:
                select.select([], [pipe], [], WAIT_S)
                self._listen(server)
        if server.poll() is not None:
            raise BrokenPipeError

    def _listen(self, server: subprocess.Popen[bytes]) -> None:
        if server.stdout is None:
            return
        with contextlib.suppress(OSError, ValueError):
            while data := server.stdout.read(4096):
                *lines, self._heard = (self._heard + data).split(b"\n")
                self._heard = self._heard[-4096:]
                for line in lines:
                    self._hear(line.decode(errors="replace").strip())

    def _hear(self, line: str) -> None:
        if line.startswith(SAYS):
            logger.info("%s", line)
            self._said.append(line.removeprefix(SAYS))
        elif "ERROR" in line or "Error" in line:
            self._said.append(line[:200])

    def _last_word(self) -> str:
        return self._said[-1] if self._said else "without a word"


def _kill(server: subprocess.Popen[bytes]) -> None:
    """The server and what it has started: they are a session of their own."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(server.pid, signal.SIGKILL)
