"""The simulated optics: a world's distances to the samples and telegrams of a TiM571."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.tim571.codec.commands import OutputContent, OutputRange
from drivers.tim571.codec.scandata import COUNTS, Channel, ScanData
from drivers.tim571.geometry import (
    BEAM_YAW,
    BEAMS,
    FARTHEST_M,
    FIRST_ANGLE_1E4DEG,
    NEAREST_M,
    WIRE_STEP_1E4DEG,
    beam_index,
)

ScanSource = Callable[[int], tuple[NDArray[np.floating], NDArray[np.floating] | None]]
"""The world: `source(stamp_ns)` gives distances (811,) in metres along `BEAM_YAW` (inf, NaN or out of range: no
echo) and, if it knows them, signal strengths (811,) in 8-bit digits (1..254)."""

NOISE_SIGMA_M = 0.020  # statistical error, 1 sigma, operating instructions
MEASURING_FREQUENCY_100HZ = 162
_SMALLEST_RANGE_MM = 16  # smaller values are codes
_RSSI_16_PER_8 = 160  # 16-bit digits reach 40,960 where 8-bit ones reach 254
_STRONGEST_RSSI = 254.0


def beams_of(sector: OutputRange) -> slice:
    """The beams that lie inside."""
    return slice(max(0, beam_index(sector.start_1e4deg)), min(BEAMS, beam_index(sector.stop_1e4deg) + 1))


@dataclass(frozen=True, slots=True)
class Revolution:
    """One turn of the mirror: when its last beam was, in our time and the device's, and its numbers."""

    end_ns: int
    tick_us: int
    scan_counter: int
    telegram_counter: int

    def after(self, turns: int) -> Revolution:
        """The numbers so many revolutions later; both wrap at 65536."""
        scans, telegrams = self.scan_counter + turns, self.telegram_counter + turns
        return replace(self, scan_counter=scans % COUNTS, telegram_counter=telegrams % COUNTS)


class Scanner:
    """Measures the world once per revolution, with noise that depends on seed and scan counter only."""

    def __init__(self, source: ScanSource, seed: int, noise_sigma_m: float = NOISE_SIGMA_M) -> None:
        self._source = source
        self._seed = seed
        self._noise_sigma_m = noise_sigma_m
        self._measured: tuple[Revolution, NDArray[np.uint16], NDArray[np.uint8]] | None = None

    def scan(
        self, turn: Revolution, serial: int, rate_hz: float, output: OutputContent, sector: OutputRange, name: str,
        status: tuple[int, int],
    ) -> ScanData:  # fmt: skip
        """The revolution as a telegram with the content that the device is set to, still to be stamped and sent."""
        millimetres, rssi = self._measure(turn)
        beams = beams_of(sector)
        # The first sample's angle is that of a beam, not what was asked for.
        start = FIRST_ANGLE_1E4DEG + round(beams.start * 10_000 / 3)

        def channel(tag: str, samples: NDArray[np.uint8 | np.uint16]) -> Channel:
            return Channel(tag, 1.0, 0.0, start, WIRE_STEP_1E4DEG, samples[beams])

        wide = [channel("DIST1", millimetres)]
        slim = []
        if output.rssi and output.rssi_bits == 16:
            wide.append(channel("RSSI1", rssi.astype(np.uint16) * np.uint16(_RSSI_16_PER_8)))
        elif output.rssi:
            slim.append(channel("RSSI1", rssi))
        return ScanData(
            version=1,
            device=1,
            serial=serial,
            status=status,
            telegram_counter=turn.telegram_counter,
            scan_counter=turn.scan_counter,
            scan_tick_us=turn.tick_us,
            transmit_tick_us=turn.tick_us,
            inputs=(0, 0),
            outputs=(1, 0),
            layer=0,
            scan_frequency_chz=round(100 * rate_hz),
            measuring_frequency_100hz=MEASURING_FREQUENCY_100HZ,
            channels16=tuple(wide),
            channels8=tuple(slim),
            name=name if output.name else None,
        )

    def _measure(self, turn: Revolution) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
        if self._measured is None or self._measured[0] != turn:
            distances, strengths = self._source(turn.end_ns)
            rng = np.random.default_rng((self._seed, turn.scan_counter))
            self._measured = (turn, *sample(distances, strengths, rng, self._noise_sigma_m))
        return self._measured[1:]


def sample(
    distances: NDArray[np.floating],
    strengths: NDArray[np.floating] | None,
    rng: np.random.Generator,
    noise_sigma_m: float,
) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Distances in metres to millimetres as on the wire (0: no echo), and 8-bit RSSI that is 0 exactly there."""
    if distances.shape != (BEAMS,):
        raise ValueError(f"a scan source gives {BEAMS} distances, this one gave {distances.shape}")
    noise = rng.normal(0.0, noise_sigma_m, BEAMS)
    seen = np.isfinite(distances) & (distances >= NEAREST_M) & (distances <= FARTHEST_M)
    metres = np.where(seen, distances, 0.0)
    millimetres = np.clip(np.round((metres + noise) * 1000), _SMALLEST_RANGE_MM, 0xFFFF)
    if strengths is None:
        strengths = _STRONGEST_RSSI * (1.0 - metres / (2 * FARTHEST_M))
    digits = np.clip(np.round(np.nan_to_num(strengths, nan=1.0)), 1, _STRONGEST_RSSI)
    return np.where(seen, millimetres, 0).astype(np.uint16), np.where(seen, digits, 0).astype(np.uint8)


ROOM_M = (3.2, 2.1)  # half length ahead, half width: a small office
_DOOR_YAW = (0.35, 0.60)  # radians: through the open door nothing comes back


def empty_room(_stamp_ns: int) -> tuple[NDArray[np.floating], None]:
    """A world for whoever brings none: four walls and an open door."""
    with np.errstate(divide="ignore"):
        ahead = ROOM_M[0] / np.abs(np.cos(BEAM_YAW))
        aside = ROOM_M[1] / np.abs(np.sin(BEAM_YAW))
    walls = np.minimum(ahead, aside)
    door = (_DOOR_YAW[0] < BEAM_YAW) & (_DOOR_YAW[1] > BEAM_YAW)
    return np.where(door, np.inf, walls), None
