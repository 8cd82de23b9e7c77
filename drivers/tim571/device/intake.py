"""From telegrams to scans: what is believed of them, when they were, and what is missing between them. No I/O."""

from __future__ import annotations

from drivers.tim571.codec import scandata
from drivers.tim571.codec.plausibility import Plausibility
from drivers.tim571.codec.scandata import SCAN_NAMES, ScanData
from drivers.tim571.codec.telegram import Telegram
from drivers.tim571.device.clock import DeviceClock
from drivers.tim571.device.continuity import Continuity
from drivers.tim571.device.scan import Beam, Scan, has_ranges, scan_of
from drivers.tim571.errors import TimMalformedError

SCANS, MONITOR = SCAN_NAMES


class Intake:
    """Feed it every telegram that answers nothing, in the order of arrival."""

    def __init__(self, tick_marks: Beam = Beam.LAST, stamp_marks: Beam = Beam.LAST) -> None:
        self._marks = tick_marks, stamp_marks
        self._continuity = Continuity()
        self._plausibility = Plausibility()
        self._streams: set[str] = set()
        self.clock = DeviceClock()
        self.received = self.lost = self.repeated = self.restarts = 0
        self.damaged = self.implausible = 0
        self.doubts: tuple[str, ...] = ()
        """What the newest implausible telegram had against it."""
        self.restarted = False
        """Set when the device began anew; whoever set it up clears it."""

    @property
    def every(self) -> int:
        """Every n-th scan is expected."""
        return self._continuity.every

    @every.setter
    def every(self, every: int) -> None:
        self._continuity.every = every

    def connected(self) -> None:
        """A new connection: what one telegram says of the next begins anew, time and counters go on."""
        self._plausibility = Plausibility()
        self._streams.clear()

    def take(self, telegram: Telegram) -> Scan | None:
        """The scan in it, or None if there is none, or none that is new and believed."""
        by_index = telegram.kind == "sSI"  # some TiMs send their scans as an event with a number
        if not by_index and not scandata.is_scan(telegram):
            return None
        try:
            data = scandata.decode(telegram)
        except TimMalformedError:
            self.damaged += not by_index
            return None
        if not has_ranges(data):
            return None  # polled before the first revolution: all zero, counters and ticks included
        if telegram.name == MONITOR and SCANS in self._streams:
            return None  # the same scans once more, with other content
        self._streams.add(telegram.name)
        if doubts := self._plausibility.doubts(data):
            self.damaged += 1
            self.implausible += 1
            self.doubts = tuple(sorted(doubts))
            return None
        return self._new(data, telegram)

    def _new(self, data: ScanData, telegram: Telegram) -> Scan | None:
        arrival_ns = telegram.stamp_ns
        step = self._continuity.observe(data.scan_counter, data.scan_tick_us, arrival_ns)
        if step.repeated:
            self.repeated += 1
            return None
        if step.restarted:
            self.restarts += 1
            self.restarted = True
            self.clock.reset()
        self.received += 1
        self.lost += step.lost
        tick_marks, stamp_marks = self._marks
        return scan_of(
            data,
            self.clock.stamp_ns(arrival_ns, data.scan_tick_us, data.transmit_tick_us),
            arrival_ns,
            telegram.frame,
            locked=self.clock.state.locked,
            lost=step.lost,
            tick_marks=tick_marks,
            stamp_marks=stamp_marks,
        )
