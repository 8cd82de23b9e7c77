"""Hand-over of access units from the collecting thread to one reader on the event loop."""

from __future__ import annotations

import asyncio
import threading
from collections import deque

from drivers.theta_v.codec.access_units import AccessUnit
from drivers.theta_v.errors import ThetaError


class Mailbox:
    """Bounded; the newest picture wins, but never one whose reference was dropped.

    When it is full, everything before the newest waiting key picture goes. If none waits behind the
    first, everything goes, and so does all that follows until the next key picture.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, limit: int, *, pass_tainted: bool = True) -> None:
        if limit < 1:
            raise ValueError("a mailbox holds at least one picture")
        self.dropped = 0
        """Pictures never handed out because the reader was too slow."""
        self._loop, self._limit, self._pass_tainted = loop, limit, pass_tainted
        self._units: deque[AccessUnit] = deque()
        self._joined = False
        self._overrun = False
        self._lock = threading.Lock()
        self._changed = asyncio.Event()
        self._closed = False
        self._error: ThetaError | None = None

    @property
    def thirsty(self) -> bool:
        """Whether pictures are held back until a key picture comes."""
        return not self._closed and (self._overrun or not self._joined)

    def put(self, unit: AccessUnit) -> None:
        """From any thread. Raises RuntimeError when the event loop has ended."""
        with self._lock:
            if self._closed or not self._admit(unit):
                return
            self._units.append(unit)
        self._loop.call_soon_threadsafe(self._changed.set)

    def close(self, error: ThetaError | None = None) -> None:
        """On the event loop: the reader gets what waits and then the end, or the error."""
        with self._lock:
            self._closed, self._error = True, error
        self._changed.set()

    async def get(self) -> AccessUnit | None:
        """The next picture, or None at the end. Raises the error it was closed with."""
        while True:
            with self._lock:
                if self._units:
                    return self._units.popleft()
                if self._closed:
                    if self._error is not None:
                        raise self._error
                    return None
                self._changed.clear()
            await self._changed.wait()

    def _admit(self, unit: AccessUnit) -> bool:
        starts_anew = unit.keyframe and not unit.tainted
        if not unit.decodable or (unit.tainted and not self._pass_tainted):
            return False
        if not self._joined and not starts_anew:
            return False
        if not self._overrun and len(self._units) >= self._limit:
            self._make_room()
        if self._overrun and not starts_anew:
            self.dropped += 1
            return False
        self._joined, self._overrun = True, False
        return True

    def _make_room(self) -> None:
        keys = [i for i, unit in enumerate(self._units) if unit.keyframe and not unit.tainted]
        newest = keys[-1] if keys and keys[-1] > 0 else len(self._units)
        for _ in range(newest):
            self._units.popleft()
        self.dropped += newest
        self._overrun = not self._units
