"""The exact value of a learner's greedy policy after every so many episodes.

Only the orbit of the last episode can have changed its greedy actions, so each change is noted with its
episode, each different (orbit, actions) is evaluated once, and the curve is the sum of the changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.guidance.orbits import N_ACTIONS, N_ORBITS, mirror_orbit, orbit_values

if TYPE_CHECKING:
    from ghal360_robot.guidance.mdp import AbstractMdp

HORIZON = 100
"""Actions in a test: a half-learned policy may turn for ever."""
SETS = 1 << N_ACTIONS
KEYS = SETS**N_WEDGES
"""Sets of best actions in eight positions, as one number."""
_PLACES = float(SETS) ** np.arange(N_WEDGES)


@dataclass(frozen=True, slots=True)
class Curve:
    """Value of the greedy policies, exact over the 2,048 starts; ties are played out evenly."""

    episodes: NDArray[np.int64]
    """(k,) when the policies were tested; the first is 0."""
    value: NDArray[np.float64]
    """(seeds, k)"""


class GreedyLog:
    """Notes the greedy actions of orbits as they change. `mirrored`: an orbit stands for its mirror image too."""

    def __init__(
        self,
        mdp: AbstractMdp,
        seeds: int,
        episodes: int,
        every: int,
        q: NDArray[np.float64],
        *,
        mirrored: bool,
    ) -> None:
        self._mdp, self._seeds, self._episodes, self._every = mdp, seeds, episodes, every
        self._first = greedy_keys(q.reshape(-1, N_WEDGES * N_ACTIONS))
        self._now = self._first.copy()
        self._weight = _orbit_weights() if mirrored else np.ones(N_ORBITS)
        self._changes: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]] = []

    def note(self, row: NDArray[np.int64], episode: NDArray[np.int64], q: NDArray[np.float64]) -> None:
        """After `episode` (n,), counted over all seeds, the values of `row` (n,) are `q` (n, 24)."""
        key = greedy_keys(q)
        changed = key != self._now[row]
        row, key = row[changed], key[changed]
        self._changes.append((row, episode[changed], self._now[row], key))
        self._now[row] = key

    def curve(self) -> Curve:
        """The value at 0, every, 2 * every ... episodes."""
        row, episode, before, after = (np.concatenate(part) for part in zip(*self._changes, strict=True))
        orbit = np.tile(np.arange(N_ORBITS), self._seeds)
        place = np.concatenate([orbit, row % N_ORBITS, row % N_ORBITS]) * KEYS
        value = self._values(place + np.concatenate([self._first, before, after]))
        n, k = len(orbit), len(row)
        first = np.average(value[:n].reshape(self._seeds, N_ORBITS), axis=1, weights=self._weight)
        delta = (value[n + k :] - value[n : n + k]) * self._weight[row % N_ORBITS] / self._weight.sum()
        tests = self._episodes // self._every
        test = np.minimum(episode % self._episodes // self._every, tests)
        seed = row // N_ORBITS
        gains = np.bincount(seed * (tests + 1) + test, delta, minlength=self._seeds * (tests + 1))
        rises = np.cumsum(gains.reshape(self._seeds, tests + 1)[:, :tests], axis=1)
        values = np.concatenate([first[:, None], first[:, None] + rises], axis=1)
        return Curve(np.arange(tests + 1) * self._every, values)

    def _values(self, asked: NDArray[np.int64]) -> NDArray[np.float64]:
        different, where = np.unique(asked, return_inverse=True)
        sets = different[:, None] % KEYS // SETS ** np.arange(N_WEDGES) % SETS
        chances = _CHANCES[sets]
        values: NDArray[np.float64] = orbit_values(self._mdp, different // KEYS, chances, HORIZON)[where]
        return values


def greedy_keys(q: NDArray[np.float64]) -> NDArray[np.int64]:
    """(n,) the sets of best actions of values (n, 24), as numbers."""
    # Columns instead of a maximum over three: numpy is slow along short axes.
    options = [q[:, action::N_ACTIONS] for action in range(N_ACTIONS)]
    best = np.maximum(np.maximum(options[0], options[1]), options[2])
    sets = np.zeros_like(best)
    for action, option in enumerate(options):
        sets += (option >= best) * float(1 << action)
    keys: NDArray[np.int64] = (sets @ _PLACES).astype(np.int64)
    return keys


def _orbit_weights() -> NDArray[np.float64]:
    """2 for the smaller of two mirror images, 0 for the other, 1 for an orbit that is its own."""
    orbit = np.arange(N_ORBITS)
    weights: NDArray[np.float64] = 1.0 + np.sign(mirror_orbit(orbit) - orbit)
    return weights


def _chances() -> NDArray[np.float64]:
    members = (np.arange(SETS)[:, None] >> np.arange(N_ACTIONS) & 1).astype(np.float64)
    chances: NDArray[np.float64] = members / np.maximum(members.sum(axis=1, keepdims=True), 1.0)
    return chances


_CHANCES = _chances()
"""(8, 3) chance of each action where a set of them is equally good."""
