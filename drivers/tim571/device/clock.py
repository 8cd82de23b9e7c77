"""From the device's microseconds to this machine's monotonic clock (fact sheet section 5).

Tick 10 of a telegram is its transmission. A telegram may arrive late by any amount but never early, so the
transmission ticks lie on the lower edge of the arrivals. The edge is a line: its slope is how much faster the device's
crystal runs than ours (some 5 ppm), its height the shortest way through the network, which nobody can tell from a
difference of clocks and which is therefore left in. The line is taken through the lower part of the arrivals rather
than through the very earliest, so that a single early stamp does not move it, and stalls do not matter at all.

Host clock steps cannot matter: everything here is `time.monotonic_ns`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from drivers.tim571.codec.scandata import TICKS

WINDOW_S = 5.0  # drift that the slope doesn't know yet, 50 ppm at worst, makes 0.25 ms in it
MOST_SAMPLES = 512  # a window of a simulator that runs faster than the device
ENOUGH = 30  # arrivals: two seconds
EDGE = 0.15  # the arrivals below the line; jitter on a real network has a standard deviation of 0.1 ms
NEAR_US = 3_000.0  # an arrival that much later than the line was held up on the way
EARLY_US = -5_000.0  # no arrival is that much earlier than the line: then the line is wrong
HELD_UP = 15  # arrivals in a row held up: then it is the line that is wrong
BUCKET_S = 1.0
MOST_BUCKETS = 60  # a minute: temperature changes a crystal slower than that, and the slope is good to 0.2 ppm
STEADY_S2 = 4.0  # spread of the buckets (s^2) at which the slope is believed by half: five seconds
MOST_DRIFT_PPM = 500.0  # crystals are good to 100; more is a device that plays back a recording, or none at all
_MOST_DELAY_US = 1_000_000  # 10.9 ms from scan to transmission is the longest seen


def ticks_between(earlier_us: int, later_us: int) -> int:
    """Microseconds from one tick to a later one; the counter wraps every 71.6 minutes."""
    return (later_us - earlier_us) % TICKS


@dataclass(frozen=True, slots=True)
class ClockState:
    """How well the device's time is known."""

    locked: bool = False
    """Whether stamps are good to a fraction of a millisecond: two seconds of arrivals lie on a line."""
    drift_ppm: float = 0.0
    """How much faster the device's clock runs than ours."""
    spread_us: float = 0.0
    """Half of the newest arrivals were not later than this after the line."""


class DeviceClock:
    """Fits transmission ticks to arrivals; feed it every telegram in the order of arrival."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The device was restarted, or what was learnt proved wrong: its ticks begin anew."""
        self._origin: tuple[int, int] | None = None
        self._newest_us = 0
        self._newest_ns = 0
        self._samples: deque[tuple[float, float]] = deque(maxlen=MOST_SAMPLES)
        self._buckets: deque[tuple[float, float]] = deque(maxlen=MOST_BUCKETS)
        self._bucket: list[tuple[float, float]] = []
        self._slope = 0.0
        self._edge_us = 0.0
        self._held_up = 0
        self._plausible = False
        self.state = ClockState()

    def stamp_ns(self, arrival_ns: int, scan_tick_us: int, transmit_tick_us: int) -> int:
        """Monotonic time of the scan's tick, given the arrival of the telegram's first byte."""
        delay_us = ticks_between(scan_tick_us, transmit_tick_us)
        if delay_us > _MOST_DELAY_US:
            return arrival_ns  # the ticks contradict each other
        sent_us = self._unwrap(transmit_tick_us, arrival_ns)
        self._learn(sent_us, arrival_ns)
        if not self._plausible:
            return arrival_ns - 1000 * delay_us
        return self._line_ns(sent_us - delay_us)

    def _unwrap(self, tick_us: int, arrival_ns: int) -> int:
        """The tick without wraps: the one nearest to where our clock expects it."""
        if self._origin is None:
            return tick_us
        expected_us = self._newest_us + (arrival_ns - self._newest_ns) // 1000
        return expected_us + (tick_us - expected_us + TICKS // 2) % TICKS - TICKS // 2

    def _learn(self, sent_us: int, arrival_ns: int) -> None:
        if self._origin is None:
            self._origin = (sent_us, arrival_ns)
        self._newest_us, self._newest_ns = sent_us, arrival_ns
        second, late_us = self._coordinates(sent_us, arrival_ns)
        if self._plausible:
            off_us = late_us - self._slope * second - self._edge_us
            self._held_up = self._held_up + 1 if off_us > NEAR_US else 0
            if off_us < EARLY_US or self._held_up >= HELD_UP:
                self.reset()
                self._learn(sent_us, arrival_ns)
                return
        if self._samples and second < self._samples[-1][0]:
            self.reset()  # the device's time went back
            self._learn(sent_us, arrival_ns)
            return
        self._samples.append((second, late_us))
        while self._samples[0][0] < second - WINDOW_S:
            self._samples.popleft()
        self._collect(second, late_us)
        self._fit()

    def _coordinates(self, sent_us: int, arrival_ns: int) -> tuple[float, float]:
        """Device seconds and lateness in microseconds, both since the first telegram."""
        assert self._origin is not None  # noqa: S101 - set by the caller
        first_us, first_ns = self._origin
        elapsed_us = sent_us - first_us
        return elapsed_us / 1e6, (arrival_ns - first_ns) / 1e3 - elapsed_us

    def _collect(self, second: float, late_us: float) -> None:
        """The lower edge of each second, from which the slope comes."""
        bucket = self._bucket
        if bucket and int(second / BUCKET_S) != int(bucket[0][0] / BUCKET_S):
            low = sorted(bucket, key=lambda sample: sample[1])[round(EDGE * (len(bucket) - 1))]
            self._buckets.append(low)
            self._slope = _slope(self._buckets)
            bucket.clear()
        if len(bucket) < MOST_SAMPLES:
            bucket.append((second, late_us))

    def _fit(self) -> None:
        samples = np.array(self._samples)
        level = samples[:, 1] - self._slope * samples[:, 0]
        level.sort()
        self._edge_us = float(level[round(EDGE * (len(level) - 1))])
        spread_us = float(level[len(level) // 2]) - self._edge_us
        self._plausible = spread_us < NEAR_US and abs(self._slope) < MOST_DRIFT_PPM
        self.state = ClockState(self._plausible and len(level) >= ENOUGH, -self._slope, spread_us)

    def _line_ns(self, tick_us: int) -> int:
        assert self._origin is not None  # noqa: S101 - there is no line before the first telegram
        first_us, first_ns = self._origin
        elapsed_us = tick_us - first_us
        return first_ns + 1000 * elapsed_us + round(1000 * (self._edge_us + self._slope * elapsed_us / 1e6))


def _slope(points: deque[tuple[float, float]]) -> float:
    """Median of the slopes between all pairs of points, drawn towards zero while they are close together."""
    if len(points) < 3:
        return 0.0
    second, late_us = np.array(points).T
    one, two = np.triu_indices(len(points), 1)
    slope = float(np.median((late_us[two] - late_us[one]) / (second[two] - second[one])))
    spread = float(np.sum((second - second.mean()) ** 2))
    return slope * spread / (spread + STEADY_S2)
