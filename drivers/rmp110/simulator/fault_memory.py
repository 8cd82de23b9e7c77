"""The base's log of its own faults; it survives power-off (fact sheet section 8)."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta

from drivers.rmp110.codec.fault_log import ENTRIES, EPOCH, FAULT_LOG_WORDS, FaultEntry, FaultLog, encode_fault_log
from drivers.rmp110.codec.frames import float_to_word

SERIAL = 0x0110_0000_0000_0042
SP_BUILD, UIP_BUILD = 1246, 1279
"""Firmware builds of the machine whose logs the simulator follows."""
BUILT = timedelta(days=1500)
"""The clock of the simulated base stood here when it left the factory."""


class FaultMemory:
    """Twenty entries in a ring; one is written whenever a fault bit appears."""

    def __init__(self) -> None:
        self.power_cycles = 0
        self._entries: deque[FaultEntry] = deque(maxlen=ENTRIES)
        self._written = 0
        self._seen = (0, 0, 0, 0)
        self._earlier_s = 0

    def power_on(self, run_time_s: float) -> None:
        """Another power cycle, after one that lasted `run_time_s`."""
        self.power_cycles += 1
        self._earlier_s += int(run_time_s)
        self._seen = (0, 0, 0, 0)

    def note(self, words: Sequence[int], run_time_s: float, odometer_m: float) -> None:
        """Write an entry where fault status words 1..4 show more than before."""
        new = tuple(word & ~seen for word, seen in zip(words, self._seen, strict=True))
        if not any(new):
            return
        one, two, three, four = words
        self._seen = (one, two, three, four)
        groups = (0, one >> 12, two & 0xFFFF, three & 0xFFFF, three >> 16, four, one & 0xFFF, two >> 16)
        self._entries.append(
            FaultEntry(
                index=self._written % ENTRIES,
                latest=False,
                when=EPOCH + BUILT + timedelta(seconds=self._earlier_s + int(run_time_s)),
                run_time_s=int(run_time_s),
                power_cycle=self.power_cycles,
                groups=groups,
                data=(float_to_word(odometer_m), float_to_word(run_time_s), 0, 0),
            )
        )
        self._written += 1

    def words(self, run_time_s: float, odometer_m: float) -> tuple[int, ...]:
        """The whole log as the base sends it."""
        latest = (self._written - 1) % ENTRIES if self._written else 0
        entries = [replace(entry, latest=entry.index == latest) for entry in self._entries]
        return encode_fault_log(
            FaultLog(
                version=1,
                size=FAULT_LOG_WORDS,
                entry_count=len(entries),
                latest_index=latest,
                serial=SERIAL,
                sp_build=SP_BUILD,
                uip_build=UIP_BUILD,
                accumulated_s=self._earlier_s + int(run_time_s),
                odometer_m=int(odometer_m),
                power_cycles=self.power_cycles,
                entries=tuple(entries),
            )
        )
