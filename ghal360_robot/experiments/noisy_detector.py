"""What fusing detections is worth: the abstract simulation seen through a detector that misses and invents."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.guidance.belief import WAIT, DetectorModel, choose, turned, update
from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, RIGHT, AbstractMdp, one_target_codes
from ghal360_robot.guidance.planning import value_iteration

if TYPE_CHECKING:
    from numpy.typing import NDArray

RATES = ((0.95, 0.02), (0.8, 0.05), (0.6, 0.05), (0.8, 0.15))
EPISODES = 10_000
MOST_LOOKS = 200


@dataclass(frozen=True, slots=True)
class NoisyResult:
    """Of one way to act: mean return with its standard error, and the share of wrong confirmations."""

    mean_return: float
    se: float
    wrong: float

    def to_json(self) -> dict[str, float]:
        return {"return": round(self.mean_return, 2), "se": round(self.se, 2), "wrong": round(self.wrong, 4)}


def compare(hit_rate: float, false_rate: float, episodes: int = EPISODES, seed: int = 0) -> dict[str, Any]:
    """Acting on each picture by itself, and on the fused belief; independent looks, one per act."""
    model = DetectorModel(
        hit_rate=hit_rate, false_rate=false_rate, correlation_s=1.0, fade_s=1e9, prior_in_view=1 - 1e-6
    )
    return {
        "hit_rate": hit_rate,
        "false_rate": false_rate,
        "episodes": episodes,
        "picture by picture": _play(model, episodes, seed, fused=False).to_json(),
        "fused": _play(model, episodes, seed, fused=True).to_json(),
    }


def compare_rates(rates: tuple[float, float]) -> dict[str, Any]:
    """`compare` for a process of its own."""
    return compare(*rates)


def _play(model: DetectorModel, episodes: int, seed: int, *, fused: bool) -> NoisyResult:
    mdp = AbstractMdp()
    q = value_iteration(mdp.over(one_target_codes())).q
    turns = np.cumsum(mdp.turns(), axis=1)
    rng = np.random.default_rng([seed, 9])
    target = rng.integers(N_WEDGES, size=episodes)
    clutter = (rng.random((episodes, N_WEDGES)) < 0.5).astype(np.float64)
    head = np.zeros(episodes, np.int64)
    belief = np.tile(model.prior, (episodes, 1))
    gained, wrong = np.zeros(episodes), np.zeros(episodes, bool)
    going = np.arange(episodes)
    for _ in range(MOST_LOOKS):
        if not len(going):
            break
        offset = (target[going] - head[going]) % N_WEDGES
        in_wedge = offset[:, None] == np.arange(N_WEDGES)
        seen = rng.random(in_wedge.shape) < np.where(in_wedge, model.hit_rate, model.false_rate)
        ahead = np.take_along_axis(clutter[going], (np.arange(N_WEDGES) + head[going, None]) % N_WEDGES, axis=1)
        # The belief is kept as seen from the head: it turns when the head does.
        belief[going] = update(model, belief[going], seen, model.correlation_s)
        certain = belief[going] if fused else _believe_the_picture(seen)
        action = choose(model if fused else replace(model, sure=0.51), q, certain, ahead)
        over = action == CONFIRM
        right = offset == 0
        gained[going[over]] += np.where(right[over], mdp.confirm_reward, -mdp.wrong_confirm_cost)
        wrong[going[over]] = ~right[over]
        turn = _turns(turns, action, rng.random(len(going)))
        head[going] = (head[going] + turn) % N_WEDGES
        for k in np.unique(turn[turn > 0]).tolist():
            moved = going[turn == k]
            belief[moved] = turned(belief[moved], k)
        going = going[~over]
        cluttered = clutter[going, head[going]]
        gained[going] -= np.where(cluttered > 0, mdp.clutter_cost, mdp.clear_cost)
    return NoisyResult(float(gained.mean()), float(gained.std() / np.sqrt(episodes)), float(wrong.mean()))


def _believe_the_picture(seen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(m, 9) certainty of the nearest report, in focus first; none: not in view."""
    order = np.array([0, 1, 7, 2, 6, 3, 5, 4])
    nearest = order[seen[:, order].argmax(axis=1)]
    wedge = np.where(seen.any(axis=1), nearest, N_WEDGES)
    return np.eye(N_WEDGES + 1)[wedge]


def _turns(edges: NDArray[np.float64], action: NDArray[np.int64], u: NDArray[np.float64]) -> NDArray[np.int64]:
    """How far each head turns; not at all while waiting or confirming."""
    arrow = np.where(action == LEFT, LEFT, RIGHT)
    turn = (u[:, None] >= edges[arrow]).sum(axis=1) % N_WEDGES
    still = (action == WAIT) | (action == CONFIRM)
    return np.where(still, 0, turn)
