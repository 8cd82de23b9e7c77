"""The paper's intent filter: M particles, each a wedge the operator may want to go to (section III-C).

The wedges are discrete, so particles on the same one are interchangeable and the cloud is its eight counts:
the same distribution as moving, weighing and resampling 500 of them one by one. With systematic resampling
it is a noisy copy of `exact.ExactFilter`, which is why that is the default.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.intent.exact import IntentState
from ghal360_robot.intent.model import IntentModel
from ghal360_robot.intent.trigger import TriggerSettings, step_trigger

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.intent.head_motion import Evidence

PARTICLES = 500
"""With systematic resampling 200 would do at the default time constants; 500 also serves longer ones."""


@dataclass(frozen=True, slots=True)
class ParticleState(IntentState):
    """The cloud after resampling, as counts per wedge, and how many draws were made before."""

    counts: tuple[int, ...] = ()
    draws: int = 0


@dataclass(frozen=True, slots=True)
class ParticleFilter:
    """Like `ExactFilter`, with a seeded cloud; the belief is the weighted share of the particles on each wedge."""

    model: IntentModel = IntentModel()
    trigger: TriggerSettings = TriggerSettings()
    particles: int = PARTICLES
    seed: int = 0
    systematic: bool = True
    """Otherwise multinomial at every step, as a first attempt would have it: much noisier."""

    def __post_init__(self) -> None:
        if self.particles < N_WEDGES:
            raise ValueError(f"Fewer than {N_WEDGES} particles cannot stand for {N_WEDGES} wedges.")

    def step(self, state: IntentState, evidence: Evidence | None, dt_s: float) -> ParticleState:
        """The state `dt_s` seconds later. Raises ValueError for a negative or infinite time."""
        if not 0 <= dt_s < float("inf"):
            raise ValueError(f"Time goes forward by a finite step, not by {dt_s} s.")
        draws = state.draws if isinstance(state, ParticleState) else 0
        rng = np.random.default_rng([self.seed, draws])
        counts = self._spread(state)
        # The exact prediction of a belief in one wedge tells how many change their mind.
        change = self.model.predict((1.0, *(0.0,) * (N_WEDGES - 1)), dt_s)[1] * N_WEDGES
        movers = rng.binomial(counts, min(change, 1.0))
        counts = counts - movers + rng.multinomial(movers.sum(), [1 / N_WEDGES] * N_WEDGES)
        weights = counts / counts.sum()
        if evidence is not None:
            weights = weights * np.array(self.model.likelihood(evidence, dt_s))
            weights = weights / weights.sum()
        kept = systematic_counts(weights, self.particles, rng.random())
        if not self.systematic:
            kept = rng.multinomial(self.particles, weights)
        belief = tuple(weights.tolist())
        trigger = step_trigger(self.trigger, state.trigger, belief, dt_s)
        return ParticleState(belief, trigger, tuple(kept.tolist()), draws + 1)

    def intention(self, state: IntentState) -> int | None:
        """The world wedge that the operator wants to go to, or None: hold."""
        return state.trigger.intention

    def _spread(self, state: IntentState) -> NDArray[np.int64]:
        """The cloud as it is, or one for the state's belief."""
        if isinstance(state, ParticleState) and sum(state.counts) == self.particles:
            return np.array(state.counts)
        return systematic_counts(np.array(state.belief), self.particles, 0.5)


def systematic_counts(weights: NDArray[np.float64], particles: int, u: float) -> NDArray[np.int64]:
    """(k,) how many of `particles` evenly spaced places, the first at u / particles, fall on each weight.

    The last edge is exactly 1, whatever the rounding of the sum: no place can fall beyond it.
    """
    edges = np.cumsum(weights)
    edges[-1] = 1.0
    places = np.ceil(np.minimum(edges, 1.0) * particles - u).astype(np.int64)
    return np.diff(places, prepend=0)
