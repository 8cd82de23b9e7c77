"""How reliably this operator follows the left and the right arrow: one Beta posterior each."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.guidance.mdp import LEFT, RIGHT

PRIOR = (9.0, 1.0)
"""Moved as told nine times of ten, seen ten times: the paper's operator, believed in lightly."""


@dataclass(frozen=True, slots=True)
class FollowRates:
    """Times that the head moved as the arrow said, and times that it did not."""

    left: tuple[float, float] = PRIOR
    right: tuple[float, float] = PRIOR

    def __post_init__(self) -> None:
        if not all(0 < count < float("inf") for count in (*self.left, *self.right)):
            raise ValueError("Counts of followed and ignored arrows must be positive numbers.")

    def observed(self, action: int, turn: int) -> FollowRates:
        """After an epoch in which LEFT or RIGHT was shown and the head turned `turn` wedges to the right."""
        turn = (turn + N_WEDGES // 2) % N_WEDGES - N_WEDGES // 2
        if action == LEFT:
            return replace(self, left=_counted(self.left, followed=turn < 0))
        if action == RIGHT:
            return replace(self, right=_counted(self.right, followed=turn > 0))
        raise ValueError("Only an arrow can be followed.")

    @property
    def p(self) -> tuple[float, float]:
        """The chance to follow the left and the right arrow, as `mdp.AbstractMdp.p` means it.

        Who does not follow turns either way at random, so a share m of moves as told means p = 2 m - 1.
        """
        return _p(self.left), _p(self.right)


def _counted(counts: tuple[float, float], *, followed: bool) -> tuple[float, float]:
    return (counts[0] + 1, counts[1]) if followed else (counts[0], counts[1] + 1)


def _p(counts: tuple[float, float]) -> float:
    return max(0.0, 2 * counts[0] / sum(counts) - 1)
