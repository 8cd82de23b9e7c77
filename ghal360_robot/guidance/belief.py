"""Where the target may be, from detections that miss and invent: Bayes over eight wedges and "not in view".

Detections of neighbouring pictures say nearly the same thing, so an update is tempered by the time since
the last one. Guidance acts on the expectation of its values over the belief, and asks to confirm only
where it is nearly sure. Arrays may have any leading shape, so that thousands of searches share a call.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.egocentric import CLUTTER, N_WEDGES, TARGET, WEDGE_WIDTH, decode
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, N_CLUTTER, RIGHT
from ghal360_robot.guidance.planning import greedy

SURE = 0.97
"""Belief at which the operator may be asked to confirm: one wrong question in thirty at most."""
BORDER = math.radians(10)
"""Detections of a target this close to a border of wedges fall on either side of it."""
NOT_IN_VIEW = N_WEDGES
DIGITS = 9
"""After the point, of what goes into a recording: processors differ in the last digits of exp() and of sums."""
WAIT = 3
"""Beside LEFT, RIGHT, CONFIRM: show nothing and look again."""


@dataclass(frozen=True, slots=True)
class DetectorModel:
    """How far a detector is to be trusted, and how quickly what it saw grows old."""

    hit_rate: float = 0.8
    """Chance that the target is reported in its wedge."""
    false_rate: float = 0.05
    """Chance that a wedge without it reports it."""
    correlation_s: float = 0.5
    """Looks closer in time say the same thing twice."""
    fade_s: float = 20.0
    """How long it takes until the target, or the robot, may be somewhere else altogether."""
    spread_per_m: float = 0.10
    """Share of a wedge's belief that goes to each neighbour for every metre driven."""
    prior_in_view: float = 0.5
    """Chance that the target is in view before anything was seen."""
    sure: float = SURE

    def __post_init__(self) -> None:
        if not 0 < self.false_rate < self.hit_rate < 1:
            raise ValueError("A detector has to report the target more often where it is than where it is not.")
        if not (self.correlation_s > 0 and self.fade_s > 0 and self.spread_per_m >= 0):
            raise ValueError("The times of a detector model must be positive, its spread not negative.")
        if not (0 < self.prior_in_view < 1 and 0 < self.sure < 1):
            raise ValueError("A prior, and the belief at which to ask, lie between 0 and 1.")

    @property
    def prior(self) -> NDArray[np.float64]:
        """(9,) belief before anything was seen."""
        each = self.prior_in_view / N_WEDGES
        return np.array([each] * N_WEDGES + [1 - self.prior_in_view])


def predict(
    model: DetectorModel, belief: NDArray[np.float64], dt_s: float, moved_m: float = 0.0
) -> NDArray[np.float64]:
    """(..., 9) the belief after `dt_s` seconds and `moved_m` metres without a look."""
    share = min(model.spread_per_m * max(moved_m, 0.0), 1 / 3)
    wedges = belief[..., :NOT_IN_VIEW]
    if share:
        wedges = (1 - 2 * share) * wedges + share * (np.roll(wedges, 1, axis=-1) + np.roll(wedges, -1, axis=-1))
    keep = math.exp(-max(dt_s, 0.0) / model.fade_s)
    later = np.concatenate([wedges, belief[..., NOT_IN_VIEW:]], axis=-1)
    return keep * later + (1 - keep) * model.prior


def update(
    model: DetectorModel, belief: NDArray[np.float64], seen: NDArray[np.floating | np.bool_], dt_s: float
) -> NDArray[np.float64]:
    """(..., 9) the belief after a look that reported the target in the wedges `seen` (..., 8).

    NaN says that the target would not be reported there anyhow, as something hides it. `dt_s` is the time since the
    last look; after `correlation_s` it counts as a whole look of its own.
    """
    weight = min(max(dt_s, 0.0) / model.correlation_s, 1.0)
    hit = weight * math.log(model.hit_rate / model.false_rate)
    miss = weight * math.log((1 - model.hit_rate) / (1 - model.false_rate))
    odds = np.exp(np.nan_to_num(miss + (hit - miss) * seen))
    weighed = np.concatenate([belief[..., :NOT_IN_VIEW] * odds, belief[..., NOT_IN_VIEW:]], axis=-1)
    after: NDArray[np.float64] = weighed / weighed.sum(axis=-1, keepdims=True)
    return after


def expected_values(
    q: NDArray[np.float64], belief: NDArray[np.float64], clutter: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(..., 3) the values of LEFT, RIGHT, CONFIRM expected over where target and clutter may be.

    `q` (2048, 3) is by `mdp.one_target_codes`; `belief` (..., 9) and `clutter` (..., 8), the chance that a
    wedge is cluttered, are egocentric. Given that the target is in view: else there is nothing to point at.
    """
    # Chance of each of the 256 sets of cluttered wedges, a wedge at a time: bit i of the index is wedge i.
    masks = np.ones((*clutter.shape[:-1], 1))
    for i in range(N_WEDGES):
        masks = np.concatenate([masks * (1 - clutter[..., i : i + 1]), masks * clutter[..., i : i + 1]], axis=-1)
    by_target = masks @ q.reshape(N_WEDGES, N_CLUTTER, 3).swapaxes(0, 1).reshape(N_CLUTTER, N_WEDGES * 3)
    wedges = belief[..., :NOT_IN_VIEW]
    wedges = wedges / np.maximum(wedges.sum(axis=-1, keepdims=True), 1e-300)
    values: NDArray[np.float64] = (wedges[..., None] * by_target.reshape(*clutter.shape, 3)).sum(axis=-2)
    return values


def choose(
    model: DetectorModel, q: NDArray[np.float64], belief: NDArray[np.float64], clutter: NDArray[np.float64]
) -> NDArray[np.int64]:
    """(...) LEFT, RIGHT, CONFIRM or WAIT for an egocentric belief (..., 9) and clutter chances (..., 8).

    CONFIRM where it is sure; WAIT while the target is most likely in focus but not surely, or not in view.
    """
    values = expected_values(q, belief, clutter)
    arrow = np.where(values[..., RIGHT] >= values[..., LEFT], RIGHT, LEFT)
    unsure = np.isin(belief.argmax(axis=-1), (0, NOT_IN_VIEW))
    return np.where(belief[..., 0] >= model.sure, CONFIRM, np.where(unsure, WAIT, arrow))


def likely_wedge(belief: NDArray[np.float64]) -> int | None:
    """The wedge that most likely holds the target; None where it is likelier not in view than in any one of them."""
    best = int(belief.argmax())
    return None if best == NOT_IN_VIEW else best


def act(q: NDArray[np.float64], belief: NDArray[np.float64], code: int) -> tuple[int, tuple[float, float, float]]:
    """LEFT, RIGHT or CONFIRM for an egocentric belief (9,), and what they are expected to be worth.

    `code` has the clutter, and the target where it is most likely. While that is in focus, what is best there counts:
    to look once more is free, so an arrow away from it is no answer to doubt (`DetectorModel.sure` is).
    """
    clutter = sum((value & CLUTTER) << i for i, value in enumerate(decode(code)))
    wedges = belief[:NOT_IN_VIEW]
    values = wedges @ q[clutter::N_CLUTTER] / max(float(wedges.sum()), 1e-300)
    left, right, confirm = np.round(values, DIGITS).tolist()
    if code & TARGET:
        action = int(greedy(q[clutter : clutter + 1])[0])
    else:
        action = int(greedy(np.array([[left, right, -np.inf]]))[0])
    return action, (left, right, confirm)


def turned(belief: NDArray[np.float64], head_wedge: int) -> NDArray[np.float64]:
    """(..., 9) a world's belief as seen from the head: wedge 0 is the one in focus."""
    return np.concatenate([np.roll(belief[..., :NOT_IN_VIEW], -head_wedge, axis=-1), belief[..., NOT_IN_VIEW:]], -1)


@dataclass(frozen=True, slots=True)
class TargetBelief:
    """In which wedge of the world the target is believed to be (clockwise from the odometry's x)."""

    chances: tuple[float, ...] | None = None
    """(9,) the eight wedges and "not in view"; None before the first look."""
    look_ns: int | None = None
    at: tuple[float, float] = (0.0, 0.0)
    """Where the robot was at the last look, metres in the odometry frame."""


def look(
    model: DetectorModel, belief: TargetBelief, seen: tuple[float, ...], at: tuple[float, float], stamp_ns: int
) -> TargetBelief:
    """The belief after a picture taken at `at` that reports the target as `seen` (8,), see `update`.

    A picture not newer than the last changes nothing.
    """
    if belief.look_ns is not None and stamp_ns <= belief.look_ns:
        return belief
    dt_s = model.correlation_s if belief.look_ns is None else (stamp_ns - belief.look_ns) / 1e9
    chances = model.prior if belief.chances is None else np.array(belief.chances)
    moved_m = math.dist(at, belief.at) if belief.chances is not None else 0.0
    after = update(model, predict(model, chances, dt_s, moved_m), np.array(seen), dt_s)
    return TargetBelief(tuple(np.round(after, DIGITS).tolist()), stamp_ns, at)


def in_focus(belief: TargetBelief, head_wedge: int, bearing: float | None) -> float:
    """The chance that the target is where the operator looks: in wedge `head_wedge` of the world.

    A target near the border, at this clockwise bearing, is reported now on one side and now on the other; then the
    wedge beyond that border counts too.
    """
    if belief.chances is None:
        return 0.0
    chance = belief.chances[head_wedge]
    if bearing is not None:
        off = math.remainder(bearing - head_wedge * WEDGE_WIDTH, math.tau)
        if abs(abs(off) - WEDGE_WIDTH / 2) <= BORDER:
            chance += belief.chances[(head_wedge + (1 if off > 0 else -1)) % N_WEDGES]
    return min(chance, 1.0)
