"""A learner that knows what the abstract MDP is made of: what a look costs, and how the head turns.

A turn only rotates the state and the reward reads the focused wedge only, so there are eight reward
numbers and two distributions over turns to learn, and every step informs all 2,048 states. After each
episode the plan is made anew. A handful of episodes does what the table needs thousands for.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.guidance.egocentric import CLUTTER, N_WEDGES, TARGET
from ghal360_robot.guidance.learning_curve import HORIZON
from ghal360_robot.guidance.mdp import CONFIRM, AbstractMdp, Model, RewardOn, one_target_codes
from ghal360_robot.guidance.planning import evaluate, greedy, value_iteration

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

GAMMA = 0.99
"""Below 1, so that a plan made from a bad guess of the turns settles too."""
DOUBT = 0.1
"""Turns of each kind that are taken as seen before the first one is."""
N_VALUES = 4


@dataclass(slots=True, eq=False)
class FactoredLearner:
    """What one seed knows. Unseen rewards are taken for the best there is: each is tried once."""

    mdp: AbstractMdp = field(default_factory=AbstractMdp)
    look_sum: NDArray[np.float64] = field(default_factory=lambda: np.zeros(N_VALUES))
    look_count: NDArray[np.int64] = field(default_factory=lambda: np.zeros(N_VALUES, np.int64))
    confirm_sum: NDArray[np.float64] = field(default_factory=lambda: np.zeros(N_VALUES))
    confirm_count: NDArray[np.int64] = field(default_factory=lambda: np.zeros(N_VALUES, np.int64))
    turn_count: NDArray[np.float64] = field(default_factory=lambda: np.full((2, N_WEDGES), DOUBT))
    truth: Model = field(init=False)
    q: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        if self.mdp.reward_on is not RewardOn.ARRIVAL:
            raise ValueError("The factored learner reads what a look costs where it arrives.")
        self.truth = self.mdp.over(one_target_codes())
        self.q = self.plan()

    def plan(self) -> NDArray[np.float64]:
        """(2048, 3) the optimal values of what is believed."""
        look = np.where(self.look_count > 0, self.look_sum / np.maximum(self.look_count, 1), 0.0)
        confirm = np.where(
            self.confirm_count > 0, self.confirm_sum / np.maximum(self.confirm_count, 1), self.mdp.confirm_reward
        )
        turns = self.turn_count / self.turn_count.sum(axis=1, keepdims=True)
        focus = self.truth.codes & (CLUTTER | TARGET)
        reward = np.column_stack((look[focus][self.truth.successors] @ turns.T, confirm[focus]))
        believed = Model(
            codes=self.truth.codes,
            successors=self.truth.successors,
            turns=turns,
            reward=reward,
            confirm_ends=self.truth.confirm_ends,
            asked=self.truth.asked,
        )
        return value_iteration(believed, GAMMA).q

    def episode(self, rng: np.random.Generator, max_steps: int = HORIZON) -> None:
        """One search with the plan as it is, then a new plan."""
        actions = greedy(self.q)
        turns = self.mdp.turns()
        state = int(rng.integers(len(actions)))
        for _ in range(max_steps):
            action = int(actions[state])
            if action == CONFIRM:
                self._confirmed(state)
                if self.truth.confirm_ends[state]:
                    break
                # Whoever is told no and stays there would ask again: the new knowledge counts at once.
                self.q = self.plan()
                actions = greedy(self.q)
                continue
            turn = int(rng.choice(N_WEDGES, p=turns[action]))
            state = int(self.truth.successors[state, turn])
            self.turn_count[action, turn] += 1
            code = int(self.truth.codes[state])
            self.look_sum[code & (CLUTTER | TARGET)] -= self.mdp.clutter_cost if code & CLUTTER else self.mdp.clear_cost
            self.look_count[code & (CLUTTER | TARGET)] += 1
        self.q = self.plan()

    def value(self) -> float:
        """The exact value of the greedy policy."""
        return float(evaluate(self.truth, np.eye(3)[greedy(self.q)], horizon=HORIZON).mean())

    def _confirmed(self, state: int) -> None:
        value = int(self.truth.codes[state]) & (CLUTTER | TARGET)
        self.confirm_sum[value] += self.mdp.confirm_reward if value & TARGET else -self.mdp.wrong_confirm_cost
        self.confirm_count[value] += 1


def learn_factored(seeds: Sequence[int], episodes: Sequence[int]) -> NDArray[np.float64]:
    """(seeds, k) the value after so many episodes (rising), one learner per seed."""
    curves = np.empty((len(seeds), len(episodes)))
    for row, seed in zip(curves, seeds, strict=True):
        rng, learner, done = np.random.default_rng([seed, 8]), FactoredLearner(), 0
        for i, wanted in enumerate(episodes):
            for _ in range(wanted - done):
                learner.episode(rng)
            done = wanted
            row[i] = learner.value()
    return curves
