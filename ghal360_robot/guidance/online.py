"""Learning on the robot, per decision epoch (Algorithm 1 of the paper), starting from the plan.

An epoch lasts until the head has left its wedge, or two seconds. Nothing is explored: an operator is never
asked to confirm a place to see what happens. Two things can be learned: the operator's follow rates, with
the plan made anew for them a sweep of value iteration per step (0.2 ms, never a long tick), or the values
themselves by Q-learning. Pure: the state goes in and comes out, arrays in it are never written to.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.guidance.belief import act
from ghal360_robot.guidance.cueing import EPOCH_S
from ghal360_robot.guidance.egocentric import CLUTTER, N_WEDGES, TARGET, decode
from ghal360_robot.guidance.follow_rates import FollowRates
from ghal360_robot.guidance.mdp import (
    ACTIONS,
    CONFIRM,
    LEFT,
    RIGHT,
    AbstractMdp,
    Model,
    one_target_codes,
    one_target_index,
)
from ghal360_robot.guidance.planning import PREFERENCE, TIE, TOLERANCE, action_values, value_iteration
from ghal360_robot.guidance.policy import Advice
from ghal360_robot.guidance.rule import rule_action
from ghal360_robot.messages import Cue

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.guidance.cueing import CueState

ALPHA = 0.05
"""Step of Q-learning from values that are already good."""
MAX_SWEEPS = 2000
"""Of one replanning: twenty times what settles; an operator who never follows would go on for ever."""
SHOWN = {Cue.LEFT: LEFT, Cue.RIGHT: RIGHT}


class Learning(Enum):
    """What is learned from the operator."""

    RATES = "rates"
    VALUES = "values"


@dataclass(frozen=True, slots=True)
class Epoch:
    """A decision that stands: the state it was made in, what is shown, and since when."""

    code: int
    action: int
    head_wedge: int
    since_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class Learnt:
    """What is known about this operator; `q` (2048, 3) is by `mdp.one_target_codes`."""

    q: NDArray[np.float64]
    rates: FollowRates = FollowRates()
    epochs: int = 0
    """Epochs learned from, over all runs."""


@dataclass(frozen=True, slots=True, eq=False)
class OnlineState:
    """What is known, the open epoch, and the replanning under way."""

    learnt: Learnt
    epoch: Epoch | None = None
    model: Model | None = None
    """The model being planned with; None when the plan is done."""
    sweeps: int = 0
    found_presses: int | None = None


@dataclass(frozen=True, slots=True)
class LearnedPolicy:
    """The greedy policy of learned values; the rule where there is not exactly one target."""

    q: NDArray[np.float64] = field(repr=False)
    name: str = "learned"

    def advise(self, code: int, u: float, belief: NDArray[np.float64] | None = None) -> Advice:
        if belief is not None:
            chosen, expected = act(self.q, belief, code)
            return Advice(ACTIONS[chosen], expected)
        index = _index(code)
        if index is None:
            return Advice(ACTIONS[rule_action(code)])
        values = self.q[index].tolist()
        best = max(values) - TIE
        action = next(a for a in PREFERENCE if values[a] >= best)
        return Advice(ACTIONS[action], (values[0], values[1], values[2]))


@dataclass(frozen=True)
class OnlineLearner:
    """The settings, and the pure step; `mdp` gives the costs, the operator's part of it is learned."""

    learning: Learning = Learning.RATES
    mdp: AbstractMdp = AbstractMdp()
    alpha: float = ALPHA
    epoch_s: float = EPOCH_S

    def begin(self, known: Learnt | None = None) -> OnlineState:
        """The state at the start of a run: what was known before, or the plan."""
        if known is None:
            known = Learnt(_fixed(self._plan))
        return OnlineState(known)

    def policy(self, state: OnlineState) -> LearnedPolicy:
        return LearnedPolicy(state.learnt.q)

    def step(self, state: OnlineState, cue: CueState, found_presses: int | None, stamp_ns: int) -> OnlineState:
        """Take in what is shown now, where the head is (both in `cue`), and the operator's presses of "found"."""
        state = self._sweep(state)
        state = self._found(state, cue, found_presses)
        epoch = state.epoch
        if epoch is not None and cue.head_wedge is not None:
            turn = (cue.head_wedge - epoch.head_wedge) % N_WEDGES
            if turn or stamp_ns - epoch.since_ns >= self.epoch_s * 1e9:
                state = self._learn(replace(state, epoch=None), epoch, turn, cue.code)
            elif SHOWN.get(cue.cue) != epoch.action:
                state = replace(state, epoch=None)  # the scene changed: nobody can say what was answered
        action = SHOWN.get(cue.cue)
        if state.epoch is None and action is not None and cue.head_wedge is not None:
            state = replace(state, epoch=Epoch(cue.code, action, cue.head_wedge, stamp_ns))
        return state

    def _learn(self, state: OnlineState, epoch: Epoch, turn: int, code: int) -> OnlineState:
        known = state.learnt
        here, there = _index(epoch.code), _index(code)
        if here is None or there is None:
            return state
        if self.learning is Learning.RATES:
            rates = known.rates.observed(epoch.action, turn)
            model = replace(self.mdp, p=rates.p).over(one_target_codes())
            known = replace(known, rates=rates, epochs=known.epochs + 1)
            return replace(state, learnt=known, model=model, sweeps=0)
        reward = -(self.mdp.clutter_cost if code & CLUTTER else self.mdp.clear_cost)
        goal = reward + float(known.q[there].max())
        q = self._towards(known.q, here, epoch.action, goal)
        return replace(state, learnt=replace(known, q=q, epochs=known.epochs + 1))

    def _found(self, state: OnlineState, cue: CueState, presses: int | None) -> OnlineState:
        """A press of "found" while asked to confirm is the reward of confirming."""
        before = state.found_presses
        state = replace(state, found_presses=presses)
        pressed = before is not None and presses is not None and presses > before
        index = _index(cue.code)
        if not pressed or cue.cue is not Cue.CONFIRM or self.learning is Learning.RATES or index is None:
            return state
        q = self._towards(state.learnt.q, index, CONFIRM, self.mdp.confirm_reward)
        return replace(state, learnt=replace(state.learnt, q=q))

    def _towards(self, q: NDArray[np.float64], index: int, action: int, goal: float) -> NDArray[np.float64]:
        better = q.copy()
        better[index, action] += self.alpha * (goal - better[index, action])
        return _fixed(better)

    def _sweep(self, state: OnlineState) -> OnlineState:
        """One sweep of value iteration, while there is a plan to be made."""
        if state.model is None:
            return state
        v = state.learnt.q.max(axis=1)
        q = action_values(state.model, v)
        settled = bool(np.max(np.abs(q.max(axis=1) - v)) <= TOLERANCE) or state.sweeps >= MAX_SWEEPS
        return replace(
            state,
            learnt=replace(state.learnt, q=_fixed(q)),
            model=None if settled else state.model,
            sweeps=state.sweeps + 1,
        )

    @cached_property
    def _plan(self) -> NDArray[np.float64]:
        return value_iteration(self.mdp.over(one_target_codes())).q


def _index(code: int) -> int | None:
    """The place of a code among those with one target; None for any other."""
    wedges = decode(code)
    targets = [i for i, value in enumerate(wedges) if value & TARGET]
    if len(targets) != 1:
        return None
    return one_target_index(targets[0], sum((value & CLUTTER) << i for i, value in enumerate(wedges)))


def _fixed(q: NDArray[np.float64]) -> NDArray[np.float64]:
    q.flags.writeable = False
    return q
