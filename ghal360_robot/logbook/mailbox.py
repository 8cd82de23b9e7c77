"""The bounded queue between everyone who logs and one thread that takes. Putting never waits."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from ghal360_robot.logbook.table import Row

# About a minute of video and some minutes of everything else: longer than any disk hiccup worth riding out.
MAX_BYTES = 256 << 20
MAX_ENTRIES = 400_000

# What an entry weighs beside its payload: a closure, a message, a tuple (order of magnitude).
ENTRY_BYTES = 500


@dataclass(frozen=True, slots=True)
class Entry:
    """Something to log: `rows` runs on the writer's thread."""

    entity: str
    """What is said to be missing where `rows` fails."""
    rows: Callable[[], Iterable[Row]]
    size: int = 0
    """Bytes of payload."""
    video: bool = False
    keyframe: bool = False

    @property
    def weight(self) -> int:
        return self.size + ENTRY_BYTES


class Parcel(Protocol):
    """What a mailbox wants to know of what it is given."""

    @property
    def weight(self) -> int: ...

    @property
    def video(self) -> bool: ...

    @property
    def keyframe(self) -> bool: ...


P = TypeVar("P", bound=Parcel)


class Mailbox(Generic[P]):
    """Video and the rest wait in separate lines, so that video can go first when there is no more room.

    Video is dropped by whole groups of pictures: a picture without its predecessors shows nothing.
    """

    def __init__(self, max_bytes: int = MAX_BYTES, max_entries: int = MAX_ENTRIES) -> None:
        self._max_bytes = max_bytes
        self._max_entries = max_entries
        self._lock = threading.Lock()
        self._rest: deque[P] = deque()
        self._video: deque[P] = deque()
        self._waiting_for_keyframe = False
        self._closed = False
        self.bytes = 0
        self.dropped_video = 0
        self.dropped_rest = 0

    def __len__(self) -> int:
        return len(self._rest) + len(self._video)

    def put(self, entry: P) -> bool:
        """Take `entry`, dropping video to make room; False where the entry itself had to be dropped."""
        with self._lock:
            if self._closed:
                return False
            if entry.video:
                return self._put_video(entry)
            while not self._fits(entry) and self._video:
                self._drop_oldest_pictures()
            if not self._fits(entry):
                self.dropped_rest += 1
                return False
            self._rest.append(entry)
            self.bytes += entry.weight
            return True

    def take(self, limit: int) -> list[P]:
        """Up to `limit` entries in the order they came, video first."""
        with self._lock:
            taken = [self._video.popleft() for _ in range(min(limit, len(self._video)))]
            taken += [self._rest.popleft() for _ in range(min(limit - len(taken), len(self._rest)))]
            self.bytes -= sum(entry.weight for entry in taken)
            return taken

    def close(self) -> None:
        """Nothing is taken in any more; what waits can still be taken out."""
        with self._lock:
            self._closed = True

    def abandon(self) -> None:
        """Drop everything that still waits."""
        with self._lock:
            self.dropped_video += len(self._video)
            self.dropped_rest += len(self._rest)
            self._video.clear()
            self._rest.clear()
            self.bytes = 0

    def start_anew(self) -> None:
        """Drop everything that still waits, and video until its next key picture."""
        self.abandon()
        with self._lock:
            self._waiting_for_keyframe = True

    def _put_video(self, entry: P) -> bool:
        if entry.keyframe:
            self._waiting_for_keyframe = False
        if self._waiting_for_keyframe or not self._fits(entry):
            self._waiting_for_keyframe = True
            self.dropped_video += 1
            return False
        self._video.append(entry)
        self.bytes += entry.weight
        return True

    def _fits(self, entry: P) -> bool:
        return self.bytes + entry.weight <= self._max_bytes and len(self) < self._max_entries

    def _drop_oldest_pictures(self) -> None:
        while self._video:
            self.bytes -= self._video.popleft().weight
            self.dropped_video += 1
            if self._video and self._video[0].keyframe:
                return
        self._waiting_for_keyframe = True
