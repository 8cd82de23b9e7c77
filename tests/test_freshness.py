from __future__ import annotations

import math

from ghal360_robot.freshness import RateWatch

SECOND = 1_000_000_000


def test_an_input_never_seen_is_not_alive_and_infinitely_old() -> None:
    fresh = RateWatch(15.0, 0.3).at(SECOND, valid=True)
    assert not fresh.alive
    assert fresh.age_s == math.inf


def test_a_steady_input_is_alive_at_rate_and_valid() -> None:
    watch = RateWatch(15.0, 0.3)
    for n in range(45):
        watch.note(n * SECOND // 15)
    fresh = watch.at(44 * SECOND // 15 + 1_000_000, valid=True)
    assert (fresh.alive, fresh.rate_ok, fresh.valid) == (True, True, True)
    assert fresh.age_s == 0.001


def test_a_slow_input_is_alive_but_not_at_rate() -> None:
    watch = RateWatch(15.0, 0.3)
    for n in range(20):
        watch.note(n * SECOND // 5)
    fresh = watch.at(19 * SECOND // 5, valid=True)
    assert fresh.alive
    assert not fresh.rate_ok


def test_silence_ages_and_a_return_starts_a_new_rate() -> None:
    watch = RateWatch(15.0, 0.3)
    for n in range(45):
        watch.note(n * SECOND // 15)
    silent = watch.at(8 * SECOND, valid=True)
    assert not silent.alive
    assert silent.age_s > 5
    for n in range(12):
        watch.note(8 * SECOND + n * SECOND // 15)
    assert watch.at(8 * SECOND + 12 * SECOND // 15, valid=True).rate_ok


def test_an_invalid_input_is_never_ok() -> None:
    watch = RateWatch(15.0, 0.3)
    watch.note(0)
    assert not watch.at(1, valid=False).valid
