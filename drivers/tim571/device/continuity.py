"""What happened between two telegrams: scans lost, a scan repeated, or the device started anew."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.tim571.codec.scandata import COUNTS, TICKS
from drivers.tim571.device.clock import ticks_between

RESTART_S = 2.0  # device time and our time may differ by a stalled network, not by more than this


@dataclass(frozen=True, slots=True)
class Step:
    """From the telegram before to this one."""

    lost: int = 0
    repeated: bool = False
    restarted: bool = False


class Continuity:
    """Follows the scan counter and the tick, both of which wrap."""

    def __init__(self, every: int = 1) -> None:
        self.every = every
        """Every n-th scan is expected."""
        self._before: tuple[int, int, int] | None = None

    def observe(self, scan_counter: int, tick_us: int, arrival_ns: int) -> Step:
        """Compare with the telegram before."""
        before, self._before = self._before, (scan_counter, tick_us, arrival_ns)
        if before is None:
            return Step()
        count, tick, arrival = before
        elapsed_us = (arrival_ns - arrival) // 1000
        apart = (ticks_between(tick, tick_us) - elapsed_us) % TICKS
        counts = (scan_counter - count) % COUNTS
        backwards = ticks_between(tick, tick_us) > TICKS - RESTART_S * 1e6 and counts != 0
        if backwards or min(apart, TICKS - apart) > RESTART_S * 1e6:
            return Step(restarted=True)
        if counts == 0 or counts >= COUNTS // 2:
            self._before = before
            return Step(repeated=True)
        return Step(lost=max(0, round(counts / self.every) - 1))
