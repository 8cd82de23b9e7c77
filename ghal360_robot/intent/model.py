"""How an operator who wants to go to a wedge moves the head: the observation model of the intent filters.

The paper gives the prediction step only; the observation model is ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ghal360_robot.guidance.egocentric import N_WEDGES, wedge_distance
from ghal360_robot.intent.head_motion import LEFT, RIGHT, STILL, Evidence

UNIFORM = (1 / N_WEDGES,) * N_WEDGES


@dataclass(frozen=True, slots=True)
class IntentModel:
    """The parameters; the defaults are tuned for a continuous head stream (2 Hz and faster)."""

    tau_int_s: float = 3.0
    """How long an intention lasts before it may be any other; caps the belief."""
    tau_c_s: float = 1.5
    """Looks closer in time than this say the same thing twice; updates are tempered by dt / tau_c."""
    eps: float = 0.1
    """Chance to turn away from the intended wedge."""
    p_still: float = 0.2
    """Chance to keep still while looking elsewhere."""
    p_h: float = 0.8
    """Chance to keep still while looking at the intended wedge."""
    lam: float = 1.0
    """How fast looking elsewhere gets unlikely with distance, per wedge; 0: no evidence from focus."""
    _likelihoods: dict[tuple[int, int], tuple[float, ...]] = field(
        init=False, repr=False, compare=False, default_factory=dict
    )
    """Of each wedge, by (delta, wedge in focus); filled once."""

    def __post_init__(self) -> None:
        if self.tau_int_s <= 0 or self.tau_c_s <= 0:
            raise ValueError("The time constants of the intent model must be positive.")
        if not (self.eps > 0 and 0 < self.p_still < 1 - self.eps and 0 < self.p_h < 1):
            raise ValueError("The chances of the intent model must leave every head motion possible.")
        for delta in (LEFT, STILL, RIGHT):
            for focus in range(N_WEDGES):
                self._likelihoods[delta, focus] = tuple(
                    self._turn(delta, (wedge - focus) % N_WEDGES) * math.exp(-self.lam * wedge_distance(focus, wedge))
                    for wedge in range(N_WEDGES)
                )

    def _turn(self, delta: int, offset: int) -> float:
        """P(delta | the intended wedge is `offset` wedges to the right of the head)."""
        if offset == 0:
            return self.p_h if delta == STILL else (1 - self.p_h) / 2
        if delta == STILL:
            return self.p_still
        if offset == N_WEDGES // 2:
            return (1 - self.p_still) / 2
        towards = RIGHT if offset < N_WEDGES // 2 else LEFT
        return 1 - self.p_still - self.eps if delta == towards else self.eps

    def predict(self, belief: tuple[float, ...], dt_s: float) -> tuple[float, ...]:
        """The belief after `dt_s` seconds without evidence: (1 - rho) B + rho / 8."""
        keep = math.exp(-dt_s / self.tau_int_s)
        return tuple(keep * b + (1 - keep) / N_WEDGES for b in belief)

    def likelihood(self, evidence: Evidence, dt_s: float) -> tuple[float, ...]:
        """(8,) likelihood of `dt_s` seconds of this evidence for each intended wedge, up to a factor.

        The head was partly in `origin` and partly in `focus`, so both count half (a geometric mean); that
        keeps slow head streams from being read as sure of where they happened to be sampled. However
        long, one piece of evidence never counts more than one independent look.
        """
        half = min(dt_s / self.tau_c_s, 1.0) / 2
        before = self._likelihoods[evidence.delta, evidence.origin]
        after = self._likelihoods[evidence.delta, evidence.focus]
        return tuple((p * q) ** half for p, q in zip(before, after, strict=True))


HUMAN_TICKS = IntentModel(tau_int_s=-2 / math.log(0.9), tau_c_s=2.0, p_still=0.1, p_h=0.9, lam=0.0)
"""For a simulated human who acts once in 2 s: rho = 0.1, each act an independent look.

Such a human chooses an act where they stand: give the wedge before the act as both `focus` and `origin`.
"""
