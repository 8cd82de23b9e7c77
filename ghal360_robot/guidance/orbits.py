"""The 2,048 one-target states as 256 orbits of eight: a head turn never leaves its orbit.

An orbit is the clutter as seen from the target (bit j: the j-th wedge clockwise of it), a position the
target's offset from the gaze, 0..7. Orbits share nothing, so that they can be learned and evaluated side
by side: an episode, however long, touches one of them only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, N_CLUTTER, N_ONE_TARGET, RIGHT, RewardOn

if TYPE_CHECKING:
    from ghal360_robot.guidance.mdp import AbstractMdp

N_ORBITS = N_CLUTTER
N_ACTIONS = 3
ROW = N_WEDGES * N_ACTIONS
"""Values of one orbit."""
CHUNK = 1024
"""Policies evaluated at once: their values stay in the cache."""


def orbit_of(index: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Orbit and position of indices into `mdp.one_target_codes`."""
    position, clutter = index // N_CLUTTER, index % N_CLUTTER
    return _rotate_byte(clutter, position), position


def index_of(orbit: NDArray[np.int64], position: NDArray[np.int64]) -> NDArray[np.int64]:
    """The index into `mdp.one_target_codes`."""
    index: NDArray[np.int64] = position * N_CLUTTER + _rotate_byte(orbit, -position % N_WEDGES)
    return index


def mirror_orbit(orbit: NDArray[np.int64]) -> NDArray[np.int64]:
    """The orbit with left and right exchanged; position p becomes -p."""
    mirrored = orbit & 1
    for j in range(1, N_WEDGES):
        mirrored = mirrored | (orbit >> j & 1) << N_WEDGES - j
    return mirrored


def look_costs(mdp: AbstractMdp) -> NDArray[np.float64]:
    """(256, 8) what a look at the focused wedge costs in each orbit and position."""
    orbit = np.arange(N_ORBITS)[:, None]
    focus = -np.arange(N_WEDGES) % N_WEDGES
    return np.where(orbit >> focus & 1, mdp.clutter_cost, mdp.clear_cost)


def by_orbit(table: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2048, 3) values as (256, 8, 3)."""
    orbit, position = np.meshgrid(np.arange(N_ORBITS), np.arange(N_WEDGES), indexing="ij")
    return table[index_of(orbit, position)]


def by_index(orbits: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 256, 8, 3) values as (..., 2048, 3)."""
    orbit, position = orbit_of(np.arange(N_ONE_TARGET))
    return orbits[..., orbit, position, :]


def orbit_values(
    mdp: AbstractMdp, orbit: NDArray[np.int64], policy: NDArray[np.float64], horizon: int
) -> NDArray[np.float64]:
    """(n,) mean return over the eight positions of `policy` (n, 8, 3), chances of actions, in `orbit` (n,).

    Exact for at most `horizon` actions, undiscounted: `planning.evaluate` for one orbit at a time.
    """
    values = np.empty(len(orbit))
    costs = look_costs(mdp)
    turns = mdp.turns()
    used = np.flatnonzero(turns.any(axis=0))
    for begin in range(0, len(orbit), CHUNK):
        chunk = slice(begin, begin + CHUNK)
        # Positions first: each step below is then a few long vectors.
        chances = np.ascontiguousarray(policy[chunk].transpose(2, 1, 0))
        gain, moves, stay = _steps(mdp, costs[orbit[chunk]].T, chances, turns[:, used], used)
        # The values twice over: any rotation of the positions is then a slice.
        v, part = np.zeros((2 * N_WEDGES, gain.shape[1])), np.empty_like(gain)
        for _ in range(horizon):
            better = gain + stay * v[:N_WEDGES]
            for move, k in zip(moves, used.tolist(), strict=True):
                better += np.multiply(move, v[N_WEDGES - k : 2 * N_WEDGES - k], out=part)
            v[:N_WEDGES] = v[N_WEDGES:] = better
        values[chunk] = v[:N_WEDGES].mean(axis=0)
    return values


def _steps(
    mdp: AbstractMdp,
    cost: NDArray[np.float64],
    chances: NDArray[np.float64],
    turns: NDArray[np.float64],
    used: NDArray[np.intp],
) -> tuple[NDArray[np.float64], list[NDArray[np.float64]], NDArray[np.float64]]:
    """Expected reward (8, n), chance of each turn (8, n) and of staying after a confirmation (8, n)."""
    moves = [chances[LEFT] * turns[LEFT, i] + chances[RIGHT] * turns[RIGHT, i] for i in range(len(used))]
    looked = chances[LEFT] + chances[RIGHT]
    if mdp.reward_on is RewardOn.ARRIVAL:
        gain = -sum(move * np.roll(cost, k, axis=0) for move, k in zip(moves, used, strict=True))
    else:
        gain = -looked * cost
    confirmed = np.full(N_WEDGES, -mdp.wrong_confirm_cost)
    confirmed[0] = mdp.confirm_reward
    gain = gain + chances[CONFIRM] * confirmed[:, None]
    stay = np.zeros_like(gain) if mdp.wrong_confirm_ends else chances[CONFIRM].copy()
    stay[0] = 0.0
    return gain, moves, stay


def _rotate_byte(clutter: NDArray[np.int64], by: NDArray[np.int64]) -> NDArray[np.int64]:
    """Eight bits rotated towards bit 0."""
    rotated: NDArray[np.int64] = (clutter >> by | clutter << N_WEDGES - by) & (N_CLUTTER - 1)
    return rotated
