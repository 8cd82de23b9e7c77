"""What the base heard and how fast it was, and what follows from that about one stop."""

from __future__ import annotations

from dataclasses import dataclass, field

STANDSTILL_MPS = 0.01
"""A wheel's millimetre in a tenth of a second: nobody calls that rolling."""


@dataclass(frozen=True, slots=True)
class Stop:
    """One stop, in milliseconds since its cause; None for what did not happen while it was watched."""

    speed_mps: float
    """When the cause struck."""
    last_motion_ms: float
    """Arrival of the last frame that asked for motion; 0 where none came later than the cause."""
    zero_ms: float | None
    """Arrival of the zero after which nothing asked for motion any more."""
    standstill_ms: float | None
    """From then on the base stood still."""


@dataclass(slots=True)
class Trace:
    """Motion frames as they reached the base, and its speed; stamps are monotonic nanoseconds, rising."""

    motion: list[tuple[int, bool]] = field(default_factory=list)
    """Stamp, and whether the frame asked for motion."""
    speeds: list[tuple[int, float]] = field(default_factory=list)
    """Stamp and m/s forward."""

    def steady(self, slowest_mps: float, for_ns: int) -> bool:
        """Whether the base was at least this fast for the last `for_ns`."""
        if not self.speeds or self.speeds[-1][0] - self.speeds[0][0] < for_ns:
            return False
        since_ns = self.speeds[-1][0] - for_ns
        for stamp_ns, v in reversed(self.speeds):
            if v < slowest_mps:
                return False
            if stamp_ns < since_ns:
                break
        return True

    def stop_after(self, cause_ns: int) -> Stop:
        """The stop that a cause at this instant led to. Raises ValueError where no speed was noted before it."""
        before = [v for stamp_ns, v in self.speeds if stamp_ns <= cause_ns]
        if not before:
            raise ValueError("the trace begins after the cause")
        later = [(stamp_ns, moves) for stamp_ns, moves in self.motion if stamp_ns > cause_ns]
        last_ns = max((stamp_ns for stamp_ns, moves in later if moves), default=cause_ns)
        zero_ns = min((stamp_ns for stamp_ns, moves in later if not moves and stamp_ns > last_ns), default=None)
        return Stop(
            speed_mps=before[-1],
            last_motion_ms=(last_ns - cause_ns) / 1e6,
            zero_ms=None if zero_ns is None else (zero_ns - cause_ns) / 1e6,
            standstill_ms=self._standstill_ms(cause_ns),
        )

    def _standstill_ms(self, cause_ns: int) -> float | None:
        still_ns: int | None = None
        for stamp_ns, v in reversed(self.speeds):
            if stamp_ns < cause_ns or abs(v) >= STANDSTILL_MPS:
                break
            still_ns = stamp_ns
        return None if still_ns is None else (still_ns - cause_ns) / 1e6
