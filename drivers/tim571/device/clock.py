"""From the device's ticks to this machine's monotonic clock.

Tick 9 of a telegram ("time since start-up") is close to the last beam, tick 10 is the transmission (fact sheet
section 5). A telegram arrives a fraction of a millisecond after its transmission, so the last beam was about
`tick 10 - tick 9` before the arrival. A fit over many telegrams may replace this without touching anything else.
"""

from __future__ import annotations

from drivers.tim571.codec.scandata import TICKS

_MOST_DELAY_US = 1_000_000  # 10.9 ms is the longest seen; more means the ticks are not to be trusted


def ticks_between(earlier_us: int, later_us: int) -> int:
    """Microseconds from one tick to a later one; the counter wraps every 71.6 minutes."""
    return (later_us - earlier_us) % TICKS


class ArrivalClock:
    """Stamps each scan by its own arrival."""

    def reset(self) -> None:
        """The device was restarted: its ticks began anew."""

    def last_beam_ns(self, arrival_ns: int, scan_tick_us: int, transmit_tick_us: int) -> int:
        """Monotonic time of the last beam, given the arrival of the telegram's first byte."""
        delay_us = ticks_between(scan_tick_us, transmit_tick_us)
        return arrival_ns if delay_us > _MOST_DELAY_US else arrival_ns - 1000 * delay_us
