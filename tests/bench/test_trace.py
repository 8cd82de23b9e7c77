"""From what the base heard and did to the figures of one stop."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.bench.stop import BASE_TIMEOUT_MS, CAUSES, Cause, Result, Sample
from ghal360_robot.bench.trace import STANDSTILL_MPS, Stop, Trace

MS = 1_000_000
SURVIVED = next(cause for cause in CAUSES if cause.zero_comes)
DEADLY = next(cause for cause in CAUSES if not cause.zero_comes)


def trace(motion: dict[int, bool], speeds: dict[int, float]) -> Trace:
    """Stamps in milliseconds."""
    return Trace([(t * MS, moves) for t, moves in motion.items()], [(t * MS, v) for t, v in speeds.items()])


def test_zero_counts_from_the_first_after_which_nothing_asks_for_motion() -> None:
    stop = trace({0: True, 20: True, 40: False, 60: True, 80: False, 100: False}, {0: 0.4, 200: 0.0}).stop_after(
        10 * MS
    )
    assert (stop.last_motion_ms, stop.zero_ms) == (50.0, 70.0)


def test_frames_that_just_cease_are_no_zero() -> None:
    stop = trace({0: True, 20: True}, {0: 0.4, 900: 0.0}).stop_after(30 * MS)
    assert (stop.last_motion_ms, stop.zero_ms) == (0.0, None)
    assert stop.standstill_ms == 870.0


def test_a_base_that_rolls_on_again_did_not_stand_still() -> None:
    stop = trace({}, {0: 0.4, 500: 0.0, 600: 0.1, 700: 0.005, 800: 0.0}).stop_after(0)
    assert stop.standstill_ms == 700.0
    assert trace({}, {0: 0.4, 500: 0.0, 600: 0.1}).stop_after(0).standstill_ms is None


def test_speed_is_the_last_one_before_the_cause() -> None:
    assert trace({}, {0: 0.3, 10: 0.4, 20: 0.1}).stop_after(15 * MS).speed_mps == 0.4
    with pytest.raises(ValueError, match="begins after"):
        trace({}, {10: 0.4}).stop_after(5 * MS)


@given(st.lists(st.tuples(st.booleans(), st.floats(-1, 1)), min_size=1, max_size=30), st.integers(0, 30))
def test_no_motion_lies_behind_the_zero_and_none_behind_standstill(steps: list[tuple[bool, float]], at: int) -> None:
    whole = trace({20 * k: moves for k, (moves, _) in enumerate(steps)}, {20 * k: v for k, (_, v) in enumerate(steps)})
    cause_ns = min(at, len(steps) - 1) * 20 * MS
    stop = whole.stop_after(cause_ns)
    if stop.zero_ms is not None:
        assert not any(moves for stamp, moves in whole.motion if stamp >= cause_ns + stop.zero_ms * MS)
        assert stop.last_motion_ms < stop.zero_ms
    if stop.standstill_ms is not None:
        later = [v for stamp, v in whole.speeds if stamp >= cause_ns + stop.standstill_ms * MS]
        assert later
        assert max(map(abs, later)) < STANDSTILL_MPS


def test_driving_is_steady_only_after_its_whole_time() -> None:
    fast = {k * 10: 0.45 for k in range(40)}
    assert trace({}, fast).steady(0.43, 300 * MS)
    assert not trace({}, {**fast, 250: 0.2}).steady(0.43, 300 * MS)
    assert not trace({}, {k * 10: 0.45 for k in range(20)}).steady(0.43, 300 * MS)


def sample(cause: Cause, to_zero_ms: float | None, standstill_ms: float | None) -> Sample:
    return Sample(Stop(0.45, 0.0, to_zero_ms, standstill_ms), to_zero_ms, cause.limits_ms(0.45), ())


def test_a_stop_passes_only_where_both_happened_in_time() -> None:
    assert sample(SURVIVED, 299.0, 1200.0).passed()
    assert not sample(SURVIVED, 301.0, 1200.0).passed()
    assert sample(SURVIVED, 301.0, 1200.0).passed(allowance_ms=10.0)
    assert not sample(SURVIVED, None, 1200.0).passed(allowance_ms=1e6)
    assert not sample(SURVIVED, 200.0, None).passed(allowance_ms=1e6)
    assert not sample(SURVIVED, 200.0, 1500.0).passed()


def test_a_base_left_alone_may_roll_for_its_own_timeout() -> None:
    after_zero = SURVIVED.limits_ms(0.45)[1] - SURVIVED.limits_ms(0.45)[0]
    assert DEADLY.limits_ms(0.45)[1] == pytest.approx(BASE_TIMEOUT_MS + 20.0 + after_zero)


def test_a_cause_is_judged_by_its_worst_sample() -> None:
    good, late, never = (sample(SURVIVED, ms, 1200.0) for ms in (200.0, 400.0, None))
    assert Result(SURVIVED, (good, good)).passed
    assert not Result(SURVIVED, (good, good, late)).passed
    told = Result(SURVIVED, (good, good, late)).to_json()
    assert (told["to_zero_ms"], told["to_zero_worst_ms"], told["passed"]) == (200.0, 400.0, False)
    assert Result(SURVIVED, (good, never)).to_json()["to_zero_worst_ms"] is None


def test_what_could_not_be_measured_did_not_pass() -> None:
    good = sample(SURVIVED, 200.0, 1200.0)
    assert not Result(SURVIVED, ()).passed
    assert not Result(SURVIVED, (good,), "the robot does not drive").passed
    told = Result(SURVIVED, (), "the robot does not drive").to_json()
    assert (told["to_zero_ms"], told["trouble"]) == (None, "the robot does not drive")
