"""Which cue the operator sees now: decision epochs around a policy, as one pure step."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ghal360_robot.guidance.belief import turned
from ghal360_robot.guidance.egocentric import TARGET, decode, egocentric, encode, nearest_targets, sticky_wedge
from ghal360_robot.guidance.mdp import ACTIONS
from ghal360_robot.guidance.policy import NOTHING, Advice, Policy
from ghal360_robot.guidance.rule import rule_action
from ghal360_robot.messages import Cue

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

EPOCH_S = 2.0
"""The paper's human acts once in 2 s; an unanswered cue is thought over again after as long."""
BORDER_MARGIN = math.radians(3)
"""A head at rest wanders by about this much; less would make cues flicker at wedge borders."""


@dataclass(frozen=True, slots=True)
class CueSettings:
    """How cues are timed; `seed` decides what a policy leaves to chance."""

    epoch_s: float = EPOCH_S
    border_margin: float = BORDER_MARGIN
    seed: int = 0


@dataclass(frozen=True, slots=True)
class CueState:
    """What is shown and since when. `epoch` counts decisions: one more means that this step decided."""

    head_wedge: int | None = None
    code: int = 0
    advice: Advice = NOTHING
    since_ns: int = 0
    epoch: int = 0

    @property
    def cue(self) -> Cue:
        return self.advice.cue

    @property
    def q(self) -> tuple[float, float, float] | None:
        """Values of left, right, confirm; None without a target or for a policy without values."""
        return self.advice.q

    @property
    def wedges(self) -> tuple[int, ...]:
        """The egocentric wedge values W_0..W_7 that were decided on."""
        return decode(self.code)


def step_cue(
    policy: Policy,
    settings: CueSettings,
    state: CueState,
    allocentric: Sequence[int],
    head_yaw: float,
    stamp_ns: int,
    belief: NDArray[np.float64] | None = None,
) -> CueState:
    """The cue for wedge values `allocentric` (eight, clockwise) and a head at `head_yaw` (rad, CCW).

    Both in the same frame, which may be the base's or the odometry's; so is `belief` (9,), the chance of each wedge
    to hold the target and that none does, for a policy that can act on it. A decision stands until the
    egocentric state changes or the epoch is over. Without a target in view nothing is shown, and
    "confirm" only while the target is in focus, whatever the policy says.
    Raises ValueError unless there are eight wedge values of 0..3 and the yaw is finite.
    """
    head_wedge = sticky_wedge(-head_yaw, state.head_wedge, settings.border_margin)
    code = encode(egocentric(allocentric, head_wedge))
    if nearest_targets(code) is None:
        return replace(state, head_wedge=head_wedge, code=code, advice=NOTHING, since_ns=stamp_ns)
    # Epoch 0 is before any decision; a code without target never stands as one.
    undecided = state.epoch == 0 or code != state.code
    if not undecided and stamp_ns - state.since_ns < settings.epoch_s * 1e9:
        return replace(state, head_wedge=head_wedge)
    epoch = state.epoch + 1
    from_head = None if belief is None else turned(belief, head_wedge)
    advice = _checked(policy.advise(code, uniform(settings.seed, epoch), from_head), code)
    return CueState(head_wedge=head_wedge, code=code, advice=advice, since_ns=stamp_ns, epoch=epoch)


def _checked(advice: Advice, code: int) -> Advice:
    """A half-learned policy may confirm a place without the target; the rule then shows the way there."""
    if advice.cue is Cue.CONFIRM and not code & TARGET:
        return replace(advice, cue=ACTIONS[rule_action(code)])
    return advice


def uniform(seed: int, n: int) -> float:
    """The n-th number in [0, 1) of a seed: splitmix64, so that a replayed decision needs no generator."""
    mask = (1 << 64) - 1
    z = (seed + n * 0x9E3779B97F4A7C15) & mask
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & mask
    z = (z ^ z >> 27) * 0x94D049BB133111EB & mask
    return ((z ^ z >> 31) >> 11) / (1 << 53)
