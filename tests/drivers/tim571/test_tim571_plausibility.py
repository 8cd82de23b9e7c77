"""Telegrams that cannot be true are doubted, and a device that is just unusual is believed in the end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks import lidar_damage
from drivers.tim571.codec import scandata
from drivers.tim571.codec.commands import OutputContent
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.plausibility import Plausibility
from drivers.tim571.codec.scandata import Channel, Position, ScanData
from drivers.tim571.codec.telegram import parse

Make = Callable[..., ScanData]


def with_samples(scan: ScanData, samples: Any) -> ScanData:
    return replace(scan, channels16=(replace(scan.channels16[0], samples=np.asarray(samples, np.uint16)),))


SPOILT: dict[str, tuple[Callable[[ScanData], ScanData], str]] = {
    "serial number": (lambda s: replace(s, serial=s.serial ^ 0x10000), "fields"),
    "status": (lambda s: replace(s, status=(0x40, 0)), "fields"),
    "scan frequency": (lambda s: replace(s, scan_frequency_chz=1501), "fields"),
    "step": (lambda s: replace(s, channels16=(replace(s.channels16[0], step_1e4deg=3332),)), "fields"),
    "scale": (lambda s: replace(s, channels16=(replace(s.channels16[0], scale=float("nan")),)), "fields"),
    "name": (lambda s: replace(s, name="x"), "fields"),
    "block": (lambda s: replace(s, position=Position(0, 0, 0, 0, 0, 0, 0)), "fields"),
    "scan counter": (lambda s: replace(s, scan_counter=s.scan_counter ^ 0x100), "counters"),
    "telegram counter": (lambda s: replace(s, telegram_counter=s.telegram_counter + 1), "counters"),
    "scan tick": (lambda s: replace(s, scan_tick_us=s.scan_tick_us + 4096), "ticks"),
    "transmit tick": (lambda s: replace(s, transmit_tick_us=s.transmit_tick_us ^ 0x10000000), "ticks"),
    "a range beyond the device's": (lambda s: with_samples(s, [500] * 810 + [27_000]), "too far"),
    "something behind the end": (lambda s: replace(s, trailing=b"\x02\x02"), "contradiction"),
    "spelling": (lambda s: replace(s, canonical=False), "spelling"),
}


@pytest.mark.parametrize(("spoil", "doubt"), SPOILT.values(), ids=SPOILT)
def test_one_spoilt_field_is_doubted_and_the_next_telegram_believed(
    make_scan: Make, spoil: Callable[[ScanData], ScanData], doubt: str
) -> None:
    plausibility = Plausibility()
    for counter in range(10):
        scan = make_scan(counter)
        assert plausibility.doubts(scan) == frozenset()
        if counter in (3, 6):
            assert doubt in plausibility.doubts(spoil(make_scan(counter + 1)))


@pytest.mark.parametrize(("spoil", "doubt"), SPOILT.values(), ids=SPOILT)
def test_what_stays_as_it_became_is_believed_from_the_second_telegram_on(
    make_scan: Make, spoil: Callable[[ScanData], ScanData], doubt: str
) -> None:
    plausibility = Plausibility()
    plausibility.doubts(make_scan(0))
    believed = [not plausibility.doubts(spoil(make_scan(counter))) for counter in range(1, 9)]
    assert believed == [False] + [True] * 7


def test_a_range_without_an_echo_is_doubted(make_scan: Make) -> None:
    strengths = np.full(811, 100, np.uint8)
    good = make_scan(0, channels8=(Channel("RSSI1", 1.0, 0.0, -450000, 3333, strengths),))
    spoilt = strengths.copy()
    spoilt[5] = 0
    plausibility = Plausibility()
    assert not plausibility.doubts(good)
    assert plausibility.doubts(replace(good, channels8=(replace(good.channels8[0], samples=spoilt),))) == {"no echo"}


def test_a_first_telegram_that_contradicts_itself_is_doubted(make_scan: Make) -> None:
    good = make_scan(0)
    (row,) = good.channels16
    rssi = replace(row, tag="RSSI1", samples=row.samples[:-1])
    for spoilt in (
        replace(good, channels16=(row, rssi)),
        replace(good, channels16=(replace(row, tag="DIST\x00"),)),
        replace(good, channels16=(replace(row, start_1e4deg=-450001),)),
        replace(good, channels16=(replace(row, step_1e4deg=3400),)),
    ):
        assert Plausibility().doubts(spoilt) == {"contradiction"}


def test_scans_may_be_missing_repeated_or_wrap(make_scan: Make) -> None:
    plausibility = Plausibility()
    for counter in (0, 0, 1, 5, 900, 65_533, 65_534, 65_538, 65_700):
        scan = make_scan(counter)
        wrapped = replace(
            scan,
            telegram_counter=counter % 65536,
            scan_counter=(counter + 2) % 65536,
            scan_tick_us=(scan.scan_tick_us + (1 << 32) - 4_000_000_000) % (1 << 32),
            transmit_tick_us=(scan.transmit_tick_us + (1 << 32) - 4_000_000_000) % (1 << 32),
        )
        assert plausibility.doubts(wrapped) == frozenset(), counter


def test_a_device_that_is_unusual_now_and_then_loses_a_few_scans_and_no_more(make_scan: Make) -> None:
    plausibility = Plausibility()
    lost = 0
    for counter in range(600):
        scan = make_scan(counter)
        lost += bool(plausibility.doubts(with_samples(scan, [30_000] * 811) if counter % 3 == 0 else scan))
    assert 3 <= lost <= 8


def test_a_device_whose_time_runs_backwards_is_believed_after_a_few_scans(make_scan: Make) -> None:
    plausibility = Plausibility()
    order = [*range(40), *reversed(range(39)), *range(1, 40)]
    lost = [bool(plausibility.doubts(make_scan(counter))) for counter in order]
    assert sum(lost) <= 2


def test_real_recordings_raise_no_doubt(cola_a_scans: list[bytes], cola_b_scans: list[bytes]) -> None:
    for dialect, frames in ((Dialect.A, cola_a_scans), (Dialect.B, cola_b_scans)):
        plausibility = Plausibility()
        assert not any(plausibility.doubts(scandata.decode(parse(dialect, framed))) for framed in frames)


OUTPUTS = [OutputContent(), OutputContent(rssi=True), OutputContent(rssi=True, rssi_bits=16)]


@pytest.mark.parametrize("output", OUTPUTS, ids=str)
def test_flipped_bytes_cost_the_telegrams_they_hit_and_none_besides(output: OutputContent) -> None:
    found = lidar_damage.flips(Dialect.B, output, 500, seed=3)
    assert found.damaged > 25
    assert (found.lost_good, found.missed) == (0, 0)
    assert found.counted == found.damaged
    text = lidar_damage.flips(Dialect.A, output, 250, seed=3)
    assert text.lost_good == 0
    assert text.missed < 0.09 * text.damaged  # without a checksum: a digit for a digit; 4 % in the long run


def test_bursts_that_the_checksum_misses_are_found_by_plausibility() -> None:
    plain = lidar_damage.lucky_bursts(OutputContent(), 300, seed=1)
    assert plain.past_the_frame > 0.95 * plain.damaged
    assert plain.miss_rate < 0.12
    for output in OUTPUTS[1:]:
        assert lidar_damage.lucky_bursts(output, 150, seed=1).miss_rate < 0.65
    text = lidar_damage.bursts(Dialect.A, OutputContent(), 150, seed=1)
    assert (text.lost_good, text.missed) == (0, 0)
