"""The last hand on motion: stops the base where the event loop no longer can.

The base stops by itself 0.5 s after the last command. A loop that is blocked renews nothing, and the
driver's own rule that an old command becomes zero runs in that very loop. So a thread waits for the moment
at which a command should have been renewed, and says zero. What it cannot outlive is an interpreter held
by foreign code, or a killed process: then the base's own timeout is all there is.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

LIMIT_S = 0.2
"""Ten control ticks at 50 Hz; with the base's latency of 40 ms still well before its own 0.5 s."""
REPEATS, REPEAT_S = 5, 0.05
"""A zero may get lost; after a quarter of a second of them the base's own timeout is near."""
JOIN_S = 1.0
"""The thread waits for nothing but its condition; longer means a send that hangs in the kernel."""


class Watchdog:
    """Knows whether a motion command is out and when it was renewed; trips when `check` finds it too old.

    `zero` puts zero motion on the wire, from any thread, and says whether the bus took it. This class has no
    thread: it is for simulated time, where whoever owns the time calls `check` or does without.
    """

    def __init__(self, zero: Callable[[], bool], clock: Callable[[], int]) -> None:
        self._zero = zero
        self._clock = clock
        self._changed = threading.Condition()
        self._moving = False
        self._renewed_ns = 0
        self.tripped = False
        """Until the commander says zero, nothing else passes."""
        self.trips = 0

    def start(self) -> None:
        """Begin to watch."""

    def stop(self) -> None:
        """Nothing is sent any more after this."""

    def pass_on(self, send: Callable[[], None], *, moving: bool) -> bool:
        """Let a motion command go out unless it moves and the watchdog tripped; whether it went.

        Whatever `send` raises is raised. No command can slip past a zero that is being sent.
        """
        with self._changed:
            if moving and self.tripped:
                return False
            send()
            self._renewed_ns = self._clock()
            if moving is not self._moving:
                self._moving = moving
                self._changed.notify_all()
            return True

    def renew(self) -> None:
        """The loop runs, and the command is still meant."""
        with self._changed:
            self._renewed_ns = self._clock()

    def release(self) -> None:
        """The commander said zero: it knows."""
        with self._changed:
            self.tripped = False

    def check(self) -> bool:
        """Trip where it is time; whether that happened."""
        with self._changed:
            if not self._moving or self._left_s() > 0:
                return False
            self._moving = False
            self.tripped = True
            self.trips += 1
            self._zero()
            return True

    def _left_s(self) -> float:
        return LIMIT_S - (self._clock() - self._renewed_ns) / 1e9


class ThreadWatchdog(Watchdog):
    """Checks by itself, in a thread that sleeps until a command grows old."""

    def __init__(self, zero: Callable[[], bool], clock: Callable[[], int]) -> None:
        super().__init__(zero, clock)
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="rmp110-watchdog", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        with self._changed:
            self._stopped = True
            self._changed.notify_all()
        if self._thread.ident is not None:
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        with self._changed:
            while not self._stopped:
                if self.check():
                    self._insist()
                else:
                    self._changed.wait(self._left_s() if self._moving else None)

    def _insist(self) -> None:
        """Zero again while nobody else says anything."""
        for _ in range(REPEATS - 1):
            self._changed.wait(REPEAT_S)
            if self._stopped or self._moving or not self.tripped:
                return
            self._zero()
