"""The optimal plan in closed form: turn to the side that shows less clutter on the way to the target.

Equal to the optimal policy in all 2,048 one-target states for every chance to follow of 0.5 or more.
"""

from __future__ import annotations

from ghal360_robot.guidance.egocentric import CLUTTER, N_WEDGES, decode, nearest_targets
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, RIGHT

CLEAR_COST, CLUTTER_COST = 3, 15
"""The paper's costs of a look; integers, so that equal sides compare equal."""


def rule_action(code: int) -> int:
    """LEFT, RIGHT or CONFIRM: the cheaper side, then the nearer, then the one that stays clean longer.

    Two sides equal in all three go right. With several targets the first one on each side counts.
    Raises ValueError where no target is in view: there is nothing to guide to.
    """
    nearest = nearest_targets(code)
    if nearest is None:
        raise ValueError("No target in view, so there is no direction to guide to.")
    steps_right, steps_left = nearest
    if steps_right == 0:
        return CONFIRM
    wedges = decode(code)
    to_the_right = [wedges[i] & CLUTTER for i in range(1, steps_right + 1)]
    to_the_left = [wedges[-i % N_WEDGES] & CLUTTER for i in range(1, steps_left + 1)]
    right = (_cost(to_the_right), steps_right, to_the_right)
    left = (_cost(to_the_left), steps_left, to_the_left)
    return RIGHT if right <= left else LEFT


def _cost(clutter: list[int]) -> int:
    return sum(CLUTTER_COST if cluttered else CLEAR_COST for cluttered in clutter)
