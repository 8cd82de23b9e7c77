from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.intent.head_motion import LEFT, RIGHT, STILL, Evidence, HeadSettings, HeadState, step_head

SETTINGS = HeadSettings()


def run(yaws_deg: list[float], hz: float = 10.0, state: HeadState | None = None) -> list[HeadState]:
    state, states = state or HeadState(), []
    start = 0 if state.stamp_ns is None else state.stamp_ns + round(1e9 / hz)
    for i, yaw in enumerate(yaws_deg):
        state = step_head(SETTINGS, state, math.radians(yaw), start + round(i * 1e9 / hz))
        states.append(state)
    return states


def deltas(states: list[HeadState]) -> list[int | None]:
    return [None if state.evidence is None else state.evidence.delta for state in states]


@pytest.mark.parametrize("hz", [2, 5, 10, 30, 50, 100])
def test_turning_right_lowers_the_yaw_and_raises_the_wedge(hz: int) -> None:
    states = run([-60 * i / hz for i in range(3 * hz)], hz)
    assert set(deltas(states)[math.ceil(hz * 0.3) + 1 :]) == {RIGHT}
    assert [state.focus for state in states[::hz]] == [0, 1, 3]


@pytest.mark.parametrize("hz", [2, 10, 50])
def test_turning_left_raises_the_yaw_and_lowers_the_wedge(hz: int) -> None:
    states = run([60 * i / hz for i in range(3 * hz)], hz)
    assert set(deltas(states)[math.ceil(hz * 0.3) + 1 :]) == {LEFT}
    assert [state.focus for state in states[::hz]] == [0, 7, 5]


def test_the_dead_band_tells_drift_from_turning() -> None:
    assert deltas(run([14.0 * i / 50 for i in range(200)], 50))[-1] == STILL
    assert deltas(run([16.0 * i / 50 for i in range(200)], 50))[-1] == LEFT


def test_a_turn_across_the_back_is_no_spin_the_other_way() -> None:
    states = run([170 + 6 * i for i in range(6)])
    assert set(deltas(states)[1:]) == {LEFT}
    assert all(-math.pi <= state.yaw < math.pi for state in states)


def test_the_first_sample_is_no_evidence_and_the_second_is() -> None:
    first, second = run([0.0, 0.0])
    assert first.evidence is None
    assert second.evidence == Evidence(STILL, 0, 0)


def test_evidence_tells_where_the_motion_began() -> None:
    states = run([0.0, -20.0, -40.0])
    assert states[-1].evidence == Evidence(RIGHT, focus=1, origin=0)


def test_a_head_at_a_border_keeps_its_wedge_within_the_margin() -> None:
    states = run([0.0, -22.0, -25.0, -20.0, -25.0, -26.0, -20.0, -19.0])
    assert [state.focus for state in states] == [0, 0, 0, 0, 0, 1, 1, 0]


def test_after_a_silence_motion_is_unknown_until_the_next_sample() -> None:
    (before,) = run([0.0])[-1:]
    assert before.stamp_ns is not None
    after = step_head(SETTINGS, before, math.radians(90), before.stamp_ns + 1_600_000_000)
    assert after.evidence is None
    assert after.focus == 6
    assert step_head(SETTINGS, after, math.radians(90), before.stamp_ns + 1_700_000_000).evidence == Evidence(0, 6, 6)


@pytest.mark.parametrize(("yaw", "later_ns"), [(math.nan, 1), (math.inf, 1), (1.0, 0), (1.0, -5)])
def test_a_sample_that_is_no_number_or_not_newer_changes_nothing(yaw: float, later_ns: int) -> None:
    state = run([0.0, 10.0, 20.0])[-1]
    assert state.stamp_ns is not None
    assert step_head(SETTINGS, state, yaw, state.stamp_ns + later_ns) == state


@given(st.lists(st.tuples(st.floats(-1e3, 1e3), st.integers(1, 2 * 10**9)), max_size=40))
def test_any_stream_gives_evidence_in_range(samples: list[tuple[float, int]]) -> None:
    state, now = HeadState(), 0
    for yaw, dt_ns in samples:
        now += dt_ns
        state = step_head(SETTINGS, state, yaw, now)
        assert state.focus in range(8)
        assert state.evidence is None or state.evidence.delta in (LEFT, STILL, RIGHT)
        assert state.evidence is None or state.evidence.origin in range(8)
