"""One anchor between this machine's monotonic clock and the wall clock, taken once per run."""

from __future__ import annotations

import ctypes
import ctypes.util
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


class _Timex(ctypes.Structure):
    """`struct timex` of Linux; what is read here, and room for the rest (man adjtimex)."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror_us", ctypes.c_long),
        ("esterror_us", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_long * 32),
    )


TIME_ERROR = 5
"""What adjtimex returns for a clock that nobody synchronizes."""


def clock_quality() -> dict[str, object]:
    """How far the wall clock is to be trusted, as the kernel sees it; `synchronized` is None where it does not say."""
    state = _Timex()
    try:
        returned = ctypes.CDLL(ctypes.util.find_library("c"), use_errno=True).adjtimex(ctypes.byref(state))
    except (OSError, AttributeError):
        return {"synchronized": None}
    if returned < 0:
        return {"synchronized": None}
    return {
        "synchronized": returned != TIME_ERROR,
        "max_error_s": state.maxerror_us / 1e6,
        "estimated_error_s": state.esterror_us / 1e6,
    }
