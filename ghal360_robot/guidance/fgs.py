"""Fixed guidance strategy (FGS), the paper's baseline: always the shorter way to the target."""

from __future__ import annotations

from enum import Enum

from ghal360_robot.guidance.egocentric import CLUTTER, N_WEDGES, decode, nearest_targets
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, RIGHT


class Tie(Enum):
    """Where to turn when the target is exactly behind."""

    RANDOM = "random"
    """Either side, drawn anew each time (the reading taken as the paper's)."""
    RIGHT = "right"
    CLUTTER = "clutter"
    """The side with fewer cluttered wedges, right if equal; everywhere else still the shorter way."""


def fgs_choices(code: int, tie: Tie = Tie.RANDOM) -> tuple[int, ...]:
    """The actions FGS picks evenly among: one, or both turns on a random tie.

    Raises ValueError where no target is in view.
    """
    nearest = nearest_targets(code)
    if nearest is None:
        raise ValueError("No target in view, so there is no direction to guide to.")
    steps_right, steps_left = nearest
    if steps_right == 0:
        return (CONFIRM,)
    if steps_right != steps_left:
        return (RIGHT,) if steps_right < steps_left else (LEFT,)
    match tie:
        case Tie.RANDOM:
            return (LEFT, RIGHT)
        case Tie.RIGHT:
            return (RIGHT,)
        case Tie.CLUTTER:
            return (_cleaner_side(code, steps_right),)


def fgs_action(code: int, tie: Tie, u: float) -> int:
    """One of `fgs_choices`; `u` is the caller's uniform draw from [0, 1), used only on a random tie."""
    choices = fgs_choices(code, tie)
    return choices[int(u * len(choices))]


def _cleaner_side(code: int, steps: int) -> int:
    clutter = [value & CLUTTER for value in decode(code)]
    return RIGHT if sum(clutter[1:steps]) <= sum(clutter[N_WEDGES + 1 - steps :]) else LEFT
