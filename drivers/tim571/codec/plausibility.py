"""Damage that a checksum of one byte lets through, or that CoLa-A, which has none, cannot tell.

A telegram is compared with the ones before it: what never changes while a device runs (its serial number, which
beams it sends, which blocks), what changes by a rule (counters and ticks), and what no sample can be (farther than
the device sees, a range without an echo). One doubtful telegram is taken for damaged; but doubt that returns at
once, or again and again, is how this device is, and is no longer held against it. So nothing that a device
may do stops its scans for longer than a few revolutions, whatever this module believes about it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Literal

from drivers.tim571.codec.scandata import COUNTS, TICKS, Channel, ScanData
from drivers.tim571.geometry import FARTHEST_M, FIRST_ANGLE_1E4DEG, LAST_ANGLE_1E4DEG

Doubt = Literal["contradiction", "fields", "counters", "ticks", "too far", "no echo", "spelling"]

FARTHEST_MM = round(1000 * FARTHEST_M) + 1000  # the device sees 25 m; one metre for tolerance and bright targets
NEAREST_RANGE_MM = 16  # smaller samples are codes
LONGEST_DELAY_US = 1_000_000  # from scan to transmission; 10.9 ms is the longest seen
_SLACK_US = 500  # motor wander between two scans is at most 150 us, and 34 us on average
_SLACK_PER_US = 0.01
_RECENT = 30  # telegrams: two seconds
_USUAL = 6  # doubts of one kind among the recent ones: damage on a link that works at all is much rarer
_TRUST = 1000  # telegrams: about a minute until it is looked at again
_TAGS = frozenset(("DIST1", "DIST2", "DIST3", "DIST4", "DIST5", "RSSI1", "RSSI2", "ANGL1", "VANG1", "REFL1"))


class Plausibility:
    """Follows one connection's scans; start a new one for each connection."""

    def __init__(self) -> None:
        self._believed: ScanData | None = None
        self._fields: tuple[object, ...] = ()
        self._last: frozenset[Doubt] = frozenset()
        self._recent: deque[frozenset[Doubt]] = deque(maxlen=_RECENT)
        self._trusted: dict[Doubt, int] = {}
        self._seen = 0

    def doubts(self, scan: ScanData) -> frozenset[Doubt]:
        """Why the scan is taken for damaged; empty if it is believed, and then it is what later ones must fit."""
        self._seen += 1
        fields = _fixed(scan)
        found = frozenset(self._examine(scan, fields))
        held = found
        if found:
            held = frozenset() if found <= self._last else frozenset(d for d in found if not self._usual(d))
        self._last = found
        self._recent.append(found)
        if not held:
            self._believed, self._fields = scan, fields
        return held

    def _examine(self, scan: ScanData, fields: tuple[object, ...]) -> Iterator[Doubt]:
        if scan.trailing or not _consistent(scan):
            yield "contradiction"
        if (scan.transmit_tick_us - scan.scan_tick_us) % TICKS > LONGEST_DELAY_US:
            yield "ticks"
        if self._believed is not None:
            if fields != self._fields:
                yield "fields"
            yield from _steps(self._believed, scan)
        if not scan.canonical:
            yield "spelling"
        if scan.channels16 and scan.channels16[0].tag == "DIST1":
            yield from _samples(scan.channels16[0], scan.channel("RSSI1"))

    def _usual(self, doubt: Doubt) -> bool:
        """Whether the device is like that; a doubt that came often is trusted for a while."""
        if self._seen < self._trusted.get(doubt, 0):
            return True
        if sum(doubt in others for others in self._recent) < _USUAL:
            return False
        self._trusted[doubt] = self._seen + _TRUST
        return True


def _fixed(scan: ScanData) -> tuple[object, ...]:
    """What stays the same from one scan to the next."""
    return (
        scan.version,
        scan.device,
        scan.serial,
        scan.status,
        scan.inputs,
        scan.outputs,
        scan.layer,
        scan.scan_frequency_chz,
        scan.measuring_frequency_100hz,
        len(scan.encoders),
        tuple([_head(row) for row in scan.channels16]),
        tuple([_head(row) for row in scan.channels8]),
        scan.position,
        scan.name,
        scan.comment,
        scan.clock is None,
        scan.event is None,
    )


def _head(row: Channel) -> tuple[object, ...]:
    return row.tag, row.scale, row.offset, row.start_1e4deg, row.step_1e4deg, len(row.samples)


def _consistent(scan: ScanData) -> bool:
    """Whether the telegram agrees with itself; the only thing to go by for a first one."""
    rows = (*scan.channels16, *scan.channels8)
    first = rows[0]
    turn = (first.start_1e4deg, first.step_1e4deg, len(first.samples))
    if any((row.start_1e4deg, row.step_1e4deg, len(row.samples)) != turn or row.tag not in _TAGS for row in rows):
        return False
    start, step, count = turn
    inside = start >= FIRST_ANGLE_1E4DEG and start + (count - 1) * step <= LAST_ANGLE_1E4DEG
    return inside and scan.scan_frequency_chz > 0


def _steps(before: ScanData, scan: ScanData) -> Iterator[Doubt]:
    """Both counters count the same scans, and so does the tick, one period each."""
    scans = (scan.scan_counter - before.scan_counter) % COUNTS
    if scans != (scan.telegram_counter - before.telegram_counter) % COUNTS:
        yield "counters"
    elapsed_us = (scan.scan_tick_us - before.scan_tick_us) % TICKS
    expected_us = scans * 100_000_000 / max(1, scan.scan_frequency_chz)
    # A tick that has wrapped while the counter was far from it is found the same on either side.
    apart_us = (elapsed_us - expected_us) % TICKS
    if min(apart_us, TICKS - apart_us) > _SLACK_US + _SLACK_PER_US * expected_us:
        yield "ticks"


def _samples(distance: Channel, rssi: Channel | None) -> Iterator[Doubt]:
    """Nothing is seen beyond the device's range, and nothing is measured that sent no echo back."""
    samples = distance.samples
    if distance.scale == 1.0 and len(samples) and samples.max() > FARTHEST_MM:
        yield "too far"
    if rssi is not None and len(rssi.samples) == len(samples):
        silent = rssi.samples == 0
        if silent.any() and (samples[silent] >= NEAREST_RANGE_MM).any():
            yield "no echo"
