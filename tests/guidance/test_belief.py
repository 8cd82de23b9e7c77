"""Fusion of detections that miss and invent."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ghal360_robot.guidance.belief import (
    NOT_IN_VIEW,
    SURE,
    WAIT,
    DetectorModel,
    TargetBelief,
    act,
    choose,
    expected_values,
    likely_wedge,
    look,
    predict,
    refused,
    turned,
    update,
)
from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, RIGHT, AbstractMdp, one_target_codes, one_target_index
from ghal360_robot.guidance.planning import greedy, value_iteration

MODEL = DetectorModel()
Q = value_iteration(AbstractMdp().over(one_target_codes())).q
LOOK_S = MODEL.correlation_s


def sight(*wedges: int) -> np.ndarray:
    seen = np.zeros(8, bool)
    seen[list(wedges)] = True
    return seen


def certain(wedge: int) -> np.ndarray:
    return np.eye(9)[wedge]


@given(arrays(bool, (6, 8)), st.floats(0, 3))
def test_a_belief_stays_a_distribution(looks: np.ndarray, dt_s: float) -> None:
    belief = MODEL.prior
    for seen in looks:
        belief = update(MODEL, predict(MODEL, belief, dt_s, 0.3), seen, dt_s)
        assert belief.sum() == pytest.approx(1)
        assert np.all(belief > 0)


def test_bayes_rule_by_hand() -> None:
    model = DetectorModel(hit_rate=0.8, false_rate=0.05, prior_in_view=0.5)
    after = update(model, model.prior, sight(3), LOOK_S)
    hit, miss = 0.8 / 0.05, 0.2 / 0.95
    total = 0.0625 * hit + 7 * 0.0625 * miss + 0.5
    assert after[3] == pytest.approx(0.0625 * hit / total)
    assert after[0] == pytest.approx(0.0625 * miss / total)
    assert after[NOT_IN_VIEW] == pytest.approx(0.5 / total)


def test_one_picture_is_not_enough_to_be_sure_and_a_second_of_them_is() -> None:
    belief = MODEL.prior
    looks = 0
    while belief[0] < SURE:
        belief = update(MODEL, predict(MODEL, belief, 0.25), sight(0), 0.25)
        looks += 1
    assert 3 <= looks <= 8


def test_correlated_pictures_count_as_the_time_they_span() -> None:
    fast = slow = MODEL.prior
    for _ in range(10):
        fast = update(MODEL, fast, sight(2), LOOK_S / 10)
    slow = update(MODEL, slow, sight(2), LOOK_S)
    assert fast == pytest.approx(slow)


def test_what_is_not_seen_again_fades_and_driving_blurs_it() -> None:
    belief = certain(4)
    assert predict(MODEL, belief, 1e4) == pytest.approx(MODEL.prior)
    moved = predict(MODEL, belief, 0.0, 1.0)
    assert moved[3] == moved[5] == pytest.approx(0.1)
    assert moved[4] == pytest.approx(0.8)
    assert predict(MODEL, belief, 0.0) == pytest.approx(belief)


def test_a_sure_belief_chooses_what_the_plan_would_in_every_state() -> None:
    best = greedy(Q)
    for target in range(1, 8):
        for mask in range(256):
            clutter = np.array([mask >> i & 1 for i in range(8)], float)
            action = choose(MODEL, Q, certain(target), clutter)
            values = Q[one_target_index(target, mask)]
            assert values[action] >= values[best[one_target_index(target, mask)]] - 1e-9


def test_it_asks_to_confirm_only_when_nearly_sure() -> None:
    clutter = np.zeros(8)
    for p, wanted in ((0.96, WAIT), (0.9701, CONFIRM)):
        belief = np.full(9, (1 - p) / 8)
        belief[0] = p
        assert choose(MODEL, Q, belief, clutter) == wanted
    assert choose(MODEL, Q, MODEL.prior, clutter) == WAIT
    assert choose(MODEL, Q, certain(6), clutter) == LEFT


def test_values_are_expected_over_target_and_clutter() -> None:
    belief = np.zeros(9)
    belief[2], belief[3] = 0.25, 0.75
    clutter = np.zeros(8)
    clutter[1] = 0.5
    expected = sum(
        weight * 0.5 * (Q[one_target_index(t, 0)] + Q[one_target_index(t, 2)]) for t, weight in ((2, 0.25), (3, 0.75))
    )
    assert expected_values(Q, belief, clutter) == pytest.approx(expected)


def test_clutter_that_is_only_likely_still_turns_the_target_behind_away_from_it() -> None:
    clutter = np.zeros(8)
    clutter[1:4] = 0.7
    assert choose(MODEL, Q, certain(4), clutter) == LEFT
    assert choose(MODEL, Q, certain(4), clutter[::-1].copy()) == RIGHT


CODES = one_target_codes()


def test_acting_on_a_sure_belief_is_acting_on_the_values_of_that_state() -> None:
    best = greedy(Q)
    for index, code in enumerate(CODES.tolist()):
        action, values = act(Q, certain(index // 256), code)
        assert action == best[index]
        assert values == pytest.approx(tuple(Q[index]))


def test_an_arrow_points_to_where_most_of_the_belief_is_not_to_the_likeliest_wedge() -> None:
    belief = np.zeros(9)
    belief[3], belief[5], belief[6] = 0.4, 0.35, 0.25
    index = one_target_index(3, 0)
    assert greedy(Q)[index] == RIGHT
    assert act(Q, belief, int(CODES[index]))[0] == LEFT


def test_doubt_about_a_target_in_focus_is_no_reason_to_turn_away_from_it() -> None:
    belief = np.zeros(9)
    belief[0], belief[1] = 0.6, 0.4
    action, (_, right, confirm) = act(Q, belief, int(CODES[one_target_index(0, 0)]))
    assert right > confirm
    assert action == CONFIRM


def test_the_likely_wedge_is_none_while_the_target_is_likelier_not_in_view() -> None:
    assert likely_wedge(MODEL.prior) is None
    assert likely_wedge(update(MODEL, MODEL.prior, sight(5), LOOK_S)) == 5


def test_a_hidden_target_is_not_believed_less_for_not_being_reported() -> None:
    hidden = np.zeros(N_WEDGES)
    hidden[2] = np.nan
    after = update(MODEL, MODEL.prior, hidden, LOOK_S)
    assert after[2] / after[NOT_IN_VIEW] == pytest.approx(MODEL.prior[2] / MODEL.prior[NOT_IN_VIEW])
    assert after[3] < after[2]


def test_the_same_picture_is_looked_at_once() -> None:
    seen = (0.0, 1.0, *(0.0,) * 6)
    once = look(MODEL, TargetBelief(), seen, (0.0, 0.0), 1)
    assert look(MODEL, once, seen, (1.0, 0.0), 1) is once


REPORTED = (0.0, 1.0, *(0.0,) * 6)
ABSENT = (0.0,) * 8


def watched(seen: tuple[float, ...], looks: int, belief: TargetBelief, step_m: float = 0.0) -> TargetBelief:
    """The belief after so many more looks, half a second and `step_m` apart."""
    for _ in range(looks):
        stamp_ns = (belief.look_ns or 0) + round(LOOK_S * 1e9)
        belief = look(MODEL, belief, seen, (belief.at[0] + step_m, 0.0), stamp_ns)
    return belief


def chance(belief: TargetBelief, wedge: int = 1) -> float:
    assert belief.chances is not None
    return belief.chances[wedge]


def test_looks_from_one_place_make_nearly_sure_and_no_surer_however_many_they_are() -> None:
    few, many = (watched(REPORTED, looks, TargetBelief()) for looks in (4, 400))
    assert SURE < chance(few) < 0.999
    assert SURE < chance(many) < 0.999
    assert chance(watched(ABSENT, 1, many)) >= SURE
    assert chance(watched(ABSENT, 4, many)) < 0.5


def test_looks_from_elsewhere_count_anew() -> None:
    there = watched(REPORTED, 20, TargetBelief())
    assert chance(watched(REPORTED, 4, there, step_m=0.3)) > chance(watched(REPORTED, 4, there)) + 0.001
    shuffled = watched(REPORTED, 40, there, step_m=0.0)
    assert chance(shuffled) == pytest.approx(chance(there), abs=0.002)


def test_what_was_seen_from_elsewhere_is_forgotten_what_is_seen_from_here_is_not() -> None:
    there = watched(REPORTED, 20, TargetBelief())
    silent = (math.nan,) * 8
    here = watched(silent, 200, look(MODEL, there, silent, (1.0, 0.0), (there.look_ns or 0) + 1))
    assert chance(here) == pytest.approx(MODEL.prior[1], abs=0.01)
    assert chance(watched(silent, 200, there)) >= SURE


def test_a_no_takes_back_all_that_spoke_for_what_was_asked_about() -> None:
    sure = watched(REPORTED, 8, TargetBelief(), step_m=0.3)
    after = refused(MODEL, sure, math.pi / 4)
    assert chance(sure) > 0.999
    assert chance(after) < MODEL.prior[1]
    assert sum(after.chances or ()) == pytest.approx(1)
    # One beside a border may have been reported on either side of it.
    border = refused(MODEL, watched((1.0, 1.0, *(0.0,) * 6), 8, TargetBelief()), math.pi / 8)
    assert max(chance(border, wedge) for wedge in range(8)) < MODEL.prior[1]
    assert refused(MODEL, TargetBelief(), 0.0) == TargetBelief()


@given(st.floats(1e-9, 0.999), st.floats(0.01, 0.99))
@example(0.9375, 0.98828125)  # nearly surely in view: the other wedges together weigh more than "not in view"
def test_one_place_can_make_sure_whatever_that_means(sure: float, prior: float) -> None:
    model = DetectorModel(sure=sure, prior_in_view=prior)
    assert model.same_view > 0
    belief = TargetBelief()
    for n in range(30):
        belief = look(model, belief, REPORTED, (0.0, 0.0), 1 + n * round(LOOK_S * 1e9))
    assert chance(belief) >= sure


def test_many_searches_share_a_call() -> None:
    beliefs = np.stack([certain(0), certain(2), MODEL.prior])
    chosen = choose(MODEL, Q, beliefs, np.zeros((3, 8)))
    assert chosen.tolist() == [CONFIRM, RIGHT, WAIT]
    assert turned(beliefs, 2)[1, 0] == 1


def test_a_detector_that_makes_no_sense_is_refused() -> None:
    for kwargs in ({"hit_rate": 0.01}, {"false_rate": 0.0}, {"correlation_s": 0.0}, {"prior_in_view": 1.0}):
        with pytest.raises(ValueError, match=r"detector|prior"):
            DetectorModel(**kwargs)
