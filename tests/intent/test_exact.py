"""The exact filter against the numbers of an independent computation, on synthetic operators."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.intent.exact import ExactFilter, IntentState
from ghal360_robot.intent.head_motion import LEFT, RIGHT, STILL, Evidence
from ghal360_robot.intent.model import HUMAN_TICKS, UNIFORM, IntentModel
from ghal360_robot.intent.trigger import TriggerSettings, TriggerState, step_trigger

from .head_traces import Score, Trace, score, trace

evidences = st.builds(Evidence, st.sampled_from([LEFT, STILL, RIGHT]), st.integers(0, 7), st.integers(0, 7))


@pytest.fixture(scope="module")
def traces() -> list[Trace]:
    rng = np.random.default_rng(2024)
    return [trace(rng) for _ in range(80)]


@pytest.fixture(scope="module")
def at_10_hz(traces: list[Trace]) -> Score:
    return score(ExactFilter(), traces, 10)


def test_the_synthetic_operators_stay_as_long_in_a_wedge_as_described(traces: list[Trace]) -> None:
    assert np.mean([each.mean_stay_s for each in traces]) == pytest.approx(1.17, abs=0.05)


def test_an_intention_is_recognised_within_two_seconds_with_few_false_alarms(at_10_hz: Score) -> None:
    assert np.median(at_10_hz.latencies_s) == pytest.approx(2.0, abs=0.3)
    assert np.quantile(at_10_hz.latencies_s, 0.9) < 2.8
    assert at_10_hz.false_per_min < 2.5
    assert at_10_hz.wrong_hold_share == 0.0


@pytest.mark.parametrize("hz", [2, 50])
def test_recognition_does_not_depend_on_the_rate_of_the_head_stream(hz: int, traces: list[Trace]) -> None:
    result = score(ExactFilter(), traces[:40], hz)
    assert np.median(result.latencies_s) == pytest.approx(2.0, abs=0.3)
    assert result.false_per_min < 2.9


def test_a_steady_trigger_has_fewer_false_alarms_and_is_hardly_slower(traces: list[Trace], at_10_hz: Score) -> None:
    steady = score(ExactFilter(trigger=TriggerSettings(release=0.5, steady_s=0.2)), traces, 10)
    assert steady.false_per_min < at_10_hz.false_per_min
    assert np.median(steady.latencies_s) == pytest.approx(2.2, abs=0.3)


@pytest.mark.parametrize(
    ("threshold", "false_per_min", "latency_s"), [(0.5, 8.1, 1.3), (0.6, 3.8, 1.6), (0.8, 0.27, 2.7)]
)
def test_the_threshold_trades_false_alarms_for_latency(
    traces: list[Trace], threshold: float, false_per_min: float, latency_s: float
) -> None:
    result = score(ExactFilter(trigger=TriggerSettings(threshold=threshold)), traces[:60], 10)
    assert np.median(result.latencies_s) == pytest.approx(latency_s, abs=0.25)
    assert result.false_per_min == pytest.approx(false_per_min, rel=0.3, abs=0.3)


def one_turn_and_three_holds(prior: tuple[float, ...]) -> list[float]:
    intent, state = ExactFilter(HUMAN_TICKS), IntentState(prior)
    beliefs = []
    for evidence in [Evidence(RIGHT, 2, 2)] + [Evidence(STILL, 3, 3)] * 3:
        state = intent.step(state, evidence, 2.0)
        beliefs.append(state.belief[3])
    return beliefs


def test_one_turn_and_two_holds_show_an_intention() -> None:
    assert one_turn_and_three_holds(UNIFORM) == pytest.approx([0.25, 0.74, 0.95, 0.98], abs=6e-3)


def test_two_holds_outweigh_even_a_strong_belief_in_another_wedge() -> None:
    behind = tuple(0.9 if wedge == 5 else 0.1 / 7 for wedge in range(8))
    assert one_turn_and_three_holds(behind) == pytest.approx([0.03, 0.26, 0.75, 0.95], abs=6e-3)
    assert one_turn_and_three_holds(behind)[2] >= 0.7


def test_the_human_tick_forgets_a_tenth_per_act() -> None:
    certain = (1.0,) + (0.0,) * 7
    assert HUMAN_TICKS.predict(certain, 2.0) == pytest.approx((0.9 + 0.1 / 8,) + (0.1 / 8,) * 7)


@given(st.lists(st.tuples(st.one_of(st.none(), evidences), st.floats(0, 1e6)), max_size=40))
def test_a_belief_is_a_distribution_whatever_is_seen(steps: list[tuple[Evidence | None, float]]) -> None:
    intent, state = ExactFilter(), IntentState()
    for evidence, dt_s in steps:
        state = intent.step(state, evidence, dt_s)
        assert sum(state.belief) == pytest.approx(1.0)
        assert all(0 < b < 1 for b in state.belief)
        wanted = intent.intention(state)
        assert wanted is None or state.belief[wanted] >= 0.7


@given(st.lists(st.tuples(evidences, st.floats(0.01, 2)), min_size=1, max_size=20), st.integers(0, 7))
def test_wedges_are_alike_under_rotation_and_mirror(steps: list[tuple[Evidence, float]], by: int) -> None:
    intent = ExactFilter()
    plain = turned = mirrored = IntentState()
    for e, dt_s in steps:
        plain = intent.step(plain, e, dt_s)
        turned = intent.step(turned, Evidence(e.delta, (e.focus + by) % 8, (e.origin + by) % 8), dt_s)
        mirrored = intent.step(mirrored, Evidence(-e.delta, -e.focus % 8, -e.origin % 8), dt_s)
    assert [turned.belief[(k + by) % 8] for k in range(8)] == pytest.approx(plain.belief)
    assert [mirrored.belief[-k % 8] for k in range(8)] == pytest.approx(plain.belief)


def test_a_second_of_the_same_counts_the_same_in_five_steps_or_fifty() -> None:
    intent, look = ExactFilter(), Evidence(STILL, 2, 2)
    coarse = fine = IntentState()
    for _ in range(5):
        coarse = intent.step(coarse, look, 0.2)
    for _ in range(50):
        fine = intent.step(fine, look, 0.02)
    assert fine.belief == pytest.approx(coarse.belief, abs=0.02)


def test_without_evidence_the_belief_fades_and_the_intention_goes() -> None:
    intent, state = ExactFilter(), IntentState()
    for _ in range(400):
        state = intent.step(state, Evidence(STILL, 6, 6), 0.02)
    assert intent.intention(state) == 6
    state = intent.step(state, None, 1.5)
    assert intent.intention(state) is None
    state = intent.step(state, None, 60.0)
    assert state.belief == pytest.approx(UNIFORM, abs=1e-6)


def test_one_sample_after_a_long_silence_is_but_one_look() -> None:
    intent = ExactFilter()
    once = intent.model.likelihood(Evidence(STILL, 1, 1), 1.5)
    assert intent.model.likelihood(Evidence(STILL, 1, 1), 60.0) == once


@pytest.mark.parametrize("dt_s", [-0.1, math.inf, math.nan])
def test_time_goes_forward(dt_s: float) -> None:
    with pytest.raises(ValueError, match="forward"):
        ExactFilter().step(IntentState(), None, dt_s)


def belief_in(wedge: int, p: float) -> tuple[float, ...]:
    return tuple(p if k == wedge else (1 - p) / 7 for k in range(8))


def test_a_plain_trigger_follows_the_threshold() -> None:
    state = TriggerState()
    wanted = []
    for p in (0.69, 0.7, 0.9, 0.69):
        state = step_trigger(TriggerSettings(), state, belief_in(4, p), 0.1)
        wanted.append(state.intention)
    assert wanted == [None, 4, 4, None]


def test_a_steady_trigger_waits_for_the_third_sample_and_lets_go_late() -> None:
    settings, state = TriggerSettings(release=0.5, steady_s=0.2), TriggerState()
    wanted = []
    for p in (0.8, 0.6, 0.8, 0.8, 0.8, 0.55, 0.5, 0.49, 0.8):
        state = step_trigger(settings, state, belief_in(4, p), 0.1)
        wanted.append(state.intention)
    assert wanted == [None, None, None, None, 4, 4, 4, None, None]


def test_a_change_of_mind_is_followed() -> None:
    settings, state = TriggerSettings(release=0.5, steady_s=0.1), TriggerState()
    wanted = []
    for wedge in (4, 4, 1, 1, 1):
        state = step_trigger(settings, state, belief_in(wedge, 0.8), 0.1)
        wanted.append(state.intention)
    assert wanted == [None, 4, None, 1, 1]


def test_settings_that_make_no_sense_are_refused() -> None:
    for kwargs in ({"threshold": 0.1}, {"threshold": 1.0}, {"release": 0.9}, {"release": 0.2}, {"steady_s": -1.0}):
        with pytest.raises(ValueError, match=r"threshold|release|time"):
            TriggerSettings(**kwargs)
    for kwargs in ({"tau_c_s": 0.0}, {"eps": 0.0}, {"p_still": 0.95}, {"p_h": 1.0}):
        with pytest.raises(ValueError, match="intent model"):
            IntentModel(**kwargs)
