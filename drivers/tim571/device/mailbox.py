"""Scans waiting for one consumer."""

from __future__ import annotations

import asyncio
from collections import deque

from drivers.tim571.device.scan import Scan


class Mailbox:
    """A few scans for one consumer; the oldest makes room for the newest."""

    def __init__(self, size: int) -> None:
        self._scans: deque[Scan] = deque(maxlen=size)
        self._news = asyncio.Event()
        self._ended = False

    def put(self, scan: Scan) -> bool:
        """Add a scan; True if another had to go for it."""
        full = len(self._scans) == self._scans.maxlen
        self._scans.append(scan)
        self._news.set()
        return full

    def end(self) -> None:
        """No more scans will come."""
        self._ended = True
        self._news.set()

    async def take(self) -> Scan | None:
        """The oldest kept scan; None after the end."""
        while not self._scans:
            if self._ended:
                return None
            self._news.clear()
            await self._news.wait()
        return self._scans.popleft()
