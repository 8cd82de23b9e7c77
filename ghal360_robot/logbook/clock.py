"""One anchor between this machine's monotonic clock and the wall clock, taken once per run."""

from __future__ import annotations

import time
from dataclasses import dataclass

# The wall clock is read between two monotonic readings; the tightest of a few pairs is kept.
ATTEMPTS = 5


@dataclass(frozen=True, slots=True)
class Anchor:
    """The instant `monotonic_ns` was `wall_ns` (Unix epoch). A later step of the wall clock changes nothing."""

    monotonic_ns: int
    wall_ns: int

    @classmethod
    def now(cls) -> Anchor:
        readings = []
        for _ in range(ATTEMPTS):
            before = time.monotonic_ns()
            wall = time.time_ns()
            width = time.monotonic_ns() - before
            readings.append((width, before + width // 2, wall))
        _, monotonic, wall = min(readings)
        return cls(monotonic, wall)

    @property
    def offset_ns(self) -> int:
        """Wall minus monotonic."""
        return self.wall_ns - self.monotonic_ns

    def to_wall(self, monotonic_ns: int) -> int:
        return monotonic_ns + self.offset_ns

    def to_monotonic(self, wall_ns: int) -> int:
        return wall_ns - self.offset_ns
