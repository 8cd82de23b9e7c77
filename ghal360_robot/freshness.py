"""Freshness is data: one place that says of each input whether it is alive, at rate and valid."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from ghal360_robot.messages import Freshness

WINDOW_NS = 2_000_000_000
"""Rates are judged over two seconds: 30 scans, 100 base packets, long enough to be steady."""

MAX_STAMPS = 1024
"""Bound of one window, should a device run wild."""

RATE_FLOOR = 0.6
"""Share of the expected rate below which an input counts as slow (scheduler hiccups cost a few percent)."""

MATURE_NS = 500_000_000
"""A rate is not held against an input in its first half second."""


@dataclass(slots=True)
class RateWatch:
    """Arrivals of one input: `note` is called with each, `at` by the control tick."""

    expected_hz: float
    alive_s: float
    _stamps: deque[int] = field(default_factory=lambda: deque(maxlen=MAX_STAMPS))
    _first_ns: int = 0
    _last_ns: int | None = None

    def note(self, stamp_ns: int) -> None:
        if self._last_ns is None or stamp_ns - self._last_ns > self.alive_s * 1e9:
            self._stamps.clear()  # a gap starts a new life: the rate of the old one says nothing
            self._first_ns = stamp_ns
        self._stamps.append(stamp_ns)
        self._last_ns = stamp_ns

    def rate_hz(self, now_ns: int) -> float:
        """Arrivals per second over the window, or since the first arrival when that is shorter."""
        while self._stamps and self._stamps[0] < now_ns - WINDOW_NS:
            self._stamps.popleft()
        span_s = min(now_ns - self._first_ns, WINDOW_NS) / 1e9
        return len(self._stamps) / span_s if self._stamps and span_s > 0 else 0.0

    def at(self, now_ns: int, *, valid: bool) -> Freshness:
        if self._last_ns is None:
            return Freshness(alive=False, rate_ok=False, valid=valid, age_s=math.inf)
        age_s = max(0.0, (now_ns - self._last_ns) / 1e9)  # an arrival since the tick's stamp was taken
        young = now_ns - self._first_ns < MATURE_NS
        rate_ok = young or self.rate_hz(now_ns) >= RATE_FLOOR * self.expected_hz
        return Freshness(alive=age_s <= self.alive_s, rate_ok=rate_ok, valid=valid, age_s=age_s)
