from __future__ import annotations

import time

from ghal360_robot.logbook.clock import Anchor


def test_the_anchor_ties_both_clocks_together_and_back() -> None:
    anchor = Anchor.now()
    assert abs(anchor.to_wall(time.monotonic_ns()) - time.time_ns()) < 1e9
    instant = 1_000_000_000_000_000_001
    assert anchor.to_monotonic(anchor.to_wall(instant)) == instant


def test_one_anchor_keeps_differences_to_the_nanosecond() -> None:
    anchor = Anchor(7, 1_800_000_000_000_000_003)
    assert anchor.to_wall(8) - anchor.to_wall(7) == 1
    assert anchor.to_wall(7) == 1_800_000_000_000_000_003
