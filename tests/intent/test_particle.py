"""The paper's particle filter against the exact one, and its resampling against filterpy's."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from filterpy.discrete_bayes import update as discrete_update
from filterpy.monte_carlo import residual_resample, systematic_resample
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.intent.exact import ExactFilter, IntentState
from ghal360_robot.intent.head_motion import RIGHT, STILL, Evidence, HeadSettings, HeadState, step_head
from ghal360_robot.intent.model import HUMAN_TICKS, UNIFORM, IntentModel
from ghal360_robot.intent.particle import ParticleFilter, ParticleState, systematic_counts

from .head_traces import FINE_HZ, Trace, score, trace

if TYPE_CHECKING:
    from ghal360_robot.intent.trigger import TriggerState

weights = st.lists(st.floats(0, 1), min_size=8, max_size=8).filter(lambda w: sum(w) > 1e-6)


@pytest.fixture(scope="module")
def traces() -> list[Trace]:
    rng = np.random.default_rng(2024)
    return [trace(rng) for _ in range(10)]


def rmse(particles: ParticleFilter, traces: list[Trace]) -> float:
    """Root mean square difference of the two beliefs, over wedges and samples of 10 Hz."""
    exact, squares, n = ExactFilter(), 0.0, 0
    for each in traces:
        head, true, cloud = HeadState(), IntentState(), IntentState()
        for i in range(0, len(each.yaw), FINE_HZ // 10):
            head = step_head(HeadSettings(), head, float(each.yaw[i]), i * 10_000_000)
            if head.evidence is not None:
                true = exact.step(true, head.evidence, 0.1)
                cloud = particles.step(cloud, head.evidence, 0.1)
                squares += float(np.sum(np.subtract(true.belief, cloud.belief) ** 2))
                n += 8
    return math.sqrt(squares / n)


def test_500_particles_follow_the_exact_belief(traces: list[Trace]) -> None:
    assert rmse(ParticleFilter(), traces[:5]) < 0.03


@pytest.mark.parametrize(("particles", "error"), [(50, 0.061), (200, 0.026)])
def test_fewer_particles_are_noisier_by_the_square_root(traces: list[Trace], particles: int, error: float) -> None:
    assert rmse(ParticleFilter(particles=particles), traces[:6]) == pytest.approx(error, rel=0.35)


def test_multinomial_resampling_at_every_step_is_three_times_as_noisy(traces: list[Trace]) -> None:
    systematic = rmse(ParticleFilter(), traces[:3])
    multinomial = rmse(ParticleFilter(systematic=False), traces[:3])
    assert multinomial > 2.5 * systematic


def test_500_particles_recognise_an_intention_like_the_exact_filter(traces: list[Trace]) -> None:
    exact = score(ExactFilter(), traces, 10)
    cloud = score(cast("ExactFilter", ParticleFilter()), traces, 10)
    assert np.median(cloud.latencies_s) == pytest.approx(2.0, abs=0.3)
    assert cloud.false_per_min < exact.false_per_min + 1.0
    assert cloud.wrong_hold_share == 0.0


def test_one_turn_and_two_holds_are_an_intention() -> None:
    """The paper's illustrative trial, against a strong belief in another wedge."""
    before = tuple(0.9 if k == 6 else 0.1 / 7 for k in range(8))
    exact, cloud = IntentState(before), IntentState(before)
    for evidence in (Evidence(RIGHT, 2, 2), Evidence(STILL, 3, 3), Evidence(STILL, 3, 3)):
        exact = ExactFilter(HUMAN_TICKS).step(exact, evidence, 2.0)
        cloud = ParticleFilter(HUMAN_TICKS).step(cloud, evidence, 2.0)
    assert cloud.belief[3] == pytest.approx(exact.belief[3], abs=0.05)
    assert cloud.belief[3] >= 0.7


def test_the_same_seed_gives_the_same_cloud_and_another_another() -> None:
    def beliefs(seed: int) -> tuple[float, ...]:
        cloud, state = ParticleFilter(seed=seed), IntentState()
        for k in range(20):
            state = cloud.step(state, Evidence(STILL, k % 3, k % 3), 0.1)
        return state.belief

    assert beliefs(1) == beliefs(1) != beliefs(2)


def test_without_evidence_the_cloud_spreads_and_loses_nobody() -> None:
    cloud, state = ParticleFilter(), ParticleState(counts=(500, 0, 0, 0, 0, 0, 0, 0))
    for _ in range(300):
        state = cloud.step(state, None, 0.5)
    assert sum(state.counts) == 500
    assert state.belief == pytest.approx(UNIFORM, abs=0.06)


def test_an_intention_is_taken_over_from_the_exact_filter() -> None:
    exact, state = ExactFilter(), IntentState()
    for _ in range(40):
        state = exact.step(state, Evidence(STILL, 5, 5), 0.1)
    trigger: TriggerState = state.trigger
    assert trigger.intention == 5
    assert ParticleFilter().step(state, Evidence(STILL, 5, 5), 0.1).trigger.intention == 5


@given(weights, st.floats(0, 0.999999), st.integers(8, 2000))
def test_systematic_counts_are_within_one_of_their_share(w: list[float], u: float, particles: int) -> None:
    share = np.array(w) / sum(w)
    counts = systematic_counts(share, particles, u)
    assert counts.sum() == particles
    assert np.all(np.abs(counts - share * particles) <= 1 + 1e-6)


def test_systematic_counts_are_filterpys_for_the_same_draw() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        share = rng.dirichlet(np.ones(8))
        share[-1] = 1.0 - share[:-1].sum()
        # Its generator is numpy's global one: this is the only way to know its draw.
        np.random.seed(11)
        u = np.random.random()
        np.random.seed(11)
        spread = np.repeat(share / 250, 250)
        theirs = np.bincount(systematic_resample(spread / spread.sum()) // 250, minlength=8)
        assert np.abs(theirs - systematic_counts(share, 2000, u)).max() <= 1


def test_bayes_rule_is_filterpys() -> None:
    model, evidence = IntentModel(), Evidence(RIGHT, 2, 1)
    state = ExactFilter().step(IntentState(), evidence, 0.5)
    theirs = discrete_update(np.array(model.likelihood(evidence, 0.5)), np.array(model.predict(UNIFORM, 0.5)))
    assert state.belief == pytest.approx(theirs)


def test_filterpys_residual_resampling_is_still_wrong() -> None:
    """docs/upstream/filterpy.md: remove both when this fails."""
    share = np.repeat([0.5, 0.3, 0.15, 0.05], 250) / 250
    np.random.seed(0)
    groups = np.bincount(np.asarray(residual_resample(share)).astype(int) // 250, minlength=4) / 1000
    assert groups == pytest.approx([0.667, 0.333, 0.0, 0.0], abs=0.01)


def test_a_handful_of_particles_is_refused_and_time_goes_forward() -> None:
    with pytest.raises(ValueError, match="particles"):
        ParticleFilter(particles=5)
    with pytest.raises(ValueError, match="forward"):
        ParticleFilter().step(IntentState(), None, -1.0)
