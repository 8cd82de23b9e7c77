from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.timing import BIN_MS, Lateness


@given(st.lists(st.floats(0, 900), min_size=1, max_size=200), st.floats(1, 100))
def test_a_percentile_is_within_one_bin_of_the_sorted_sample(values: list[float], percent: float) -> None:
    lateness = Lateness()
    for value in values:
        lateness.note(value)
    exact = float(np.percentile(values, percent, method="inverted_cdf"))
    assert exact - 1e-9 <= lateness.percentile_ms(percent) + BIN_MS
    assert lateness.percentile_ms(percent) <= exact + BIN_MS + 1e-9


def test_what_is_later_than_the_histogram_keeps_its_maximum() -> None:
    lateness = Lateness()
    lateness.note(4_000.0)
    assert lateness.summary()["max"] == 4_000.0


def test_before_the_first_tick_all_is_zero() -> None:
    assert Lateness().summary() == {"p50": 0.0, "p99": 0.0, "max": 0.0}
    assert Lateness().percentile_ms(99) == pytest.approx(0.0)
