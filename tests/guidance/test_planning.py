"""The abstract MDP against the numbers of an independent computation (uniform over the 2,048 states)."""

from __future__ import annotations

import numpy as np
import pytest

from ghal360_robot.guidance.egocentric import CLUTTER, TARGET, decode, encode, mirror
from ghal360_robot.guidance.fgs import Tie, fgs_action, fgs_choices
from ghal360_robot.guidance.mdp import (
    CONFIRM,
    LEFT,
    RIGHT,
    AbstractMdp,
    Kernel,
    RewardOn,
    all_codes,
    one_target_codes,
    one_target_index,
)
from ghal360_robot.guidance.planning import TIE, action_values, evaluate, greedy, policy_table, value_iteration
from ghal360_robot.guidance.rule import rule_action

CODES = one_target_codes()
MODEL = AbstractMdp().over(CODES)
PLAN = value_iteration(MODEL)
RULE = policy_table(CODES, lambda code: (rule_action(code),))
FGS = policy_table(CODES, fgs_choices)
RANDOM = np.full((len(CODES), 3), 1 / 3)


def test_there_are_2048_states_with_one_target_in_the_order_of_the_compact_index() -> None:
    assert len(CODES) == len(set(CODES.tolist())) == 2048
    for code in CODES[::61].tolist():
        values = decode(code)
        (target,) = (i for i, value in enumerate(values) if value & TARGET)
        clutter = sum((value & CLUTTER) << i for i, value in enumerate(values))
        assert CODES[one_target_index(target, clutter)] == code


def test_a_target_is_in_view_in_65280_of_65536_states() -> None:
    assert AbstractMdp().over(all_codes()).asked.sum() == 65_280


def test_states_must_be_closed_under_rotation() -> None:
    with pytest.raises(ValueError, match="rotation"):
        AbstractMdp().over(CODES[:100])


def test_the_optimal_plan_is_worth_228_976() -> None:
    assert PLAN.v.mean() == pytest.approx(228.976, abs=1e-3)
    assert evaluate(MODEL, np.eye(3)[greedy(PLAN.q)]).mean() == pytest.approx(PLAN.v.mean(), abs=1e-6)


def test_the_rule_is_the_optimal_action_in_every_state() -> None:
    assert np.array_equal(RULE.argmax(axis=1), greedy(PLAN.q))
    assert evaluate(MODEL, RULE).mean() == pytest.approx(228.976, abs=1e-3)


@pytest.mark.parametrize(("tie", "value"), [(Tie.RANDOM, 227.895), (Tie.RIGHT, 227.895), (Tie.CLUTTER, 228.737)])
def test_fgs_is_worth_what_its_tie_break_earns(tie: Tie, value: float) -> None:
    table = policy_table(CODES, lambda code: fgs_choices(code, tie))
    assert evaluate(MODEL, table).mean() == pytest.approx(value, abs=1e-3)


def test_random_policies_are_worth_what_chance_earns() -> None:
    look = policy_table(CODES, lambda code: (CONFIRM,) if code & TARGET else (LEFT, RIGHT))
    assert evaluate(MODEL, look).mean() == pytest.approx(155.5, abs=1e-3)
    assert evaluate(MODEL, RANDOM).mean() == pytest.approx(-205.5, abs=1e-3)


def test_one_step_of_improvement_over_fgs_is_nearly_optimal() -> None:
    improved = np.eye(3)[greedy(action_values(MODEL, evaluate(MODEL, FGS)))]
    assert evaluate(MODEL, improved).mean() == pytest.approx(228.858, abs=1e-3)


@pytest.mark.parametrize(("gamma", "value"), [(0.99, 228.954), (0.95, 228.749), (0.90, 228.749)])
def test_a_plan_that_discounts_loses_little(gamma: float, value: float) -> None:
    discounted = np.eye(3)[greedy(value_iteration(MODEL, gamma).q)]
    assert evaluate(MODEL, discounted).mean() == pytest.approx(value, abs=1e-3)


KERNEL_VALUES = {
    Kernel.FOLLOW_OR_LR: (228.98, 227.90),
    Kernel.OPPOSITE: (222.91, 221.63),
    Kernel.LEFT_RIGHT_STAY: (228.86, 227.75),
    Kernel.STAY: (228.64, 227.50),
    Kernel.OPPOSITE_OR_STAY: (226.03, 224.81),
    Kernel.JUMP: (228.17, 227.25),
}


@pytest.mark.parametrize("reward_on", RewardOn)
@pytest.mark.parametrize("kernel", Kernel)
def test_every_reading_of_the_paper_has_the_same_optimal_policy(kernel: Kernel, reward_on: RewardOn) -> None:
    model = AbstractMdp(kernel=kernel, reward_on=reward_on).over(CODES)
    plan = value_iteration(model)
    optimum, fgs = KERNEL_VALUES[kernel]
    assert plan.v.mean() == pytest.approx(optimum, abs=6e-3)
    assert evaluate(model, FGS).mean() == pytest.approx(fgs, abs=6e-3)
    assert np.all(plan.q[RULE > 0] >= plan.v - TIE)


@pytest.mark.parametrize("p", [0.5, 0.7, 0.8, 0.9, 0.95, 1.0])
def test_the_rule_stays_optimal_for_every_chance_to_follow_from_one_half(p: float) -> None:
    plan = value_iteration(AbstractMdp(p=p).over(CODES))
    assert np.all(plan.q[RULE > 0] >= plan.v - TIE)


@pytest.mark.parametrize(("p", "states"), [(0.4, 16), (0.2, 32), (0.1, 40)])
def test_the_rule_fails_in_few_states_where_operators_hardly_follow(p: float, states: int) -> None:
    plan = value_iteration(AbstractMdp(p=p).over(CODES))
    assert np.count_nonzero(plan.q[RULE > 0] < plan.v - TIE) == states


def test_gain_over_fgs_by_distance_comes_from_detours_and_ties() -> None:
    fgs = evaluate(MODEL, FGS)
    distance = np.array([min(nearest, 8 - nearest) for nearest in np.arange(2048) // 256])
    optimum_by_distance = [PLAN.v[distance == d].mean() for d in range(5)]
    fgs_by_distance = [fgs[distance == d].mean() for d in range(5)]
    assert optimum_by_distance == pytest.approx([250, 238.77, 227.68, 217.87, 213.17], abs=6e-3)
    assert fgs_by_distance == pytest.approx([250, 238.75, 227.53, 216.53, 207.53], abs=6e-3)
    differs = (FGS[np.arange(2048), RULE.argmax(axis=1)] == 0) & (distance < 4)
    assert differs.sum() == 56
    assert set(distance[differs].tolist()) == {3}


def test_left_and_right_are_mirror_images() -> None:
    index = {code: i for i, code in enumerate(CODES.tolist())}
    mirrored = np.array([index[code] for code in mirror(CODES).tolist()])
    assert PLAN.q[:, LEFT] == pytest.approx(PLAN.q[mirrored, RIGHT], abs=1e-6)
    assert PLAN.q[:, CONFIRM] == pytest.approx(PLAN.q[mirrored, CONFIRM])


def test_with_any_number_of_targets_the_optimum_is_244_05() -> None:
    model = AbstractMdp().over(all_codes())
    plan = value_iteration(model)
    fgs = policy_table(model.codes, lambda code: fgs_choices(code) if model.asked[code] else (CONFIRM,))
    assert plan.v[model.asked].mean() == pytest.approx(244.05, abs=6e-3)
    assert evaluate(model, fgs)[model.asked].mean() == pytest.approx(243.31, abs=6e-3)
    assert plan.q[CODES] == pytest.approx(PLAN.q, abs=1e-6)
    assert not plan.v[~model.asked].any()


def test_a_wrong_confirmation_that_does_not_end_the_search_is_never_optimal_either() -> None:
    model = AbstractMdp(wrong_confirm_ends=False).over(CODES)
    assert value_iteration(model).v == pytest.approx(PLAN.v, abs=1e-6)
    assert evaluate(model, RANDOM).mean() == pytest.approx(-3051, abs=1)


def test_an_operator_who_ignores_one_arrow_is_guided_by_the_other() -> None:
    codes = all_codes()
    plan = value_iteration(AbstractMdp(p=(0.0, 0.95)).over(codes))
    two_to_the_left = encode([0, 0, 0, 0, 0, 2, 0, 0])
    assert rule_action(two_to_the_left) == LEFT
    assert greedy(plan.q)[two_to_the_left] == RIGHT


@pytest.mark.parametrize("policy", [RULE, FGS, RANDOM], ids=["rule", "fgs", "random"])
@pytest.mark.parametrize("reading", [AbstractMdp(), AbstractMdp(wrong_confirm_ends=False, kernel=Kernel.JUMP)])
def test_exact_evaluation_agrees_with_a_long_horizon(policy: np.ndarray, reading: AbstractMdp) -> None:
    model = reading.over(CODES)
    assert evaluate(model, policy) == pytest.approx(evaluate(model, policy, horizon=1500), abs=1e-6)


def test_exact_evaluation_agrees_with_simulated_episodes() -> None:
    rng = np.random.default_rng(7)
    starts = rng.integers(2048, size=20_000)
    state, gain, running = starts.copy(), np.zeros(starts.size), np.ones(starts.size, dtype=bool)
    cost = np.where(CODES & CLUTTER, 15.0, 3.0)
    actions = RULE.argmax(axis=1)
    while running.any():
        found = running & (actions[state] == CONFIRM)
        gain[found] += np.where(CODES[state[found]] & TARGET, 250, -250)
        running &= ~found
        follow = rng.random(starts.size) < 0.8
        side = np.where(actions[state] == RIGHT, 1, -1)
        turn = np.where(follow, side, rng.choice([-1, 1], size=starts.size))
        state = np.where(running, MODEL.successors[state, turn % 8], state)
        gain -= np.where(running, cost[state], 0)
    standard_error = gain.std() / np.sqrt(gain.size)
    assert gain.mean() == pytest.approx(PLAN.v[starts].mean(), abs=4 * standard_error)
    assert gain.std() == pytest.approx(18.0, abs=0.7)


def test_a_policy_that_never_confirms_has_no_value_without_a_horizon() -> None:
    turning = policy_table(CODES, lambda _: (RIGHT,))
    with pytest.raises(ValueError, match="never confirms"):
        evaluate(MODEL, turning)
    assert evaluate(MODEL, turning, horizon=100).mean() == pytest.approx(-900, abs=1e-6)
    assert evaluate(MODEL, turning, gamma=0.9).mean() == pytest.approx(-90, abs=1e-6)


def test_a_search_that_cannot_be_planned_is_refused() -> None:
    with pytest.raises(ValueError, match="chance to follow"):
        AbstractMdp(p=1.2)
    with pytest.raises(ValueError, match="cost"):
        AbstractMdp(clear_cost=0)


def test_ties_are_broken_right_then_left_then_confirm() -> None:
    q = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0 + 1e-9, 1.0, 0.0]])
    assert greedy(q).tolist() == [RIGHT, LEFT, CONFIRM, RIGHT]


def test_fgs_draws_its_random_side_from_the_callers_number() -> None:
    behind = encode([0, 0, 0, 0, 2, 0, 0, 0])
    assert [fgs_action(behind, Tie.RANDOM, u) for u in (0.0, 0.49, 0.5, 0.999)] == [LEFT, LEFT, RIGHT, RIGHT]
    assert {fgs_action(behind, Tie.RIGHT, u) for u in (0.0, 0.999)} == {RIGHT}
    cluttered_right = encode([0, 1, 0, 0, 2, 0, 0, 0])
    assert fgs_action(cluttered_right, Tie.CLUTTER, 0.9) == LEFT
    between_two = encode([0, 2, 1, 1, 0, 0, 0, 2])
    assert fgs_action(between_two, Tie.CLUTTER, 0.9) == RIGHT


def test_without_a_target_there_is_nothing_to_guide_to() -> None:
    for choose in (rule_action, fgs_choices):
        with pytest.raises(ValueError, match="No target"):
            choose(encode([1, 0, 0, 0, 0, 0, 0, 0]))
