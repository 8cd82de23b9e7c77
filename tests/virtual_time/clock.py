"""An asyncio event loop whose clock is simulated: where nothing is ready it jumps to the next timer.

Deterministic, and as fast as the code that runs in it. Whatever reads `time.monotonic` or
`time.monotonic_ns` through the module, or is handed `Clock.read`, lives in the same simulated time.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import selectors
import time
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar
from unittest import mock

T = TypeVar("T")

START_NS = 1_000_000_000_000
"""A quarter of an hour after boot: old enough that no zero passes for a recent stamp."""
THREAD_PATIENCE_S = 5.0
"""Longest real wait for another thread where nothing else is left to do; the rig itself has none."""


GRAIN_S = 0.005
"""How finely other threads live while the loop is busy."""


@dataclass(slots=True)
class Clock:
    """Nanoseconds, moved by the loop."""

    now_ns: int = START_NS
    threads: list[Callable[[], object]] = field(default_factory=list)
    """What goes on while the event loop is busy; called again and again."""

    def read(self) -> int:
        """Stands for `time.monotonic_ns`."""
        return self.now_ns

    def seconds(self) -> float:
        """Stands for `time.monotonic`."""
        return self.now_ns / 1e9

    def busy(self, seconds: float) -> None:
        """The event loop does nothing for so long; other threads do."""
        for _ in range(round(seconds / GRAIN_S)):
            self.now_ns += round(GRAIN_S * 1e9)
            for live in tuple(self.threads):
                live()


class _NoWait(selectors.DefaultSelector):  # type: ignore[misc,valid-type]
    """Takes the time it should wait from the clock instead of from us."""

    clock: Clock

    def select(self, timeout: float | None = None) -> Any:
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        if timeout is None:
            ready = super().select(THREAD_PATIENCE_S)
            if not ready:
                raise RuntimeError("everything waits and no timer is left: this would hang for ever")
            return ready
        self.clock.now_ns += max(1, math.ceil(timeout * 1e9))
        return ready


class VirtualLoop(asyncio.SelectorEventLoop):
    """Its time is the clock's."""

    def __init__(self, clock: Clock) -> None:
        selector = _NoWait()
        selector.clock = clock
        self.clock = clock
        super().__init__(selector)
        self._clock_resolution = 1e-9

    def time(self) -> float:
        return self.clock.now_ns / 1e9


@contextlib.contextmanager
def simulated(clock: Clock) -> Iterator[None]:
    """The process' monotonic clock is this one."""
    with mock.patch.object(time, "monotonic_ns", clock.read), mock.patch.object(time, "monotonic", clock.seconds):
        yield


@contextlib.contextmanager
def virtual_loop(clock: Clock | None = None) -> Iterator[VirtualLoop]:
    """A loop in simulated time; what still runs at the end is cancelled, and said."""
    clock = clock or Clock()
    with simulated(clock):
        loop = VirtualLoop(clock)
        asyncio.set_event_loop(loop)
        try:
            yield loop
        finally:
            left = [task for task in asyncio.all_tasks(loop) if not task.done()]
            for task in left:
                task.cancel()
            if left:
                loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
            loop.run_until_complete(loop.shutdown_asyncgens())
            loop.close()
            asyncio.set_event_loop(None)


def run(main: Coroutine[Any, Any, T], clock: Clock | None = None) -> T:
    """`asyncio.run` in simulated time."""
    with virtual_loop(clock) as loop:
        return loop.run_until_complete(main)
