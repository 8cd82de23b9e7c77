"""Many tabular learners trained at once.

The paper's learner runs one episode after the other. An episode stays in one orbit of eight states
(`orbits`) and orbits share nothing, so the episodes of different orbits, and of different seeds, run side
by side without changing a single update: each orbit sees its own episodes in their order. Fifteen thousand
episodes are then some six hundred steps of long vectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.dyna import Remembered
from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.guidance.learner import EPISODES, SNAPSHOT_EVERY, LearnerSettings, start_values
from ghal360_robot.guidance.learning_curve import Curve, GreedyLog
from ghal360_robot.guidance.mdp import CONFIRM, N_ONE_TARGET, AbstractMdp, RewardOn
from ghal360_robot.guidance.mirror_fold import mirror_fold, unfold
from ghal360_robot.guidance.orbits import (
    N_ACTIONS,
    N_ORBITS,
    ROW,
    by_index,
    by_orbit,
    look_costs,
    mirror_orbit,
    orbit_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

BLOCK = 16
"""Steps between two clearings-out of orbits that have had all their episodes."""


@dataclass(frozen=True, slots=True)
class Learned:
    """What a set of seeds learned."""

    q: Floats
    """(seeds, 2048, 3) values by `mdp.one_target_codes`."""
    curve: Curve
    returns: NDArray[np.float32]
    """(seeds, episodes) undiscounted return of every training episode."""
    steps: int
    """Real steps of all seeds together."""


def learn(
    settings: LearnerSettings,
    seeds: Sequence[int],
    episodes: int = EPISODES,
    mdp: AbstractMdp | None = None,
    every: int = SNAPSHOT_EVERY,
) -> Learned:
    """Train one learner per seed. A seed's result does not depend on the others trained beside it.

    Raises ValueError for an empty list of seeds, or where mirroring meets an operator who follows left
    and right unequally.
    """
    if not seeds or episodes < every:
        raise ValueError(f"Learning needs a seed and at least {every} episodes.")
    mdp = mdp or AbstractMdp()
    if settings.mirror and mdp.follow[0] != mdp.follow[1]:
        raise ValueError("Left and right are no mirror images for an operator who follows them unequally.")
    return Training(settings, mdp, list(seeds), episodes, every).run()


# Which action of a set of equally good ones a number of six stands for: 6 divides evenly by 1, 2 and 3.
_TIES = [[a for a in range(N_ACTIONS) if code >> a & 1] or [0] for code in range(1 << N_ACTIONS)]
PICK = np.array([tied[i * len(tied) // 6] for tied in _TIES for i in range(6)])


class Training:
    """The state of all orbits of all seeds; one row of everything per (seed, orbit), finished ones dropped."""

    def __init__(
        self, settings: LearnerSettings, mdp: AbstractMdp, seeds: list[int], episodes: int, every: int
    ) -> None:
        self.settings, self.mdp, self.seeds, self.episodes = settings, mdp, seeds, episodes
        self.rngs = [np.random.default_rng([seed, 360]) for seed in seeds]
        n = len(seeds) * N_ORBITS
        self.q = np.tile(by_orbit(start_values(settings, mdp)).ravel(), len(seeds))
        self.visits = np.zeros(n * ROW) if settings.alpha_power else None
        self.cost = look_costs(mdp)
        turns = mdp.turns()
        self.turn_values = np.flatnonzero(turns.any(axis=0))
        self.turn_edges = np.cumsum(turns[:, self.turn_values], axis=1)
        self.log = GreedyLog(mdp, len(seeds), episodes, every, self.q, mirrored=settings.mirror)
        self.returns = np.zeros((len(seeds), episodes), np.float32)
        self.steps = 0
        self._fold = mirror_fold() if settings.mirror else None
        self._dyna = Remembered(n) if settings.dyna else None
        self._queue_episodes(n)

    def _queue_episodes(self, n: int) -> None:
        """The starts of each row's episodes, one after the other, and the row's place in the list."""
        starts = np.concatenate([rng.integers(N_ONE_TARGET, size=self.episodes) for rng in self.rngs])
        orbit, position = orbit_of(starts)
        if self.settings.mirror:
            twin = mirror_orbit(orbit)
            position = np.where(twin < orbit, -position % N_WEDGES, position)
            orbit = np.minimum(orbit, twin)
        row = np.repeat(np.arange(len(self.seeds)) * N_ORBITS, self.episodes) + orbit
        self.queue = np.argsort(row, kind="stable")
        self.queue_position = position[self.queue]
        count = np.bincount(row, minlength=n)
        ends = np.cumsum(count)
        self.row = np.flatnonzero(count)
        self.next = (ends - count)[self.row]
        self.last = ends[self.row]
        self.position = self.queue_position[self.next]
        self.step_count = np.zeros(len(self.row), np.int64)
        self.gained = np.zeros(len(self.row))

    def run(self) -> Learned:
        while len(self.row):
            draws = np.stack([rng.random((BLOCK, 2, N_ORBITS)) for rng in self.rngs], axis=2)
            draws = draws.reshape(BLOCK, 2, -1)[:, :, self.row]
            again = self._draws_to_relive()
            for tick in range(BLOCK):
                self._step(*draws[tick])
                if self._dyna is not None:
                    for pair_u, outcome_u in again[tick]:
                        self._relive(self._dyna, pair_u[self.row], outcome_u[self.row])
            self._drop_finished()
        q = self.q.reshape(len(self.seeds), N_ORBITS, N_WEDGES, N_ACTIONS)
        if self.settings.mirror:
            q = unfold(q)
        return Learned(by_index(q), self.log.curve(), self.returns, self.steps)

    def _step(self, u: Floats, turn_u: Floats) -> None:
        """One act of the operator in every row that still has episodes."""
        s, position = self.settings, self.position
        live = self.next < self.last
        here = self._address(position)
        action = self._choose(here, u, position)
        turn = self._turn(action, turn_u)
        confirms = action == CONFIRM
        there = np.where(confirms, position, (position - turn) & N_WEDGES - 1)
        reward = self._reward(action, position, there)
        ends = confirms & (self.mdp.wrong_confirm_ends | (position == 0))
        self._learn(here, position, action, there, reward, ends, live)
        if self._dyna is not None:
            self._dyna.note(self.row[live], (position * N_ACTIONS + action)[live], there[live])
        self.gained += reward
        self.step_count += 1
        self.steps += int(np.count_nonzero(live))
        self.position = there
        over = np.flatnonzero(live & (ends | (self.step_count >= s.max_steps)))
        if over.size:
            self._finish(over)

    def _choose(self, here: Ints, u: Floats, position: Ints) -> Ints:
        """Epsilon-greedy; among equally good actions evenly."""
        epsilon = self.settings.epsilon
        left, right, confirm = self.q[here], self.q[here + 1], self.q[here + 2]
        best = np.maximum(np.maximum(left, right), confirm)
        code = (left >= best) + 2 * (right >= best) + 4 * (confirm >= best)
        explores = u < epsilon
        code[explores] = 7
        spread = np.where(explores, u / max(epsilon, 1e-300), (u - epsilon) / max(1 - epsilon, 1e-300))
        action = PICK[code * 6 + np.minimum((spread * 6).astype(np.int64), 5)]
        return self._fold_action(action, position)

    def _turn(self, action: Ints, u: Floats) -> Ints:
        edges = self.turn_edges[np.minimum(action, CONFIRM - 1)]
        chosen = np.zeros(len(action), np.int64)
        for j in range(len(self.turn_values) - 1):
            chosen += u >= edges[:, j]
        return self.turn_values[chosen]

    def _reward(self, action: Ints, position: Ints, there: Ints) -> Floats:
        mdp = self.mdp
        looked_at = there if mdp.reward_on is RewardOn.ARRIVAL else position
        confirmed = np.where(position == 0, mdp.confirm_reward, -mdp.wrong_confirm_cost)
        return np.where(action == CONFIRM, confirmed, -self.cost[self.row % N_ORBITS, looked_at])

    def _learn(
        self,
        here: Ints,
        position: Ints,
        action: Ints,
        there: Ints,
        reward: Floats,
        ends: NDArray[np.bool_],
        live: NDArray[np.bool_],
    ) -> None:
        ahead = self._address(there)
        options = self.q[ahead], self.q[ahead + 1], self.q[ahead + 2]
        onward = np.maximum(np.maximum(options[0], options[1]), options[2])
        if self.settings.expected_sarsa:
            epsilon = self.settings.epsilon
            onward = (1 - epsilon) * onward + epsilon * (options[0] + options[1] + options[2]) / N_ACTIONS
        goal = reward + self.settings.gamma * np.where(ends, 0.0, onward)
        address = here + self._fold_action(action, position)
        address, goal = address[live], goal[live]
        step: float | Floats = self.settings.alpha
        if self.visits is not None:
            self.visits[address] += 1
            step = self.settings.alpha / self.visits[address] ** self.settings.alpha_power
        self.q[address] += step * (goal - self.q[address])

    def _address(self, position: Ints) -> Ints:
        """Where the values of LEFT in each row's position begin."""
        if self._fold is not None:
            position = self._fold.position[self.row % N_ORBITS, position]
        return self.row * ROW + position * N_ACTIONS

    def _fold_action(self, action: Ints, position: Ints) -> Ints:
        """LEFT and RIGHT exchanged where a position is kept as its mirror image."""
        if self._fold is None:
            return action
        swapped = self._fold.swapped[self.row % N_ORBITS, position] & (action != CONFIRM)
        return np.where(swapped, 1 - action, action)

    def _finish(self, over: Ints) -> None:
        """Note what was learned, and begin the next episode."""
        row, place = self.row[over], self.next[over]
        episode = self.queue[place]
        self.returns.reshape(-1)[episode] = self.gained[over]
        values = self.q.reshape(-1, N_WEDGES, N_ACTIONS)
        self.log.note(
            row, episode, values.reshape(-1, ROW)[row] if self._fold is None else self._fold.whole(values, row)
        )
        self.next[over] += 1
        self.step_count[over] = 0
        self.gained[over] = 0.0
        more = over[self.next[over] < self.last[over]]
        self.position[more] = self.queue_position[self.next[more]]

    def _drop_finished(self) -> None:
        keep = self.next < self.last
        if keep.all():
            return
        for name in ("row", "next", "last", "position", "step_count", "gained"):
            setattr(self, name, getattr(self, name)[keep])

    def _draws_to_relive(self) -> Floats:
        """(BLOCK, dyna, 2, rows)"""
        shape = (BLOCK, self.settings.dyna, 2, N_ORBITS)
        return np.stack([rng.random(shape) for rng in self.rngs], axis=3).reshape(*shape[:3], N_ORBITS * len(self.rngs))

    def _relive(self, memory: Remembered, pair_u: Floats, outcome_u: Floats) -> None:
        """One remembered step of each row, learned from again."""
        live = (self.next < self.last) & (memory.pairs[self.row] > 0)
        pair, there = memory.recall(self.row, pair_u, outcome_u)
        position, action = pair // N_ACTIONS, pair % N_ACTIONS
        ends = (action == CONFIRM) & (self.mdp.wrong_confirm_ends | (position == 0))
        reward = self._reward(action, position, there)
        self._learn(self._address(position), position, action, there, reward, ends, live)
