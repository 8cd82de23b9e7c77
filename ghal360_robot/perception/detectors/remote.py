"""A network in a process of its own: it shares neither interpreter nor fate with the control loop.

On two cores a network on a thread of the robot's process costs the loop tens of milliseconds at a time: every layer
of it asks for the interpreter. Pictures go over in shared memory, everything else over a pair of sockets.
"""

from __future__ import annotations

import contextlib
import logging
import mmap
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.perception.detectors.base import DETECTORS, Detector, DetectorOptions, make_detector
from ghal360_robot.perception.detectors.errors import DetectorError
from ghal360_robot.perception.detectors.letterbox import checked

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from ghal360_robot.perception.detectors.base import PixelDetection

    Picture = NDArray[np.uint8]

MAX_BYTES = 3840 * 2160 * 3
"""The camera's largest picture is 3840 x 1920; memory that no picture has used costs nothing."""
START_S = 60.0
"""torch takes 2 s to import, and 20 s from a cold card; three times that is a failure."""
ANSWER_S = 60.0
"""YOLOv3 on a weak single core takes 10 s for a panorama; a process that is silent for longer is stuck."""
RESTART_S = 5.0
"""From one start to the next: a process that dies at once is not started all the time."""
END_S = 2.0
"""The process ends by itself when its socket closes, after the picture it is at."""

PROCESS = "ghal360_robot.perception.detectors.remote_process"
CLOSED = "The detector was closed."

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Order:
    """What the process is to run."""

    name: str
    options: DetectorOptions


@dataclass(frozen=True, slots=True)
class Ready:
    """Its first answer."""

    name: str
    class_names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Search:
    """Search the picture (height, width, 3) in the shared memory; without any size: warm up."""

    height: int = 0
    width: int = 0


class DetectorDiedError(DetectorError):
    """The process that runs the network ended, or no longer answers."""


class RemoteDetector:
    """A detector by name, in its own process; `close` ends it. Used by one thread at a time, closed by any.

    Raises what the network's own loading raises: UsageError, DetectorError, WeightsError.
    """

    def __init__(self, name: str, options: DetectorOptions, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._order = Order(name, options)
        self._clock_s = clock_s
        self._lock = threading.Lock()
        self._closed = False
        self._fd = os.memfd_create("ghal360-picture")
        os.ftruncate(self._fd, MAX_BYTES)
        self._memory = np.frombuffer(mmap.mmap(self._fd, MAX_BYTES), np.uint8)
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self._link: Connection | None = None
        self._started_s = clock_s()
        self._why = ""
        try:
            ready = self._start()
        except BaseException:
            self.close()
            raise
        self.name, self.class_names = ready.name, ready.class_names

    @property
    def pid(self) -> int | None:
        """Of the process; None while there is none."""
        return None if self._process is None else self._process.pid

    def warm_up(self) -> None:
        """Let the network search one grey panorama. Raises DetectorError."""
        self._ask(Search(), ANSWER_S)

    def detect(self, rgb: Picture) -> list[PixelDetection]:
        """Objects in a picture (height, width, 3).

        A process that died is started again, at most every RESTART_S. Raises PictureError, DetectorError.
        """
        checked(rgb)
        if rgb.nbytes > MAX_BYTES:
            raise DetectorError(f"A picture of {rgb.shape[1]} x {rgb.shape[0]} is larger than any of the camera's.")
        if self._process is None:
            self._start_again()
        np.copyto(self._memory[: rgb.nbytes].reshape(rgb.shape), rgb)
        found: list[PixelDetection] = self._ask(Search(*rgb.shape[:2]), ANSWER_S)
        return found

    def close(self) -> None:
        """End the process; an answer that somebody waits for does not come any more."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._end(END_S)
            os.close(self._fd)

    def _start_again(self) -> None:
        with self._lock:
            if self._closed or self._clock_s() - self._started_s < RESTART_S:
                raise DetectorDiedError(self._why)
        self._start()
        log.warning("The detector %r is there again.", self._order.name)

    def _start(self) -> Ready:
        with self._lock:
            if self._closed:
                raise DetectorDiedError(CLOSED)
            ours, theirs = socket.socketpair()
            self._started_s = self._clock_s()
            # In the robot's own session: only there do nice values count between the two (sched(7), autogroup).
            self._process = subprocess.Popen(  # noqa: S603 - our own module
                [sys.executable, "-m", PROCESS, str(theirs.fileno()), str(self._fd)],
                pass_fds=(theirs.fileno(), self._fd),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )
            theirs.close()
            self._socket, self._link = ours, Connection(ours.dup().detach())
        ready: Ready = self._ask(self._order, START_S)
        return ready

    def _ask(self, question: Order | Search, timeout_s: float) -> Any:
        link = self._link
        if link is None:
            raise DetectorDiedError(self._why)
        with contextlib.suppress(OSError):  # a process that is gone is noticed by its missing answer
            link.send(question)
        return self._answer(timeout_s)

    def _answer(self, timeout_s: float) -> Any:
        """What the process sends, raised where it is an error."""
        link = self._link
        try:
            answer = link.recv() if link is not None and link.poll(timeout_s) else None
        except (EOFError, OSError):
            answer = None
        if answer is None:
            raise self._lost(timeout_s)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _lost(self, timeout_s: float) -> DetectorDiedError:
        """Why there is no answer; whatever is left of the process is ended."""
        with self._lock:
            process = self._process
            if self._closed or process is None:
                return DetectorDiedError(self._why or CLOSED)
            self._end(END_S)
            self._why = (
                f"The process of the detector '{self._order.name}' {_ended(process.returncode, timeout_s)}: nothing is "
                "detected until it has started again, which the robot tries every few seconds."
            )
            return DetectorDiedError(self._why)

    def _end(self, patience_s: float) -> None:
        """With the lock held."""
        if self._socket is not None and self._link is not None:
            with contextlib.suppress(OSError):  # the other end is gone already
                self._socket.shutdown(socket.SHUT_RDWR)  # wakes whoever waits here as well; closing would not
            self._socket.close()
            self._link.close()
            self._socket = self._link = None
        if self._process is not None:
            try:
                self._process.wait(patience_s)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None


def _ended(status: int | None, timeout_s: float) -> str:
    if status == -signal.SIGKILL:
        return f"was killed (out of memory?), or did not answer for {timeout_s:g} s"
    if status is not None and status < 0:
        return f"was ended by {signal.Signals(-status).name}"
    return f"ended by itself with status {status}"


def apart(name: str, options: DetectorOptions) -> Detector:
    """The detector of that name: a network in a process of its own, what needs none as it is."""
    return make_detector(name, options) if name in DETECTORS else RemoteDetector(name, options)
