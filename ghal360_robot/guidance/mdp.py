"""The abstract MDP of guidance: which cue to show in which egocentric state (paper, section III-B).

A head turn only rotates the egocentric state, so a transition is a distribution over the eight rotations
and every state has eight successors. The readings that the paper leaves open (what an operator does who
does not follow, when the cost falls due, whether a wrong confirmation ends the search) are parameters;
all of them have the same optimal policy.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.egocentric import CLUTTER, N_CODES, N_WEDGES, TARGET, rotate_right
from ghal360_robot.messages import Cue

LEFT, RIGHT, CONFIRM = 0, 1, 2
ACTIONS = (Cue.LEFT, Cue.RIGHT, Cue.CONFIRM)
"""The cue of each action index."""

N_CLUTTER = 1 << N_WEDGES
N_ONE_TARGET = N_WEDGES * N_CLUTTER


class Kernel(Enum):
    """What the head does in the remaining 1 - p when the operator does not simply follow the arrow."""

    FOLLOW_OR_LR = "follow_or_lr"
    """One wedge left or right at random (the default)."""
    OPPOSITE = "opposite"
    LEFT_RIGHT_STAY = "left_right_stay"
    STAY = "stay"
    OPPOSITE_OR_STAY = "opposite_or_stay"
    JUMP = "jump"
    """To any of the eight wedges, uniformly."""


class RewardOn(Enum):
    """Whether a look costs what is seen after it (the default) or before it."""

    ARRIVAL = "arrival"
    DEPARTURE = "departure"


_OTHERWISE: dict[Kernel, dict[int, float]] = {
    Kernel.FOLLOW_OR_LR: {1: 1 / 2, -1: 1 / 2},
    Kernel.OPPOSITE: {-1: 1.0},
    Kernel.LEFT_RIGHT_STAY: {1: 1 / 3, -1: 1 / 3, 0: 1 / 3},
    Kernel.STAY: {0: 1.0},
    Kernel.OPPOSITE_OR_STAY: {-1: 1 / 2, 0: 1 / 2},
    Kernel.JUMP: dict.fromkeys(range(N_WEDGES), 1 / N_WEDGES),
}
"""Share of 1 - p of each turn, in wedges along the arrow."""


@dataclass(frozen=True, slots=True)
class Model:
    """The MDP over a list of S states, as arrays."""

    codes: NDArray[np.int64]
    """(S,) egocentric codes."""
    successors: NDArray[np.int64]
    """(S, 8) index of the state after the head turned k wedges to the right."""
    turns: NDArray[np.float64]
    """(2, 8) chance that the head turns k wedges to the right under LEFT and RIGHT."""
    reward: NDArray[np.float64]
    """(S, 3) expected reward of LEFT, RIGHT, CONFIRM."""
    confirm_ends: NDArray[np.bool_]
    """(S,) whether CONFIRM ends the episode; if not, the head stays."""
    asked: NDArray[np.bool_]
    """(S,) whether a target is somewhere in view; elsewhere guidance is not asked and all is worth 0."""


@dataclass(frozen=True, slots=True)
class AbstractMdp:
    """The parameters of the MDP; the defaults are the paper's, or the reading recommended for it."""

    p: float | tuple[float, float] = 0.8
    """Chance to follow an arrow; a pair (left, right) for an operator who follows the two unequally."""
    kernel: Kernel = Kernel.FOLLOW_OR_LR
    clear_cost: float = 3.0
    clutter_cost: float = 15.0
    confirm_reward: float = 250.0
    wrong_confirm_cost: float = 250.0
    reward_on: RewardOn = RewardOn.ARRIVAL
    wrong_confirm_ends: bool = True

    def __post_init__(self) -> None:
        if not all(0 <= p <= 1 for p in self.follow):
            raise ValueError(f"The chance to follow an arrow must be in 0..1, not {self.p}.")
        if self.clear_cost <= 0 or self.clutter_cost <= 0:
            raise ValueError("Every look must cost something, else the search need never end.")

    @property
    def follow(self) -> tuple[float, float]:
        """The chance to follow the left and the right arrow."""
        return self.p if isinstance(self.p, tuple) else (self.p, self.p)

    def turns(self) -> NDArray[np.float64]:
        """(2, 8) chance that the head turns k wedges to the right under LEFT and under RIGHT."""
        turns = np.zeros((2, N_WEDGES))
        for action, along, p in zip((LEFT, RIGHT), (-1, 1), self.follow, strict=True):
            turns[action, along % N_WEDGES] += p
            for turn, share in _OTHERWISE[self.kernel].items():
                turns[action, along * turn % N_WEDGES] += (1 - p) * share
        return turns

    def over(self, codes: NDArray[np.int64]) -> Model:
        """The MDP over these states, which must be closed under rotation (ValueError if they are not)."""
        index = np.full(N_CODES, -1, dtype=np.int64)
        index[codes] = np.arange(len(codes))
        successors = np.empty((len(codes), N_WEDGES), dtype=np.int64)
        rotated = codes
        for k in range(N_WEDGES):
            successors[:, k] = index[rotated]
            rotated = rotate_right(rotated)
        if np.any(successors < 0):
            raise ValueError("A head turn leads out of these states; list every rotation of each.")
        turns = self.turns()
        cost = np.where(codes & CLUTTER, self.clutter_cost, self.clear_cost)
        reward = np.empty((len(codes), 3))
        if self.reward_on is RewardOn.ARRIVAL:
            reward[:, :CONFIRM] = -cost[successors] @ turns.T
        else:
            reward[:, :CONFIRM] = -cost[:, None]
        found = (codes & TARGET) > 0
        reward[:, CONFIRM] = np.where(found, self.confirm_reward, -self.wrong_confirm_cost)
        target_bits = sum(TARGET << 2 * i for i in range(N_WEDGES))
        return Model(
            codes=codes,
            successors=successors,
            turns=turns,
            reward=reward,
            confirm_ends=found | self.wrong_confirm_ends,
            asked=(codes & target_bits) > 0,
        )


def one_target_codes() -> NDArray[np.int64]:
    """(2048,) the codes with exactly one target, in the order of `one_target_index`."""
    index = np.arange(N_ONE_TARGET, dtype=np.int64)
    target, clutter = index // N_CLUTTER, index % N_CLUTTER
    codes: NDArray[np.int64] = TARGET << 2 * target
    for i in range(N_WEDGES):
        codes = codes | (clutter >> i & 1) << 2 * i
    return codes


def one_target_index(target: int, clutter: int) -> int:
    """The compact index of (wedge of the target, clutter as an 8-bit mask with wedge i in bit i)."""
    return target * N_CLUTTER + clutter


def all_codes() -> NDArray[np.int64]:
    """(65536,) every code; a state's index is its code."""
    return np.arange(N_CODES, dtype=np.int64)
