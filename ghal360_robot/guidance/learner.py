"""Tabular learners of the guidance policy: the paper's, and what can be done about its slowness."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.fgs import fgs_choices
from ghal360_robot.guidance.mdp import N_ONE_TARGET, one_target_codes
from ghal360_robot.guidance.orbits import N_ACTIONS
from ghal360_robot.guidance.planning import action_values, evaluate, policy_table, value_iteration

if TYPE_CHECKING:
    from ghal360_robot.guidance.mdp import AbstractMdp

EPISODES = 15_000
"""As many as in the paper."""
SNAPSHOT_EVERY = 100
"""Episodes between two tests of the greedy policy (paper)."""


class Start(Enum):
    """What the values are before the first episode."""

    CONSTANT = "constant"
    """`q0` everywhere."""
    FGS = "fgs"
    """The values of FGS: a learner that is never worse than the baseline."""
    PLAN = "plan"
    """The optimal values."""


@dataclass(frozen=True, slots=True)
class LearnerSettings:
    """The defaults are the paper's learner (with its library's: constant step and epsilon)."""

    alpha: float = 0.1
    alpha_power: float = 0.0
    """The step is alpha / n**power at the n-th visit of a state and action; 0: constant."""
    gamma: float = 0.99
    epsilon: float = 0.1
    q0: float = 0.0
    start: Start = Start.CONSTANT
    mirror: bool = False
    """Learn left and right as mirror images of each other: half the table."""
    expected_sarsa: bool = False
    """Learn the value of what is done, exploration included, instead of the best that could be."""
    dyna: int = 0
    """Remembered steps relived after each real one, drawn from the orbit at hand."""
    max_steps: int = 200
    """An episode that is not confirmed by then is cut off."""

    def __post_init__(self) -> None:
        if not (0 < self.alpha <= 1 and 0 <= self.epsilon <= 1 and 0 < self.gamma <= 1):
            raise ValueError("A learner's alpha and gamma lie in (0, 1], its epsilon in [0, 1].")
        if self.dyna < 0 or self.max_steps < 1 or self.alpha_power < 0:
            raise ValueError("A learner's dyna and alpha_power must not be negative, its max_steps at least 1.")


PAPER = LearnerSettings()
VARIANTS: dict[str, LearnerSettings] = {
    "paper": PAPER,
    "mirror": LearnerSettings(mirror=True),
    "optimistic": LearnerSettings(alpha=1.0, alpha_power=0.6, gamma=1.0, q0=250.0, epsilon=0.0),
    "mirror-optimistic": LearnerSettings(alpha=1.0, alpha_power=0.6, gamma=1.0, q0=250.0, epsilon=0.0, mirror=True),
    "expected-sarsa": LearnerSettings(alpha=1.0, alpha_power=0.6, gamma=1.0, expected_sarsa=True),
    "dyna": LearnerSettings(alpha=0.2, dyna=10),
    "dyna-optimistic": LearnerSettings(alpha=0.2, dyna=10, q0=250.0, epsilon=0.0),
    "from-fgs": LearnerSettings(alpha=0.05, gamma=1.0, epsilon=0.0, start=Start.FGS),
    "from-plan": LearnerSettings(alpha=0.05, gamma=1.0, epsilon=0.0, start=Start.PLAN),
}


def start_values(settings: LearnerSettings, mdp: AbstractMdp) -> NDArray[np.float64]:
    """(2048, 3) the values before the first episode."""
    if settings.start is Start.CONSTANT:
        return np.full((N_ONE_TARGET, N_ACTIONS), float(settings.q0))
    model = mdp.over(one_target_codes())
    if settings.start is Start.PLAN:
        return value_iteration(model, settings.gamma).q
    fgs = policy_table(model.codes, fgs_choices)
    return action_values(model, evaluate(model, fgs, settings.gamma), settings.gamma)
