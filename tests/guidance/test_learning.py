"""The learners against the plain one, exact evaluation, and the numbers of an independent computation."""

from __future__ import annotations

from itertools import count
from typing import TYPE_CHECKING

import numpy as np
import pytest

from ghal360_robot.experiments.plain_learner import PlainLearner, train_plain
from ghal360_robot.guidance.egocentric import mirror
from ghal360_robot.guidance.factored import FactoredLearner, learn_factored
from ghal360_robot.guidance.fgs import fgs_choices
from ghal360_robot.guidance.learner import PAPER, VARIANTS, LearnerSettings, Start, start_values
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, RIGHT, AbstractMdp, Kernel, RewardOn, one_target_codes
from ghal360_robot.guidance.orbits import N_ORBITS, by_index, by_orbit, index_of, mirror_orbit, orbit_of, orbit_values
from ghal360_robot.guidance.planning import evaluate, greedy, policy_table
from ghal360_robot.guidance.training import BLOCK, Learned, learn

if TYPE_CHECKING:
    from collections.abc import Callable

FGS, OPTIMUM = 227.895, 228.976
SEEDS = range(10)


@pytest.fixture(scope="module")
def paper() -> Learned:
    return learn(PAPER, SEEDS)


def draws_of(seed: int, episodes: int) -> tuple[list[int], Callable[[int], Callable[[], float]]]:
    """The starts and, for each orbit, the uniform draws that the vectorised learner uses."""
    rng = np.random.default_rng([seed, 360])
    starts = rng.integers(2048, size=episodes).tolist()
    blocks: list[np.ndarray] = []
    used = [count() for _ in range(N_ORBITS)]

    def of(orbit: int) -> Callable[[], float]:
        def draw() -> float:
            n = next(used[orbit])
            while n // (2 * BLOCK) >= len(blocks):
                blocks.append(rng.random((BLOCK, 2, N_ORBITS)))
            return float(blocks[n // (2 * BLOCK)][n // 2 % BLOCK, n % 2, orbit])

        return draw

    return starts, of


def test_side_by_side_is_bit_for_bit_one_after_the_other() -> None:
    episodes, seed = 2000, 7
    learned = learn(PAPER, [3, seed], episodes)
    starts, draws = draws_of(seed, episodes)
    plain = PlainLearner()
    orbits = orbit_of(np.array(starts))[0].tolist()
    returns = [plain.episode(start, draws(orbit)) for start, orbit in zip(starts, orbits, strict=True)]
    assert np.array_equal(learned.q[1], plain.q)
    assert np.array_equal(learned.returns[1], np.array(returns, np.float32))
    assert learned.curve.value[1, -1] == pytest.approx(plain.value(), abs=1e-9)


def test_a_seed_learns_the_same_whoever_learns_beside_it() -> None:
    alone, together = learn(PAPER, [4], 500), learn(PAPER, [9, 4, 2], 500)
    assert np.array_equal(alone.q[0], together.q[1])
    assert np.array_equal(alone.curve.value[0], together.curve.value[1])


def test_the_curve_is_the_exact_value_of_what_has_been_learned_so_far() -> None:
    whole = learn(PAPER, [5], 600)
    model = AbstractMdp().over(one_target_codes())
    for episodes in (100, 300, 600):
        q = learn_prefix(5, episodes, 600)
        best = (q >= q.max(axis=1, keepdims=True)).astype(float)
        value = evaluate(model, best / best.sum(axis=1, keepdims=True), horizon=100).mean()
        assert whole.curve.value[0, episodes // 100] == pytest.approx(value, abs=1e-9)


def learn_prefix(seed: int, episodes: int, of: int) -> np.ndarray:
    """The values after the first `episodes` of a longer training, by the plain learner."""
    starts, draws = draws_of(seed, of)
    plain = PlainLearner()
    orbits = orbit_of(np.array(starts))[0].tolist()
    for start, orbit in list(zip(starts, orbits, strict=True))[:episodes]:
        plain.episode(start, draws(orbit))
    return np.array(plain.q)


def test_the_papers_learner_passes_fgs_just_before_15000_episodes(paper: Learned) -> None:
    mean = paper.curve.value.mean(axis=0)
    assert mean[150] == pytest.approx(228.0, abs=0.6)
    assert mean[80] == pytest.approx(216.8, abs=3)
    assert mean[[1, 5, 10, 20]] == pytest.approx([-199.6, -175.9, -139.0, -42.0], abs=12)
    assert 12_000 <= paper.curve.episodes[mean > FGS].min() <= 15_000
    assert mean.max() < OPTIMUM


def test_learning_from_scratch_costs_an_operator_a_thousand_bad_searches(paper: Learned) -> None:
    assert paper.returns[:, :1000].mean() == pytest.approx(-172, abs=6)
    assert paper.returns[:, -1000:].mean() == pytest.approx(184, abs=6)


@pytest.mark.parametrize(
    ("variant", "at_1000", "at_4000", "at_15000"),
    [
        ("mirror", -45, 212, 228.5),
        ("optimistic", -159.4, 144.9, 224.7),
        ("mirror-optimistic", -43, 208, 228.3),
        ("expected-sarsa", -134.8, 168.5, 227.4),
        ("dyna", -100, 205, 225.5),
        ("dyna-optimistic", -162, 180, 228.4),
    ],
)
def test_each_variant_learns_at_its_own_pace(variant: str, at_1000: float, at_4000: float, at_15000: float) -> None:
    value = learn(VARIANTS[variant], range(3)).curve.value.mean(axis=0)
    assert value[10] == pytest.approx(at_1000, abs=12)
    assert value[40] == pytest.approx(at_4000, abs=12)
    assert value[150] == pytest.approx(at_15000, abs=1.2)


@pytest.mark.parametrize(("variant", "least"), [("from-fgs", FGS), ("from-plan", 228.9)])
def test_a_learner_that_starts_from_knowledge_is_never_worse_than_it(variant: str, least: float) -> None:
    assert learn(VARIANTS[variant], range(5)).curve.value.min() >= least


def test_a_mirrored_table_is_symmetric() -> None:
    q = learn(VARIANTS["mirror"], [1], 3000).q[0]
    codes = one_target_codes()
    index = {code: i for i, code in enumerate(codes.tolist())}
    twin = [index[code] for code in mirror(codes).tolist()]
    different = mirror(codes) != codes
    assert np.array_equal(q[different, LEFT], q[twin][different, RIGHT])
    assert np.array_equal(q[:, CONFIRM], q[twin][:, CONFIRM])


def test_the_factored_learner_needs_a_handful_of_episodes() -> None:
    curves = learn_factored(range(2), [0, 5, 30])
    assert np.all(curves[:, 0] < 0)
    assert np.all(curves[:, 1:] > 228)
    assert curves[:, 2].mean() > 228.6


def test_the_factored_learner_finds_out_that_a_wrong_confirmation_does_not_end_the_search() -> None:
    learner = FactoredLearner(AbstractMdp(wrong_confirm_ends=False))
    for _ in range(4):
        learner.episode(np.random.default_rng(3))
    assert learner.value() > 227


def test_orbits_are_the_eight_rotations_of_a_state() -> None:
    index = np.arange(2048)
    orbit, position = orbit_of(index)
    assert np.array_equal(index_of(orbit, position), index)
    assert np.bincount(orbit).tolist() == [8] * 256
    successors = AbstractMdp().over(one_target_codes()).successors
    for k in range(8):
        assert np.array_equal(index_of(orbit, (position - k) % 8), successors[:, k])


def test_tables_go_to_orbits_and_back() -> None:
    table = np.random.default_rng(0).random((2048, 3))
    assert np.array_equal(by_index(by_orbit(table)), table)


def test_mirrored_orbits_are_those_of_mirrored_codes() -> None:
    codes = one_target_codes()
    index = {code: i for i, code in enumerate(codes.tolist())}
    orbit, position = orbit_of(np.arange(2048))
    twin_orbit, twin_position = orbit_of(np.array([index[code] for code in mirror(codes).tolist()]))
    assert np.array_equal(mirror_orbit(orbit), twin_orbit)
    assert np.array_equal(-position % 8, twin_position)


@pytest.mark.parametrize("reward_on", RewardOn)
@pytest.mark.parametrize("kernel", Kernel)
@pytest.mark.parametrize("ends", [True, False])
def test_orbit_by_orbit_is_worth_what_the_whole_is(kernel: Kernel, reward_on: RewardOn, ends: bool) -> None:
    mdp = AbstractMdp(p=(0.6, 0.9), kernel=kernel, reward_on=reward_on, wrong_confirm_ends=ends)
    chances = np.random.default_rng(1).dirichlet([1, 1, 1], size=2048)
    whole = evaluate(mdp.over(one_target_codes()), chances, horizon=30)
    values = orbit_values(mdp, np.arange(N_ORBITS), by_orbit(chances), 30)
    assert values == pytest.approx(by_orbit(whole[:, None]).mean(axis=(1, 2)))


def test_other_readings_of_the_paper_can_be_learned_too() -> None:
    reading = AbstractMdp(kernel=Kernel.JUMP, reward_on=RewardOn.DEPARTURE, wrong_confirm_ends=False)
    learned = learn(LearnerSettings(start=Start.FGS, epsilon=0.0, alpha=0.05, gamma=1.0), [0], 500, reading)
    fgs = policy_table(one_target_codes(), fgs_choices)
    assert learned.curve.value[0, -1] > evaluate(reading.over(one_target_codes()), fgs).mean()


def test_starting_from_the_plan_is_being_optimal() -> None:
    q = start_values(LearnerSettings(start=Start.PLAN, gamma=1.0), AbstractMdp())
    assert q.max(axis=1).mean() == pytest.approx(OPTIMUM, abs=1e-3)
    assert np.array_equal(np.unique(greedy(q)), [LEFT, RIGHT, CONFIRM])


def test_a_plain_training_can_be_timed() -> None:
    import random

    curve = train_plain(random.Random(1), 200)
    assert len(curve) == 2
    assert np.all(curve < 0)


def test_settings_that_make_no_sense_are_refused() -> None:
    for kwargs in ({"alpha": 0.0}, {"gamma": 0.0}, {"epsilon": 1.5}, {"dyna": -1}, {"max_steps": 0}):
        with pytest.raises(ValueError, match="learner"):
            LearnerSettings(**kwargs)
    with pytest.raises(ValueError, match="seed"):
        learn(PAPER, [])
    with pytest.raises(ValueError, match="mirror"):
        learn(VARIANTS["mirror"], [0], mdp=AbstractMdp(p=(0.5, 0.9)))
