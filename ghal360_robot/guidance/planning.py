"""Exact planning and evaluation in the abstract MDP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, RIGHT, Model

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

TOLERANCE = 1e-9
"""Value iteration stops when no value changes by more; actions closer than `TIE` are equally good."""
TIE = 1e-6
MAX_SWEEPS = 10_000
"""Far above the 40..100 sweeps that sensible parameters need; p near 0 can make a search endless."""
PREFERENCE = (RIGHT, LEFT, CONFIRM)
"""Among equally good actions the first of these is taken."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Optimal values: `v` (S,) of the states and `q` (S, 3) of LEFT, RIGHT, CONFIRM in them."""

    v: NDArray[np.float64]
    q: NDArray[np.float64]
    sweeps: int


def action_values(model: Model, v: NDArray[np.float64], gamma: float = 1.0) -> NDArray[np.float64]:
    """(S, 3) one-step look-ahead from state values (S,)."""
    used = np.flatnonzero(model.turns.any(axis=0))
    q = model.reward.copy()
    q[:, :CONFIRM] += gamma * v[model.successors[:, used]] @ model.turns[:, used].T
    q[:, CONFIRM] += gamma * np.where(model.confirm_ends, 0.0, v)
    q[~model.asked] = 0.0
    return q


def value_iteration(model: Model, gamma: float = 1.0) -> Plan:
    """The optimal plan. Raises ValueError when the values do not settle."""
    v = np.zeros(len(model.codes))
    for sweep in range(1, MAX_SWEEPS + 1):
        q = action_values(model, v, gamma)
        better = q.max(axis=1)
        change = float(np.max(np.abs(better - v)))
        v = better
        if change <= TOLERANCE:
            return Plan(v=v, q=q, sweeps=sweep)
    raise ValueError(f"The plan did not settle in {MAX_SWEEPS} sweeps; is the chance to follow near 0?")


def greedy(q: NDArray[np.float64]) -> NDArray[np.int64]:
    """(S,) the best action of each row of (S, 3) values; ties within `TIE` go right, left, confirm."""
    order = np.array(PREFERENCE)
    ties = q[:, order] >= q.max(axis=1, keepdims=True) - TIE
    best: NDArray[np.int64] = order[np.argmax(ties, axis=1)]
    return best


def policy_table(codes: NDArray[np.int64], choices: Callable[[int], Collection[int]]) -> NDArray[np.float64]:
    """(S, 3) chance of each action where a policy picks evenly among `choices(code)`."""
    table = np.zeros((len(codes), 3))
    for row, code in zip(table, codes.tolist(), strict=True):
        actions = list(choices(code))
        row[actions] = 1 / len(actions)
    return table


def evaluate(
    model: Model, policy: NDArray[np.float64], gamma: float = 1.0, horizon: int | None = None
) -> NDArray[np.float64]:
    """(S,) exact expected return of a policy (S, 3) of action chances.

    Without a horizon the search goes on until it is confirmed; a policy that may turn for ever then has
    no undiscounted value (ValueError). With one, the value is of that many actions.
    """
    if horizon is None:
        return _solve(model, policy, gamma)
    v: NDArray[np.float64] = np.zeros(len(model.codes))
    for _ in range(horizon):
        v = np.einsum("sa,sa->s", policy, action_values(model, v, gamma))
    return v


def _solve(model: Model, policy: NDArray[np.float64], gamma: float) -> NDArray[np.float64]:
    """Bellman's equations; a state meets only its eight rotations, so they come in blocks of 8 x 8."""
    moves = policy[:, :CONFIRM] @ model.turns
    stays = policy[:, CONFIRM] * ~model.confirm_ends
    if gamma == 1.0:
        _require_end(model, policy, moves)
    orbit = model.successors
    asked = model.asked[orbit]
    system = np.broadcast_to(np.eye(N_WEDGES), (len(orbit), N_WEDGES, N_WEDGES)).copy()
    for here in range(N_WEDGES):
        onward = gamma * asked[:, here, None] * moves[orbit[:, here]]
        system[:, here, :] -= np.roll(onward, here, axis=1)
        system[:, here, here] -= gamma * asked[:, here] * stays[orbit[:, here]]
    gain = np.where(model.asked, np.sum(policy * model.reward, axis=1), 0.0)[orbit]
    return np.asarray(np.linalg.solve(system, gain[:, :, None])[:, 0, 0], dtype=np.float64)


def _require_end(model: Model, policy: NDArray[np.float64], moves: NDArray[np.float64]) -> None:
    ends = ~model.asked | ((policy[:, CONFIRM] > 0) & model.confirm_ends)
    for _ in range(N_WEDGES):
        ends = ends | np.any((moves > 0) & ends[model.successors], axis=1)
    if not ends.all():
        stuck = int(model.codes[np.argmin(ends)])
        raise ValueError(f"From state {stuck} this policy never confirms; evaluate it with a horizon.")
