"""When the simulated mirror turns, the device's clock ticks, and answers and telegrams leave: as measured on real ones.

Sources: fact sheet sections 1 and 5 (captures of a TiM571, TiM561 and TiM781S) and 3 (start-up log of a TiM5xx).
"""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

from drivers.tim571.codec.scandata import TICKS
from drivers.tim571.geometry import SCAN_RATE_HZ

# Periods of a real motor: mean 66,666.3 us, standard deviation 34 us, successive ones correlated by 0.53.
MEAN_PERIOD_S = 66_666.3e-6
PERIOD_SIGMA_S = 34e-6
PERIOD_CORRELATION = 0.53
PERIOD_BOUNDS_S = (66_497e-6, 66_780e-6)

TRANSMIT_DELAY_S = (0.0071, 0.0079)  # last beam to transmission: 7.1 ms on a TiM571; its sisters spread over 0.9 ms
SLOW_TRANSMIT_S = 0.0109  # the worst seen
SLOW_TRANSMIT_CHANCE = 0.001
SCAN_CLOCK_LAG_S = (0.0018, 0.0034)  # the time block is read that much after the scan tick

ANSWER_S = {
    "SetAccessMode": (0.0054, 0.0066),
    "Run": (0.0050, 0.0056),
    "LMDscandata": (0.0040, 0.0046),
    "LMDscandatamon": (0.0040, 0.0046),
}
OTHER_ANSWERS_S = (0.0011, 0.0023)


def answer_delay_s(kind: str, name: str, chance: Random) -> float:
    """How long the device takes to answer; a poll of the newest scan is a read like any other."""
    return chance.uniform(*(OTHER_ANSWERS_S if kind == "sRN" else ANSWER_S.get(name, OTHER_ANSWERS_S)))


class Motor:
    """The periods of the mirror, one after the other."""

    def __init__(self, rate_hz: float, seed: int) -> None:
        self._scale = SCAN_RATE_HZ / rate_hz
        self._chance = Random(seed)  # noqa: S311 - physics, not secrets
        self._off_s = 0.0

    def period_s(self) -> float:
        """The next revolution."""
        fresh_s = PERIOD_SIGMA_S * (1 - PERIOD_CORRELATION**2) ** 0.5
        self._off_s = PERIOD_CORRELATION * self._off_s + self._chance.gauss(0.0, fresh_s)
        low, high = PERIOD_BOUNDS_S
        return self._scale * min(max(MEAN_PERIOD_S + self._off_s, low), high)


def transmit_delay_s(chance: Random) -> float:
    """From the last beam until the telegram is sent."""
    return SLOW_TRANSMIT_S if chance.random() < SLOW_TRANSMIT_CHANCE else chance.uniform(*TRANSMIT_DELAY_S)


@dataclass(slots=True)
class DeviceTime:
    """The device's microsecond counter against our monotonic clock."""

    power_on_s: float
    drift_ppm: float = 0.0
    """How much faster than ours it runs."""
    at_power_on_us: int = 0

    def tick_us(self, now_s: float) -> int:
        """The counter as on the wire."""
        elapsed_us = (now_s - self.power_on_s) * (1e6 + self.drift_ppm)
        return (round(elapsed_us) + self.at_power_on_us) % TICKS
