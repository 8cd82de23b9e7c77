"""The base's own log of its last faults (fact sheet section 8): 311 words, 11 of header and 20 entries of 15.

The order of the fault groups and the epoch are those of the vendor's own log viewer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

from drivers.rmp110.codec.faults import LOG_GROUPS, bit_texts

HEADER_WORDS = 11
ENTRIES, ENTRY_WORDS = 20, 15
FAULT_LOG_WORDS = HEADER_WORDS + ENTRIES * ENTRY_WORDS
PACKETS, PACKET_WORDS = 6, 52
"""On CAN it comes in six replies, the last one with a word to spare."""

EPOCH = datetime(2011, 1, 1, tzinfo=timezone(timedelta(hours=-5), "EST"))
"""The base's clock counts from here and knows no summer time."""


@dataclass(frozen=True, slots=True)
class FaultEntry:
    """One entry; where the base's clock was never set `when` is of no use and `run_time_s` is."""

    index: int
    """Place in the log, a ring."""
    latest: bool
    when: datetime
    run_time_s: int
    power_cycle: int
    groups: tuple[int, ...]
    """The eight fault groups' words, in the order of `LOG_GROUPS`."""
    data: tuple[int, ...]
    """Four words that only the vendor can read; the first two are usually floats."""

    @property
    def texts(self) -> tuple[str, ...]:
        """Every fault of the entry as `group: text`."""
        return tuple(
            f"{name}: {text}"
            for (name, table), word in zip(LOG_GROUPS, self.groups, strict=True)
            for text in bit_texts(word, table)
        )


@dataclass(frozen=True, slots=True)
class FaultLog:
    """Header and entries, newest first."""

    version: int
    size: int
    entry_count: int
    latest_index: int
    serial: int
    """64 bits."""
    sp_build: int
    """Of the safety processor's firmware."""
    uip_build: int
    """Of the user interface processor's firmware."""
    accumulated_s: int
    odometer_m: int
    power_cycles: int
    entries: tuple[FaultEntry, ...]


def decode_fault_log(words: Sequence[int]) -> FaultLog:
    """A log from its words, whatever they are: missing ones read zero, empty entries are left out."""
    padded = [*words[:FAULT_LOG_WORDS], *[0] * (FAULT_LOG_WORDS - len(words))]
    version, size, count, latest, high, low, sp, uip, seconds, metres, cycles = padded[:HEADER_WORDS]
    # A ring: what was written last stands at `latest`, what before it one place earlier.
    newest_first = [(latest - age) % ENTRIES for age in range(ENTRIES)]
    entries = tuple(
        entry for index in newest_first if (entry := _entry(index, padded, latest=index == latest and count > 0))
    )
    return FaultLog(version, size, count, latest, high << 32 | low, sp, uip, seconds, metres, cycles, entries)


def encode_fault_log(log: FaultLog) -> tuple[int, ...]:
    """The 311 words of a log."""
    words = [log.version, log.size, log.entry_count, log.latest_index, log.serial >> 32, log.serial & 0xFFFFFFFF]
    words += [log.sp_build, log.uip_build, log.accumulated_s, log.odometer_m, log.power_cycles]
    words += [0] * (FAULT_LOG_WORDS - HEADER_WORDS)
    for entry in log.entries:
        start = HEADER_WORDS + entry.index * ENTRY_WORDS
        seconds = round((entry.when - EPOCH).total_seconds())
        words[start : start + ENTRY_WORDS] = seconds, entry.run_time_s, entry.power_cycle, *entry.groups, *entry.data
    return tuple(words)


def _entry(index: int, words: Sequence[int], *, latest: bool) -> FaultEntry | None:
    start = HEADER_WORDS + index * ENTRY_WORDS
    seconds, run_time_s, power_cycle, *rest = words[start : start + ENTRY_WORDS]
    if not (seconds or run_time_s or power_cycle or any(rest)):
        return None
    when = EPOCH + timedelta(seconds=seconds)
    return FaultEntry(index, latest, when, run_time_s, power_cycle, tuple(rest[:8]), tuple(rest[8:]))
