"""A thread that waits for frames and hands them, stamped and in batches, to the event loop."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Callable

import can

log = logging.getLogger(__name__)

POLL_S = 0.02
"""How long a wait for frames may outlast `stop`."""
JOIN_S = 2.0
"""A reader that is not out of its wait by then hangs in a kernel call and is left behind (it is a daemon)."""
HOLLOW = 100
"""Waits in a row that returned at once and empty-handed: the bus behind them is closed."""
BACKLOG = 8192
"""Frames kept while the loop is busy: about one second of a full 1 Mbit/s bus. The oldest go first."""


class BusReader:
    """Reads `bus` until `stop`; reports the error that ends it instead of raising in the thread.

    Both callbacks run in the event loop that constructed the reader. `overflowed` counts frames that were
    dropped because the loop did not keep up.
    """

    def __init__(
        self,
        bus: can.BusABC,
        on_message: Callable[[int, can.Message], None],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._bus = bus
        self._on_message = on_message
        self._on_error = on_error
        self._loop = asyncio.get_running_loop()
        self._backlog: deque[tuple[int, can.Message]] = deque()
        self._drain_due = False
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rmp110-reader", daemon=True)
        self.overflowed = 0

    def start(self) -> None:
        self._thread.start()

    async def stop(self) -> None:
        """End the thread; nothing is delivered afterwards."""
        self._stop.set()
        if self._thread.ident is not None:
            await asyncio.to_thread(self._thread.join, JOIN_S)

    def _run(self) -> None:
        hollow = 0
        while not self._stop.is_set():
            began = time.monotonic()
            try:
                message = self._bus.recv(POLL_S)
                # Some of python-can's backends answer a closed bus with nothing, at once and for ever.
                hollow = hollow + 1 if message is None and time.monotonic() - began < POLL_S / 10 else 0
                if hollow >= HOLLOW:
                    raise can.CanOperationError("the bus is closed")  # noqa: TRY301 - reported like any other
            except Exception as error:  # noqa: BLE001 - backends raise anything; a dead reader must be reported
                self._call(self._report, error)
                return
            if message is not None:
                self._push(time.monotonic_ns(), message)

    def _push(self, stamp_ns: int, message: can.Message) -> None:
        with self._lock:
            if len(self._backlog) >= BACKLOG:
                self._backlog.popleft()
                self.overflowed += 1
            self._backlog.append((stamp_ns, message))
            due, self._drain_due = self._drain_due, True
        if not due:
            self._call(self._drain)

    def _drain(self) -> None:
        with self._lock:
            batch = list(self._backlog)
            self._backlog.clear()
            self._drain_due = False
        for stamp_ns, message in batch:
            if self._stop.is_set():
                return
            self._on_message(stamp_ns, message)

    def _report(self, error: Exception) -> None:
        if not self._stop.is_set():
            self._on_error(error)

    def _call(self, function: Callable[..., None], *args: object) -> None:
        try:
            self._loop.call_soon_threadsafe(function, *args)
        except RuntimeError:
            # The loop is closed: nobody is left to tell.
            log.debug("event loop closed, reader ends")
            self._stop.set()
