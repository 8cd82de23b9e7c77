from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ghal360_robot.guidance.cueing import CueSettings, CueState, step_cue, uniform
from ghal360_robot.guidance.egocentric import TARGET
from ghal360_robot.guidance.policy import Advice, FgsPolicy, Policy, ValuePolicy, make_policy, plan_policy
from ghal360_robot.messages import Cue

PLAN = plan_policy()
SETTINGS = CueSettings()
TICK_NS = 20_000_000
TARGET_EAST = (0, 0, 2, 0, 0, 0, 0, 0)
NO_TARGET = (1, 0, 0, 1, 0, 0, 0, 0)


def yaw(bearing_deg: float) -> float:
    return -math.radians(bearing_deg)


class Counting:
    """A policy that counts how often it is asked and what chance it is given."""

    name = "counting"

    def __init__(self, policy: Policy) -> None:
        self.policy, self.draws = policy, list[float]()

    def advise(self, code: int, u: float, belief: NDArray[np.float64] | None = None) -> Advice:
        self.draws.append(u)
        return self.policy.advise(code, u, belief)


def test_arrows_lead_to_the_target_and_the_confirmation_comes_when_it_is_in_focus() -> None:
    state = CueState()
    cues = []
    for tick, bearing in enumerate(range(0, 181, 45)):
        state = step_cue(PLAN, SETTINGS, state, TARGET_EAST, yaw(bearing), tick * TICK_NS)
        cues.append(state.cue)
    assert cues == [Cue.RIGHT, Cue.RIGHT, Cue.CONFIRM, Cue.LEFT, Cue.LEFT]
    assert state.wedges == (0, 0, 0, 0, 0, 0, 2, 0)
    assert state.q is not None


def test_without_a_target_nothing_is_shown_and_the_policy_is_not_asked() -> None:
    policy = Counting(PLAN)
    state = step_cue(policy, SETTINGS, CueState(), NO_TARGET, 0.0, 0)
    assert (state.cue, state.q, policy.draws) == (Cue.NONE, None, [])
    state = step_cue(policy, SETTINGS, state, TARGET_EAST, 0.0, TICK_NS)
    assert state.cue is Cue.RIGHT
    state = step_cue(policy, SETTINGS, state, NO_TARGET, 0.0, 2 * TICK_NS)
    assert (state.cue, state.q) == (Cue.NONE, None)
    state = step_cue(policy, SETTINGS, state, TARGET_EAST, 0.0, 3 * TICK_NS)
    assert (state.cue, state.epoch) == (Cue.RIGHT, 2)


def test_a_decision_stands_for_two_seconds_unless_the_state_changes() -> None:
    policy = Counting(PLAN)
    state = CueState()
    decided_at = []
    for tick in range(251):
        before = state.epoch
        bearing = 0 if tick < 60 else 45
        state = step_cue(policy, SETTINGS, state, TARGET_EAST, yaw(bearing), tick * TICK_NS)
        if state.epoch > before:
            decided_at.append(tick)
    assert decided_at == [0, 60, 160]
    assert len(policy.draws) == 3


def test_a_random_tie_is_redrawn_each_epoch_and_not_in_between() -> None:
    behind = (0, 0, 0, 0, 2, 0, 0, 0)
    state = CueState()
    cues = []
    for tick in range(100 * 64):
        state = step_cue(FgsPolicy(), SETTINGS, state, behind, 0.0, tick * TICK_NS)
        cues.append(state.cue)
    changes = [tick for tick in range(1, len(cues)) if cues[tick] is not cues[tick - 1]]
    assert changes
    assert all(tick % 100 == 0 for tick in changes)
    assert 16 < sum(cue is Cue.LEFT for cue in cues[::100]) < 48


def test_the_same_seed_gives_the_same_cues_and_another_seed_others() -> None:
    def cues(seed: int) -> list[Cue]:
        state = CueState()
        shown = []
        for epoch in range(64):
            state = step_cue(
                FgsPolicy(), CueSettings(seed=seed), state, (0, 0, 0, 0, 2, 0, 0, 0), 0.0, epoch * 2_000_000_000
            )
            shown.append(state.cue)
        return shown

    assert cues(3) == cues(3)
    assert cues(3) != cues(4)


def test_chance_is_uniform_from_zero_to_one() -> None:
    draws = np.array([uniform(11, n) for n in range(20_000)])
    assert 0 <= draws.min() <= draws.max() < 1
    assert draws.mean() == pytest.approx(0.5, abs=0.01)
    assert draws.std() == pytest.approx(12**-0.5, abs=0.01)
    assert abs(np.corrcoef(draws[1:], draws[:-1])[0, 1]) < 0.03


def test_a_head_that_wanders_at_a_border_does_not_make_cues_flicker() -> None:
    rng = np.random.default_rng(5)
    state, changes, policy = CueState(), 0, Counting(PLAN)
    for tick in range(90):
        bearing = 67.5 + rng.uniform(-2.9, 2.9)
        before = state.cue
        state = step_cue(policy, SETTINGS, state, TARGET_EAST, yaw(bearing), tick * TICK_NS)
        changes += state.cue is not before
    assert changes == 1
    without = CueSettings(border_margin=0.0)
    state, changes = CueState(), 0
    for tick in range(90):
        before = state.cue
        bearing = 67.5 + rng.uniform(-2.9, 2.9)
        state = step_cue(policy, without, state, TARGET_EAST, yaw(bearing), tick * TICK_NS)
        changes += state.cue is not before
    assert changes > 20


def test_a_policy_that_confirms_at_the_wrong_place_is_overruled() -> None:
    hasty = np.zeros((65_536, 3))
    hasty[:, 2] = 1.0
    policy = ValuePolicy("hasty", hasty)
    state = step_cue(policy, SETTINGS, CueState(), TARGET_EAST, 0.0, 0)
    assert state.cue is Cue.RIGHT
    assert step_cue(policy, SETTINGS, state, TARGET_EAST, yaw(90), TICK_NS).cue is Cue.CONFIRM


def test_no_guidance_shows_nothing() -> None:
    assert step_cue(make_policy("none"), SETTINGS, CueState(), TARGET_EAST, yaw(90), 0).cue is Cue.NONE


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.lists(st.integers(0, 3), min_size=8, max_size=8), st.floats(-20, 20), st.integers(-(10**9), 4 * 10**9)
        ),
        max_size=30,
    )
)
def test_whatever_comes_confirm_means_target_in_focus_and_no_target_means_no_cue(
    ticks: list[tuple[list[int], float, int]],
) -> None:
    state, now = CueState(), 0
    for wedges, head_yaw, dt_ns in ticks:
        now += dt_ns
        state = step_cue(PLAN, SETTINGS, state, wedges, head_yaw, now)
        in_view = any(value & TARGET for value in wedges)
        assert (state.cue is Cue.NONE) == (not in_view)
        assert (state.cue is Cue.CONFIRM) == bool(state.wedges[0] & TARGET)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_head_that_is_nowhere_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        step_cue(PLAN, SETTINGS, CueState(), TARGET_EAST, bad, 0)
