"""Guidance policies behind one small interface, and their names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.belief import act
from ghal360_robot.guidance.egocentric import N_CODES
from ghal360_robot.guidance.fgs import Tie, fgs_action
from ghal360_robot.guidance.mdp import ACTIONS, AbstractMdp, all_codes, one_target_codes
from ghal360_robot.guidance.planning import greedy, value_iteration
from ghal360_robot.guidance.rule import rule_action
from ghal360_robot.messages import Cue

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class Advice:
    """The cue to show, and the values of left, right, confirm where the policy has values."""

    cue: Cue
    q: tuple[float, float, float] | None = None


NOTHING = Advice(Cue.NONE)


class Policy(Protocol):
    """A guidance strategy. It is pure: what it needs of chance is passed in."""

    @property
    def name(self) -> str: ...

    def advise(self, code: int, u: float, belief: NDArray[np.float64] | None = None) -> Advice:
        """The cue for an egocentric code with a target in view; `u` is a uniform draw from [0, 1).

        `belief` (9,) says where the target may be, as seen from the head, and `code` then where it most likely is. A
        policy with values acts on their expectation, others on the code.
        """
        ...


class ValuePolicy:
    """The greedy policy of action values (65536, 3), indexed by code: planned, or learned."""

    def __init__(self, name: str, q: NDArray[np.float64]) -> None:
        if q.shape != (N_CODES, len(ACTIONS)):
            raise ValueError(f"A policy needs values of shape {(N_CODES, len(ACTIONS))}, not {q.shape}.")
        self.name = name
        self.q = q.copy()
        self.q.flags.writeable = False
        self._actions = greedy(q)
        self._one_target = q[one_target_codes()]

    def advise(self, code: int, u: float, belief: NDArray[np.float64] | None = None) -> Advice:
        if belief is not None:
            action, values = act(self._one_target, belief, code)
            return Advice(ACTIONS[action], values)
        left, right, confirm = self.q[code].tolist()
        return Advice(ACTIONS[self._actions[code]], (left, right, confirm))


@dataclass(frozen=True, slots=True)
class RulePolicy:
    """The optimal plan in closed form; needs no table."""

    name: str = "rule"

    def advise(self, code: int, u: float, belief: NDArray[np.float64] | None = None) -> Advice:
        return Advice(ACTIONS[rule_action(code)])


@dataclass(frozen=True, slots=True)
class FgsPolicy:
    """Always the shorter way; `tie` says where to turn when the target is exactly behind."""

    name: str = "fgs"
    tie: Tie = Tie.RANDOM

    def advise(self, code: int, u: float, belief: NDArray[np.float64] | None = None) -> Advice:
        return Advice(ACTIONS[fgs_action(code, self.tie, u)])


@dataclass(frozen=True, slots=True)
class NoGuidance:
    """Shows nothing: the paper's unguided baselines."""

    name: str = "none"

    def advise(self, code: int, u: float, belief: NDArray[np.float64] | None = None) -> Advice:
        return NOTHING


def plan_policy(mdp: AbstractMdp | None = None) -> ValuePolicy:
    """The optimal policy of an abstract MDP (the default one if not given); about 0.2 s of planning."""
    return ValuePolicy("plan", value_iteration((mdp or AbstractMdp()).over(all_codes())).q)


_POLICIES: dict[str, Callable[[], Policy]] = {
    "plan": plan_policy,
    "rule": RulePolicy,
    "fgs": FgsPolicy,
    "fgs-right": lambda: FgsPolicy("fgs-right", Tie.RIGHT),
    "fgs-clutter": lambda: FgsPolicy("fgs-clutter", Tie.CLUTTER),
    "none": NoGuidance,
}
POLICY_NAMES = tuple(_POLICIES)
DEFAULT_POLICY = "plan"


def make_policy(name: str = DEFAULT_POLICY) -> Policy:
    """The policy of that name. Raises ValueError, naming the known ones, for any other."""
    try:
        make = _POLICIES[name]
    except KeyError:
        raise ValueError(f"There is no guidance policy {name!r}; choose one of {', '.join(POLICY_NAMES)}.") from None
    return make()
