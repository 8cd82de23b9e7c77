"""What waits for a thread: putting never waits, getting does. How much may wait is decided by who puts."""

from __future__ import annotations

import threading
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class Inbox(Generic[T]):
    """First in, first out; any thread may put, clear and close."""

    def __init__(self) -> None:
        self._waiting: deque[T] = deque()
        self._ready = threading.Condition()
        self._closed = False

    def __len__(self) -> int:
        return len(self._waiting)

    def put(self, item: T) -> None:
        with self._ready:
            self._waiting.append(item)
            self._ready.notify()

    def get(self) -> T | None:
        """The oldest; waits for it. None once closed, whatever still waits."""
        with self._ready:
            while not self._waiting and not self._closed:
                self._ready.wait()
            return None if self._closed else self._waiting.popleft()

    def clear(self) -> None:
        with self._ready:
            self._waiting.clear()

    def close(self) -> None:
        with self._ready:
            self._closed = True
            self._ready.notify()
