"""Where the target may be, from detections that miss and invent: Bayes over eight wedges and "not in view".

Detections of neighbouring pictures say nearly the same thing, so an update is tempered by the time since the last one;
and a detector that is mistaken about a thing is so in every picture from the same place, so all of those together count
little more than it takes to be sure. Guidance acts on the expectation of its values over the belief, and asks to
confirm only where it is nearly sure. Arrays may have any leading shape, so that thousands of searches share a call.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.egocentric import CLUTTER, N_WEDGES, TARGET, WEDGE_WIDTH, decode, wedge_of
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, N_CLUTTER, RIGHT
from ghal360_robot.guidance.planning import greedy

SURE = 0.97
"""Belief at which the operator may be asked to confirm: one wrong question in thirty at most."""
BORDER = math.radians(10)
"""Detections of a target this close to a border of wedges fall on either side of it."""
NOT_IN_VIEW = N_WEDGES
DIGITS = 9
"""After the point, of what goes into a recording: processors differ in the last digits of exp() and of sums."""
SAME_VIEW_M = 0.5
"""A detector that takes one thing for another does so again until it looks from elsewhere: a step, or a tenth of the
distance at which small things are known."""
BEYOND_SURE = 2.0
"""Log-odds. A single miss (1.6) after many hits takes no question back, two or three do."""
NO_FOR = 3.0
"""Log-odds taken from a wedge by a question without an answer: one of twenty who see the target does not say so."""
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

    @property
    def same_view(self) -> float:
        """Log-odds that all looks from one place together are worth: from nothing known to sure, and a little more."""
        each, nowhere, odds = self.prior_in_view / N_WEDGES, 1 - self.prior_in_view, self.sure / (1 - self.sure)
        # each x = odds (nowhere + others each / x): what speaks for one wedge speaks as much against all the others.
        half, others = odds * nowhere / each / 2, odds * (N_WEDGES - 1)
        return max(math.log(half + math.sqrt(half * half + others)), 0.0) + BEYOND_SURE


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

    NaN says nothing about a wedge: what hides it would keep the target from being reported, or the report is too weak.
    `dt_s` is the time since the last look; after `correlation_s` it counts as a whole look of its own.
    """
    return _weighed(belief, _log_odds(model, seen, dt_s))


def _log_odds(model: DetectorModel, seen: NDArray[np.floating | np.bool_], dt_s: float) -> NDArray[np.float64]:
    """(..., 8) by how much a look speaks for each wedge."""
    weight = min(max(dt_s, 0.0) / model.correlation_s, 1.0)
    hit = weight * math.log(model.hit_rate / model.false_rate)
    miss = weight * math.log((1 - model.hit_rate) / (1 - model.false_rate))
    log_odds: NDArray[np.float64] = np.nan_to_num(miss + (hit - miss) * seen)
    return log_odds


def _weighed(belief: NDArray[np.float64], log_odds: NDArray[np.float64]) -> NDArray[np.float64]:
    odds = np.exp(log_odds)
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
    view_at: tuple[float, float] = (0.0, 0.0)
    """Where the looks began that count as from one place."""
    view: tuple[float, ...] = (0.0,) * N_WEDGES
    """(8,) log-odds that these looks gave each wedge."""
    before: tuple[float, ...] = ()
    """(9,) what was believed before them, as far as it is not forgotten."""


def look(
    model: DetectorModel, belief: TargetBelief, seen: tuple[float, ...], at: tuple[float, float], stamp_ns: int
) -> TargetBelief:
    """The belief after a picture taken at `at` that reports the target as `seen` (8,), see `update`.

    A picture not newer than the last changes nothing. Looks from within `SAME_VIEW_M` together give no wedge more than
    `same_view`, for or against; those from elsewhere are forgotten in time.
    """
    if belief.chances is None or belief.look_ns is None:
        belief = TargetBelief(None, None, at, at, before=tuple(model.prior.tolist()))
        dt_s = model.correlation_s
    elif stamp_ns <= belief.look_ns:
        return belief
    else:
        dt_s = (stamp_ns - belief.look_ns) / 1e9
        if math.dist(at, belief.view_at) > SAME_VIEW_M:
            belief = replace(belief, view_at=at, view=(0.0,) * N_WEDGES, before=belief.chances)
    before = predict(model, np.array(belief.before), dt_s, math.dist(at, belief.at))
    view = np.clip(np.array(belief.view) + _log_odds(model, np.array(seen), dt_s), -model.same_view, model.same_view)
    return TargetBelief(
        _written(_weighed(before, view)), stamp_ns, at, belief.view_at, _written(view), _written(before)
    )


def refused(model: DetectorModel, belief: TargetBelief, bearing: float) -> TargetBelief:
    """The belief after an operator did not say "found" to a thing at this clockwise bearing of the world.

    Whatever spoke for its wedge was that thing, which is not the target; so it is worth less than an unseen one.
    """
    if belief.chances is None:
        return belief
    view, before = np.array(belief.view), np.array(belief.before)
    for wedge in {wedge_of(bearing - BORDER), wedge_of(bearing + BORDER)}:
        view[wedge] = -NO_FOR
        unfounded = max(before[wedge] - model.prior[wedge], 0.0)
        before[wedge] -= unfounded
        before[NOT_IN_VIEW] += unfounded
    return replace(belief, chances=_written(_weighed(before, view)), view=_written(view), before=_written(before))


def _written(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(np.round(values, DIGITS).tolist())


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
