from __future__ import annotations

import pytest

from ghal360_robot.safety.watchdog import gap


@pytest.mark.parametrize(
    ("before_ns", "now_ns", "why"),
    [
        (None, 10**18, ""),
        (0, 150_000_000, ""),
        (0, 150_000_001, "the control loop stood still for 0.15 s"),
        (5, 5, ""),
        (5, 4, "the clock ran backwards"),
        (0, 3_456_000_000, "the control loop stood still for 3.46 s"),
    ],
)
def test_a_tick_is_in_time_or_it_says_how_late_it_is(before_ns: int | None, now_ns: int, why: str) -> None:
    assert gap(before_ns, now_ns) == why


def test_the_limit_is_a_setting() -> None:
    assert gap(0, 400_000_000, 0.5) == ""
    assert gap(0, 600_000_000, 0.5) != ""
