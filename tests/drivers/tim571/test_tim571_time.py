"""Stamps: the device's ticks on our clock, the beams of a revolution, and a robot's motion taken out of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.tim571.codec.scandata import ScanData
from drivers.tim571.deskew import Twist, deskew, sensor_twist
from drivers.tim571.device.clock import DeviceClock
from drivers.tim571.device.scan import Beam, DeviceStatus, scan_of
from drivers.tim571.geometry import BEAM_YAW, BEAMS, beam_lags_s
from drivers.tim571.simulator.timing import DeviceTime, Motor, transmit_delay_s

WRAP = 1 << 32
LATENCIES: dict[str, Callable[[Random], float]] = {
    "exponential": lambda chance: chance.expovariate(1 / 100e-6),
    "half normal": lambda chance: abs(chance.gauss(0, 100e-6)),
    "normal": lambda chance: chance.gauss(0, 100e-6),
    "uniform": lambda chance: chance.uniform(0, 100e-6),
}


def errors_us(
    clock: DeviceClock,
    seconds: float,
    drift_ppm: float,
    latency: Callable[[Random], float],
    seed: int,
    stall_chance: float = 0.02,
    from_s: float = 5.0,
    first_tick_us: int = 0,
) -> list[float]:
    """Stamp minus truth of each scan from `from_s` on, with stalls of 70 ms behind which telegrams queue."""
    chance, motor = Random(seed), Motor(15.0, seed)
    device = DeviceTime(3600.0, drift_ppm, first_tick_us)
    end_s, free_s, errors = 3600.0, 0.0, []
    while end_s < 3600.0 + seconds:
        end_s += motor.period_s()
        sent_s = end_s + transmit_delay_s(chance)
        arrival_s = sent_s + latency(chance)
        if chance.random() < stall_chance:
            free_s = arrival_s + 0.070
        arrival_s = max(arrival_s, free_s)
        stamp_ns = clock.stamp_ns(round(arrival_s * 1e9), device.tick_us(end_s), device.tick_us(sent_s))
        if end_s > 3600.0 + from_s:
            errors.append((stamp_ns / 1e9 - end_s) * 1e6)
    return errors


@pytest.mark.parametrize("latency", LATENCIES.values(), ids=LATENCIES)
@pytest.mark.parametrize("drift_ppm", [5.0, -5.0, 40.0])
def test_stamps_are_within_200_us_after_five_seconds(latency: Callable[[Random], float], drift_ppm: float) -> None:
    clock = DeviceClock()
    found = errors_us(clock, 15.0, drift_ppm, latency, seed=7)
    assert max(abs(error) for error in found) < 200
    assert clock.state.locked


def test_the_drift_is_found_within_a_minute() -> None:
    clock = DeviceClock()
    errors_us(clock, 60.0, 25.0, LATENCIES["exponential"], seed=2)
    assert clock.state.drift_ppm == pytest.approx(25.0, abs=1.5)


def test_the_ticks_wrap_without_a_trace_and_so_they_do_over_hours_of_silence() -> None:
    clock = DeviceClock()
    found = errors_us(clock, 12.0, 5.0, LATENCIES["uniform"], seed=1, first_tick_us=WRAP - 8_000_000)
    assert max(abs(error) for error in found) < 200
    for hours in (1, 5, 40):
        device = DeviceTime(0.0)
        clock = DeviceClock()
        for number in range(40):
            now_s = 100.0 + number / 15
            clock.stamp_ns(round(now_s * 1e9), device.tick_us(now_s - 0.007), device.tick_us(now_s))
        later_s = 100.0 + hours * 3600
        stamp_ns = clock.stamp_ns(round(later_s * 1e9), device.tick_us(later_s - 0.007), device.tick_us(later_s))
        assert stamp_ns / 1e9 == pytest.approx(later_s - 0.007, abs=2e-3)


def test_a_long_stall_does_not_move_the_stamps() -> None:
    clock = DeviceClock()
    errors_us(clock, 20.0, 5.0, LATENCIES["uniform"], seed=3)
    device = DeviceTime(3600.0, 5.0)
    for number in range(10):  # all arrive at once, 0.7 s late
        end_s = 3620.1 + number / 15
        sent = device.tick_us(end_s + 0.007)
        stamp_ns = clock.stamp_ns(round(3620.8 * 1e9) + number, device.tick_us(end_s), sent)
        assert stamp_ns / 1e9 == pytest.approx(end_s, abs=200e-6)


def test_a_wrong_line_is_dropped_at_once_if_early_and_soon_if_late() -> None:
    for jump_s in (-0.5, 0.5):
        clock = DeviceClock()
        for number in range(200):
            jumped = number >= 100
            now_s = 100.0 + number / 15
            tick = round((now_s - (jump_s if jumped else 0.0)) * 1e6)
            stamp_ns = clock.stamp_ns(round(now_s * 1e9), tick - 7000, tick)
            if not 100 <= number < 116:
                assert stamp_ns / 1e9 == pytest.approx(now_s - 0.007, abs=1e-4)


def test_a_player_of_recordings_at_the_wrong_speed_is_stamped_by_arrival() -> None:
    clock = DeviceClock()
    for number in range(300):
        arrival_s = 50.0 + number * 0.069
        tick = round(number * 66_667)
        stamp_ns = clock.stamp_ns(round(arrival_s * 1e9), tick, tick + 7_000)
        if number > 75:
            assert not clock.state.locked
            assert stamp_ns / 1e9 == pytest.approx(arrival_s - 0.007, abs=1e-6)


@given(st.lists(st.tuples(st.integers(0, 10**10), st.integers(0, WRAP - 1), st.integers(0, WRAP - 1)), max_size=40))
@settings(max_examples=60, deadline=None)
def test_any_ticks_at_any_time_give_a_stamp(arrivals: list[tuple[int, int, int]]) -> None:
    clock, now_ns = DeviceClock(), 0
    for later_ns, scan_us, sent_us in arrivals:
        now_ns += later_ns
        assert isinstance(clock.stamp_ns(now_ns, scan_us, sent_us), int)


@pytest.mark.parametrize("tick_marks", Beam)
@pytest.mark.parametrize("stamp_marks", Beam)
def test_the_stamp_is_the_beam_that_was_asked_for(
    make_scan: Callable[..., ScanData], tick_marks: Beam, stamp_marks: Beam
) -> None:
    tick_ns = 10**12
    scan = scan_of(make_scan(), tick_ns, tick_ns, b"", tick_marks=tick_marks, stamp_marks=stamp_marks)
    first_ns = tick_ns - (50_000_000 if tick_marks is Beam.LAST else 0)
    beams_s = scan.stamp_ns / 1e9 + scan.offsets_s.astype(np.float64)
    assert beams_s[[0, 405, -1]] == pytest.approx([first_ns / 1e9 + late for late in (0, 0.025, 0.050)], abs=1e-6)
    assert np.diff(scan.offsets_s) == pytest.approx(61.73e-6, abs=0.05e-6)
    assert scan.offsets_s[-1 if stamp_marks is Beam.LAST else 0] == pytest.approx(0, abs=1e-7)


def test_a_part_of_the_revolution_keeps_its_place_in_time() -> None:
    whole, part = beam_lags_s(-450_000, 3333, BEAMS, 15.0), beam_lags_s(0, 3333, 541, 15.0)
    assert np.array_equal(whole[135:676], part)


@pytest.mark.parametrize(
    ("word", "status", "ok"),
    [
        ((0, 0), DeviceStatus.OK, True),
        ((1, 0), DeviceStatus.ERROR, False),
        ((2, 0), DeviceStatus.POLLUTION_WARNING, False),
        ((5, 0), DeviceStatus.POLLUTION_ERROR, False),
        ((0, 1), DeviceStatus.UNKNOWN, False),
    ],
)
def test_the_device_status_is_told(
    make_scan: Callable[..., ScanData], word: tuple[int, int], status: DeviceStatus, ok: bool
) -> None:
    scan = scan_of(make_scan(status=word), 0, 0, b"")
    assert (scan.status, scan.device_ok) == (status, ok)
    assert str(scan.status)


LAGS = beam_lags_s(-450_000, 3333, BEAMS, 15.0)


def driven(walls: np.ndarray, v: float, w: float, x: float, y: float, yaw: float, down: bool) -> np.ndarray:
    """Ranges to points on the floor that each beam of a moving robot hits, by integrating its motion finely."""
    points, side = np.full((BEAMS, 2), np.nan), -1.0 if down else 1.0
    for beam, lag_s in enumerate(LAGS.astype(float)):
        # The base's pose at that beam, with the base's frame at the stamp as the world.
        turned = w * lag_s
        radius = v / w if w else math.inf
        base = (radius * math.sin(turned), radius * (1 - math.cos(turned))) if w else (v * lag_s, 0.0)
        here = np.array(base) + rotation(turned) @ np.array([x, y])
        direction = rotation(turned + yaw) @ np.array([math.cos(BEAM_YAW[beam]), side * math.sin(BEAM_YAW[beam])])
        distance = walls[beam]
        hit = here + distance * direction
        at_stamp = rotation(-yaw) @ (hit - np.array([x, y]))
        points[beam] = at_stamp * [1.0, side]
    return points


def rotation(angle: float) -> np.ndarray:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


@pytest.mark.parametrize("down", [False, True])
@pytest.mark.parametrize(("v", "w"), [(1.0, 0.0), (0.0, 2.0), (0.8, -1.5), (0.0, 0.0), (0.5, 1e-12)])
def test_motion_is_taken_out_exactly(v: float, w: float, down: bool) -> None:
    rng = np.random.default_rng(1)
    ranges = rng.uniform(0.5, 20.0, BEAMS)
    mounting = (0.2, -0.05, 0.3)
    points = deskew(ranges, BEAM_YAW, LAGS, sensor_twist(v, w, *mounting, upside_down=down))
    assert points == pytest.approx(driven(ranges, v, w, *mounting, down), abs=2e-5)


def test_a_beam_without_range_stays_without_a_point() -> None:
    ranges = np.full(BEAMS, 2.0, np.float32)
    ranges[[0, 400]] = np.nan
    points = deskew(ranges, BEAM_YAW, LAGS, Twist(1.0, 0.0, 1.0))
    assert np.isnan(points).all(axis=1).sum() == 2
    assert points.shape == (BEAMS, 2)
    assert not np.shares_memory(points, ranges)


def test_standing_still_nothing_is_moved() -> None:
    points = deskew(np.ones(BEAMS), BEAM_YAW, LAGS, Twist(0.0, 0.0, 0.0))
    assert points == pytest.approx(np.column_stack((np.cos(BEAM_YAW), np.sin(BEAM_YAW))), abs=1e-7)


def test_the_motor_wanders_as_the_real_one() -> None:
    motor = Motor(15.0, 4)
    periods = np.array([motor.period_s() for _ in range(6000)]) * 1e6
    assert periods.mean() == pytest.approx(66_666.3, abs=3)
    assert periods.std() == pytest.approx(34, rel=0.1)
    assert np.corrcoef(periods[:-1], periods[1:])[0, 1] == pytest.approx(0.53, abs=0.06)
    assert periods.min() >= 66_497
    assert periods.max() <= 66_780
    assert all(later != earlier for earlier, later in pairwise(periods[:20]))
