"""Learning on the robot: epochs, follow rates, replanning in small pieces, and never a question for its own sake."""

from __future__ import annotations

import numpy as np
import pytest

from ghal360_robot.guidance.cueing import CueSettings, CueState, step_cue
from ghal360_robot.guidance.egocentric import wedge_centre
from ghal360_robot.guidance.follow_rates import FollowRates
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, RIGHT, AbstractMdp, one_target_codes
from ghal360_robot.guidance.online import Epoch, LearnedPolicy, Learning, Learnt, OnlineLearner, OnlineState
from ghal360_robot.guidance.planning import evaluate, greedy, value_iteration
from ghal360_robot.guidance.policy import Advice
from ghal360_robot.messages import Cue

TICK_NS = 20_000_000
MODEL = AbstractMdp().over(one_target_codes())


class Desk:
    """A scene, a head, and the learner stepped as on the robot, 50 times a second."""

    def __init__(self, learner: OnlineLearner, known: Learnt | None = None) -> None:
        self.learner, self.state = learner, learner.begin(known)
        self.cue, self.head, self.now_ns, self.found = CueState(), 0, 0, 0
        self.scene = [0] * 8
        self.shown: list[Cue] = []

    def run(self, ticks: int) -> OnlineState:
        for _ in range(ticks):
            yaw = -wedge_centre(self.head)
            policy = self.learner.policy(self.state)
            self.cue = step_cue(policy, CueSettings(), self.cue, self.scene, yaw, self.now_ns)
            self.state = self.learner.step(self.state, self.cue, self.found, self.now_ns)
            self.shown.append(self.cue.cue)
            self.now_ns += TICK_NS
        return self.state


def value(q: np.ndarray, p: tuple[float, float]) -> float:
    model = AbstractMdp(p=p).over(one_target_codes())
    return float(evaluate(model, np.eye(3)[greedy(q)], horizon=300).mean())


def test_an_arrow_followed_is_counted_once_per_epoch() -> None:
    desk = Desk(OnlineLearner())
    desk.scene[2] = 2
    desk.run(40)
    assert desk.cue.cue is Cue.RIGHT
    desk.head = 1
    assert desk.run(1).learnt.rates == FollowRates(right=(10.0, 1.0))
    desk.head = 2
    assert desk.run(30).learnt.rates == FollowRates(right=(11.0, 1.0))
    assert desk.cue.cue is Cue.CONFIRM


def test_an_arrow_ignored_for_two_seconds_is_counted_as_that() -> None:
    desk = Desk(OnlineLearner())
    desk.scene[6] = 2
    assert desk.run(100).learnt.epochs == 0
    assert desk.run(2).learnt.rates == FollowRates(left=(9.0, 2.0))
    assert desk.run(201).learnt.rates == FollowRates(left=(9.0, 4.0))


def test_a_scene_that_changes_in_mid_epoch_teaches_nothing() -> None:
    desk = Desk(OnlineLearner())
    desk.scene[2] = 2
    desk.run(10)
    desk.scene = [0, 0, 0, 0, 0, 0, 2, 0]
    desk.run(2)
    assert desk.cue.cue is Cue.LEFT
    desk.scene = [0] * 8
    assert desk.run(200).learnt.epochs == 0


def test_the_plan_is_made_anew_in_small_pieces_and_is_the_whole_one() -> None:
    desk = Desk(OnlineLearner())
    desk.scene[2] = 2
    desk.run(40)
    desk.head = 1
    state = desk.run(1)
    assert state.model is not None
    desk.scene = [0] * 8
    state = desk.run(150)
    assert state.model is None
    expected = value_iteration(AbstractMdp(p=state.learnt.rates.p).over(one_target_codes())).q
    assert state.learnt.q == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("operator", [(0.3, 0.95), (0.0, 0.95)])
def test_an_operator_who_follows_one_side_only_is_guided_by_it(operator: tuple[float, float]) -> None:
    rng, turns = np.random.default_rng(5), AbstractMdp(p=operator).turns()
    rates = FollowRates()
    for _ in range(60):
        action = LEFT if rng.random() < 0.5 else RIGHT
        rates = rates.observed(action, int(rng.choice(8, p=turns[action])))
    adapted = value_iteration(AbstractMdp(p=rates.p).over(one_target_codes())).q
    before, after = value(value_iteration(MODEL).q, operator), value(adapted, operator)
    best = value_iteration(AbstractMdp(p=operator).over(one_target_codes())).v.mean()
    assert before < after <= best
    assert best - after < (best - before) / 2


def test_follow_rates_are_what_was_counted() -> None:
    rates = FollowRates()
    assert rates.p == pytest.approx((0.8, 0.8))
    for turn in (7, 6, 1, 0):
        rates = rates.observed(LEFT, turn)
    assert rates.left == (11.0, 3.0)
    assert rates.p[0] == pytest.approx(2 * 11 / 14 - 1)
    assert FollowRates(left=(1.0, 9.0)).p[0] == 0.0
    with pytest.raises(ValueError, match="arrow"):
        rates.observed(CONFIRM, 0)
    with pytest.raises(ValueError, match="positive"):
        FollowRates(left=(0.0, 1.0))


def test_values_are_learned_from_what_a_look_cost() -> None:
    desk = Desk(OnlineLearner(Learning.VALUES))
    desk.scene[2], desk.scene[1] = 2, 1
    before = desk.run(1).learnt.q
    here = int(np.flatnonzero(one_target_codes() == desk.cue.code)[0])
    assert desk.cue.cue is Cue.RIGHT
    desk.head = 1
    after = desk.run(1).learnt.q
    there = int(np.flatnonzero(one_target_codes() == desk.cue.code)[0])
    assert after[here, RIGHT] == pytest.approx(0.95 * before[here, RIGHT] + 0.05 * (before[there].max() - 15))
    assert np.count_nonzero(after != before) == 1
    assert not after.flags.writeable


def test_found_is_the_reward_of_a_confirmation() -> None:
    worse = value_iteration(MODEL).q - 20
    desk = Desk(OnlineLearner(Learning.VALUES), Learnt(worse))
    desk.scene[0] = 2
    desk.run(5)
    assert desk.cue.cue is Cue.CONFIRM
    index = int(np.flatnonzero(one_target_codes() == desk.cue.code)[0])
    before = desk.state.learnt.q[index, CONFIRM]
    desk.found = 1
    after = desk.run(3).learnt.q[index, CONFIRM]
    assert after == pytest.approx(before + 0.05 * (250 - before))


def test_a_confirmation_is_never_explored() -> None:
    misled = np.zeros((2048, 3))
    misled[:, CONFIRM] = 100.0
    desk = Desk(OnlineLearner(Learning.VALUES), Learnt(misled))
    desk.scene[3] = 2
    desk.run(200)
    assert Cue.CONFIRM not in desk.shown
    assert Cue.RIGHT in desk.shown


@pytest.mark.parametrize("learning", Learning)
def test_learning_never_makes_a_good_operators_guidance_worse_than_fgs(learning: Learning) -> None:
    rng, learner = np.random.default_rng(2), OnlineLearner(learning)
    desk = Desk(learner)
    turns = AbstractMdp().turns()
    for _ in range(40):
        desk.scene = [int(c) for c in rng.integers(0, 2, 8)]
        desk.scene[int(rng.integers(8))] |= 2
        for _ in range(12):
            desk.run(5)
            if desk.cue.cue not in {Cue.LEFT, Cue.RIGHT}:
                break
            action = LEFT if desk.cue.cue is Cue.LEFT else RIGHT
            desk.head = (desk.head + int(rng.choice(8, p=turns[action]))) % 8
    state = desk.run(150)
    assert state.learnt.epochs > 40
    assert value(state.learnt.q, (0.8, 0.8)) > 227.895


def test_the_learned_policy_falls_back_on_the_rule_where_it_has_no_values() -> None:
    policy = LearnedPolicy(value_iteration(MODEL).q)
    two_targets = 2 << 2 * 2 | 2 << 2 * 5
    assert policy.advise(two_targets, 0.0).cue is Cue.RIGHT
    assert policy.advise(two_targets, 0.0).q is None
    assert policy.advise(2, 0.0).q is not None


def test_a_step_leaves_the_state_it_came_from_as_it_was() -> None:
    learner = OnlineLearner(Learning.VALUES)
    opened = learner.step(learner.begin(), CueState(0, 2 << 4, Advice(Cue.RIGHT)), 0, 0)
    before = opened.learnt.q.copy()
    once, again = (learner.step(opened, CueState(1, 2 << 2, Advice(Cue.RIGHT)), 0, TICK_NS) for _ in range(2))
    assert opened.epoch == Epoch(2 << 4, RIGHT, 0, 0)
    assert np.array_equal(opened.learnt.q, before)
    assert not np.array_equal(once.learnt.q, before)
    assert np.array_equal(once.learnt.q, again.learnt.q)
