"""What outlives a lost link: odometry, counts, and those who listen."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator

from drivers.rmp110.device.odometry import Odometry
from drivers.rmp110.device.state import State

STATE_BACKLOG = 256
"""Five seconds of states; a consumer that is later than that misses the oldest."""
RATE_WINDOW = 64
"""Packets over which the rate is measured, a bit more than a second."""


class Journal:
    """Keeps the newest state and passes every state on."""

    def __init__(self) -> None:
        self.odometry = Odometry()
        self.latest: State | None = None
        self.received = 0
        self.lost = 0
        self.damaged = 0
        self.dropped = 0
        self.reconnects = 0
        self.watchdog_trips = 0
        self._arrivals: deque[int] = deque(maxlen=RATE_WINDOW)
        self._subscribers: set[asyncio.Queue[State | None]] = set()
        self._closed = False

    def publish(self, state: State, arrived_ns: int) -> None:
        """One more complete packet."""
        self.latest = state
        self.received += 1
        self._arrivals.append(arrived_ns)
        self._tell(state)

    @property
    def last_ns(self) -> int | None:
        """When the newest packet was complete."""
        return self._arrivals[-1] if self._arrivals else None

    @property
    def rate_hz(self) -> float:
        """Complete packets per second over the last ones, however long ago those were."""
        span_ns = self._arrivals[-1] - self._arrivals[0] if len(self._arrivals) > 1 else 0
        return (len(self._arrivals) - 1) * 1e9 / span_ns if span_ns > 0 else 0.0

    async def states(self) -> AsyncIterator[State]:
        """Every state from now on, until `close`."""
        queue: asyncio.Queue[State | None] = asyncio.Queue(STATE_BACKLOG)
        self._subscribers.add(queue)
        try:
            while not self._closed:
                state = await queue.get()
                if state is None:
                    return
                yield state
        finally:
            self._subscribers.discard(queue)

    def close(self) -> None:
        """End every iteration."""
        self._closed = True
        self._tell(None)

    def _tell(self, state: State | None) -> None:
        for queue in self._subscribers:
            if queue.full():
                queue.get_nowait()
            queue.put_nowait(state)
