"""The paper's Q-learning as one would write it first: one state, one step, one update at a time.

The yardstick of the vectorised learner, for its speed and, given the same draws, for every last bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.guidance.egocentric import CLUTTER, TARGET
from ghal360_robot.guidance.learner import PAPER, SNAPSHOT_EVERY, LearnerSettings
from ghal360_robot.guidance.learning_curve import HORIZON
from ghal360_robot.guidance.mdp import CONFIRM, RIGHT, AbstractMdp, one_target_codes
from ghal360_robot.guidance.planning import evaluate

if TYPE_CHECKING:
    import random
    from collections.abc import Callable

    from numpy.typing import NDArray

TIED_SIXTHS = 6
"""Ties of two and of three are drawn from the same sixths."""


class PlainLearner:
    """Constant step, epsilon-greedy, the paper's operator; `q` is a list of three values per state."""

    def __init__(self, settings: LearnerSettings = PAPER, mdp: AbstractMdp | None = None) -> None:
        self.settings = settings
        self.mdp = mdp or AbstractMdp()
        self.model = self.mdp.over(one_target_codes())
        codes = self.model.codes.tolist()
        self.on_target = [bool(code & TARGET) for code in codes]
        self.cost = [self.mdp.clutter_cost if code & CLUTTER else self.mdp.clear_cost for code in codes]
        self.successors = self.model.successors.tolist()
        self.follow_right = float(self.mdp.turns()[RIGHT, 1])
        self.q = [[settings.q0] * 3 for _ in codes]

    def episode(self, state: int, random: Callable[[], float]) -> float:
        """One search from `state`, learning from every step; its return."""
        settings, q = self.settings, self.q
        follow_right = self.follow_right
        gained = 0.0
        for _ in range(settings.max_steps):
            values = q[state]
            u = random()
            options: tuple[int, ...] = (0, 1, 2)
            if u < settings.epsilon:
                u /= settings.epsilon
            else:
                best = max(values)
                options = tuple(a for a in (0, 1, 2) if values[a] >= best)
                u = (u - settings.epsilon) / (1 - settings.epsilon)
            action = options[min(int(u * TIED_SIXTHS), TIED_SIXTHS - 1) * len(options) // TIED_SIXTHS]
            turn_u = random()
            if action == CONFIRM:
                reward = self.mdp.confirm_reward if self.on_target[state] else -self.mdp.wrong_confirm_cost
                values[action] += settings.alpha * (reward - values[action])
                return gained + reward
            obeys = turn_u < follow_right if action == RIGHT else turn_u >= 1 - follow_right
            turn = 1 if (action == RIGHT) == obeys else 7
            there = self.successors[state][turn]
            reward = -self.cost[there]
            gained += reward
            values[action] += settings.alpha * (reward + settings.gamma * max(q[there]) - values[action])
            state = there
        return gained

    def value(self) -> float:
        """The exact value of the greedy policy, ties played out evenly."""
        q = np.array(self.q)
        best = (q >= q.max(axis=1, keepdims=True)).astype(np.float64)
        best /= best.sum(axis=1, keepdims=True)
        return float(evaluate(self.model, best, horizon=HORIZON).mean())


def train_plain(rng: random.Random, episodes: int, every: int = SNAPSHOT_EVERY) -> NDArray[np.float64]:
    """The learning curve of one seed: the value after every so many episodes."""
    learner, curve = PlainLearner(), []
    states = len(learner.q)
    for episode in range(episodes):
        learner.episode(rng.randrange(states), rng.random)
        if (episode + 1) % every == 0:
            curve.append(learner.value())
    return np.array(curve)
