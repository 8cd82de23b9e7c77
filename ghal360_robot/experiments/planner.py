"""The sixth system: guidance also while the target is not in view, by a search planner with a known map.

The planner keeps the chance of every spot to hold the target, from detections that miss and invent
(`guidance.belief` gives the detector's rates; on a map the same Bayes needs no blurring). While the target
is probably in view, guidance is as ever, on the expected values, with a question only where it is nearly
sure. Otherwise the arrow shows the way to the next best view: most chance seen for the least way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.experiments.ground import UNSEEN, Goal, Ground
from ghal360_robot.experiments.search import (
    BACK,
    F1,
    FORWARD,
    LOOK_LEFT,
    LOOK_RIGHT,
    NOT_FOUND,
    TICK_S,
    TURN,
    Options,
    Trials,
    likelihoods,
)
from ghal360_robot.guidance.belief import WAIT, DetectorModel, choose
from ghal360_robot.guidance.egocentric import N_WEDGES, wedge_of
from ghal360_robot.guidance.mdp import CONFIRM, LEFT, RIGHT, AbstractMdp, one_target_codes
from ghal360_robot.guidance.planning import value_iteration
from ghal360_robot.intent.model import UNIFORM

PERFECT = DetectorModel(hit_rate=1 - 1e-6, false_rate=1e-6)
"""Sees what is there and nothing else."""
NEAR_M = 2.0
"""Added to every way: a view close by is not worth everything."""
LOYALTY = 1.2
"""A new view has to be better by a fifth, or the human is sent to and fro."""
GUIDE_AT = 0.5
"""Chance of one wedge from which on the way to the target is shown instead of the way to a view."""
MOST_VIEWS = 700
"""Places considered as views, evenly out of all: keeps a decision for a thousand trials below 0.1 s."""
WRONG = -1.0
"""In place of a time: the human was asked to confirm what is not there, and the search is over."""
PATIENCE_LOOKS = 8
"""Looks from the same place, 16 s, after which a view counts as out of reach; turns and intent take 10 s."""
AHEAD = 3
"""Beside LEFT, RIGHT, CONFIRM: keep looking there and go."""

TURN_RATE_DEG, REACTION_S = 60.0, 0.3
CONTINUOUS_WEDGES = int(TURN_RATE_DEG * (TICK_S - REACTION_S) / 45)
"""How far a head follows a continuous arrow in one act; an arrow of eight wedges asks for one at a time."""


@dataclass(frozen=True, slots=True)
class PlannerOptions:
    """What is switched on beside the planner itself."""

    detector: DetectorModel = DetectorModel()
    """One independent look per act, although several pictures are taken."""
    inhibit: bool = True
    continuous: bool = True


BEYOND = PlannerOptions()


def plan_searches(
    ground: Ground,
    goal: Goal,
    trials: Trials,
    options: Options = F1,
    planner: PlannerOptions = BEYOND,
    seed: int = 0,
) -> NDArray[np.float64]:
    """(m,) seconds until the target was found; NOT_FOUND where it was not, WRONG where something else was."""
    return _Planned(ground, goal, trials, options, planner, seed).run()


class _Planned:
    """All trials of the sixth system on one target; those that ended are dropped."""

    def __init__(
        self, ground: Ground, goal: Goal, trials: Trials, options: Options, planner: PlannerOptions, seed: int
    ) -> None:
        self.ground, self.goal, self.options, self.planner, self.luck = ground, goal, options, planner, trials.luck
        self.wedge, self.clutter = goal.wedge, goal.clutter.astype(np.int64)
        self.view = goal.in_view(math.radians(options.fov_deg)).astype(np.int64)
        self.spots = ground.spot_wedge
        self.views = np.arange(0, len(ground.xy), 1 + len(ground.xy) // MOST_VIEWS)
        self.seen_from = np.ascontiguousarray((self.spots[self.views] != UNSEEN).T.astype(np.float32))
        self.values = value_iteration(AbstractMdp().over(one_target_codes())).q
        self.rng = np.random.default_rng([seed, 6])
        self.trial = np.arange(len(trials.place))
        self.place, self.head = trials.place.copy(), trials.head.copy()
        spots = self.spots.shape[1]
        self.chance = np.full((len(self.trial), spots), 1 / spots, np.float32)
        self.aim = np.full(len(self.trial), -1)
        self.belief = np.tile(np.array(UNIFORM, np.float32), (len(self.trial), 1))
        self.likelihoods = likelihoods(options.intent)
        self.found = np.full(len(self.trial), NOT_FOUND)

    def run(self) -> NDArray[np.float64]:
        for tick in range(len(self.luck)):
            if not len(self.trial):
                break
            luck = self.luck[tick][:, self.trial]
            in_wedge = self._look()
            cue = self._cue(in_wedge)
            going = self._end(tick * TICK_S, luck[0], cue == CONFIRM)
            self._drop(going)
            self._act(luck[:, going], cue[going])
        return self.found

    def _look(self) -> NDArray[np.float64]:
        """(m, 9) chance of each of the world's wedges, and of none, after one more look."""
        detector = self.planner.detector
        truth = self.wedge[self.place, None] == np.arange(N_WEDGES)
        rate = np.where(truth, detector.hit_rate, detector.false_rate)
        seen = self.rng.random(rate.shape) < rate
        hit = detector.hit_rate / detector.false_rate
        miss = (1 - detector.hit_rate) / (1 - detector.false_rate)
        odds = np.ones((len(seen), N_WEDGES + 1), np.float32)
        odds[:, :N_WEDGES] = np.where(seen, hit, miss)
        where = self.spots[self.place]
        self.chance *= np.take_along_axis(odds, where, axis=1)
        self.chance /= self.chance.sum(axis=1, keepdims=True)
        flat = np.arange(len(where))[:, None] * (N_WEDGES + 1) + where
        sums = np.bincount(flat.ravel(), self.chance.ravel(), minlength=odds.size)
        return np.asarray(sums.reshape(odds.shape), dtype=np.float64)

    def _cue(self, in_wedge: NDArray[np.float64]) -> NDArray[np.int64]:
        """LEFT, RIGHT, CONFIRM or AHEAD; `self.toward` is the wedge that an arrow points to."""
        self.toward = self._next_wedge()
        likely = in_wedge[:, :N_WEDGES].max(axis=1) >= GUIDE_AT
        offset = (self.toward - self.head) & (N_WEDGES - 1)
        cue = np.where(offset == 0, AHEAD, np.where(offset <= N_WEDGES // 2, RIGHT, LEFT))
        if likely.any():
            turned = (np.arange(N_WEDGES) + self.head[likely, None]) & (N_WEDGES - 1)
            egocentric = np.column_stack(
                (np.take_along_axis(in_wedge[likely], turned, axis=1), in_wedge[likely, N_WEDGES])
            )
            clutter = (self.clutter[self.place[likely], None] >> turned & 1).astype(np.float64)
            chosen = choose(self.planner.detector, self.values, egocentric, clutter)
            cue[likely] = np.where(chosen == WAIT, AHEAD, chosen)
            self.toward[likely] = in_wedge[likely, :N_WEDGES].argmax(axis=1)
        return cue

    def _next_wedge(self) -> NDArray[np.int64]:
        """(m,) the wedge of the first step towards the next best view."""
        ground = self.ground
        worth = self.chance @ self.seen_from
        way = ground.path_m[self.place[:, None], self.views]
        score = worth / (way + NEAR_M)
        rows = np.arange(len(score))
        kept = np.where(self.aim >= 0, score[rows, self.aim], 0.0)
        best = score.argmax(axis=1)
        self.aim = np.where((self.aim >= 0) & (score[rows, best] <= LOYALTY * kept), self.aim, best)
        steps = ground.moves[self.place]
        rest = ground.path_m[steps, self.views[self.aim][:, None]]
        rest = np.where(steps == self.place[:, None], np.inf, rest)
        return np.asarray(rest.argmin(axis=1), dtype=np.int64)

    def _end(self, clock: float, luck: NDArray[np.float32], asked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Note what was found, rightly or wrongly; (m,) which trials go on."""
        options = self.options
        in_view = (self.view[self.place] >> self.head & 1).astype(bool)
        cluttered = (self.clutter[self.place] >> self.head & 1).astype(bool)
        chance = np.where(cluttered, options.notice_cluttered, options.notice_clear)
        chance = np.where(asked, np.maximum(chance, options.notice_confirmed), chance)
        noticed = in_view & (luck < chance)
        wrong = asked & ~in_view
        self.found[self.trial[noticed]] = clock
        self.found[self.trial[wrong]] = WRONG
        goes_on: NDArray[np.bool_] = ~(noticed | wrong)
        return goes_on

    def _act(self, luck: NDArray[np.float32], cue: NDArray[np.int64]) -> None:
        """The human follows the cue or does anything; the robot goes where they are believed to want to."""
        options = self.options
        focus = self.head
        offset = (self.toward - focus) & (N_WEDGES - 1)
        away = np.minimum(offset, N_WEDGES - offset)
        reach = np.minimum(away, CONTINUOUS_WEDGES) if self.planner.continuous else np.minimum(away, 1)
        anything = (luck[2] * 4).astype(np.int64)
        told = np.select([cue == LEFT, cue == RIGHT], [LOOK_LEFT, LOOK_RIGHT], FORWARD)
        obeys = luck[1] < options.follow
        act = np.where(obeys, told, anything)
        side = TURN[act]
        self.head = (focus + side * np.where(obeys, np.maximum(reach, 1), 1)) & (N_WEDGES - 1)
        belief = (1 - options.rho) * self.belief + np.float32(options.rho / N_WEDGES)
        belief *= self.likelihoods[side + 1, focus]
        belief /= belief.sum(axis=1, keepdims=True)
        self.belief = belief
        wanted = belief.argmax(axis=1)
        goes = belief[np.arange(len(wanted)), wanted] >= options.threshold
        if self.planner.inhibit:
            goes &= (cue != LEFT) & (cue != RIGHT)
        # Hands off: forward and back of a human who does anything are looks, not commands.
        goes &= act != BACK
        self.place = np.where(goes, self.ground.moves[self.place, wanted], self.place)

    def _drop(self, keep: NDArray[np.bool_]) -> None:
        if keep.all():
            return
        for name in ("trial", "place", "head", "chance", "aim", "belief", "toward"):
            setattr(self, name, getattr(self, name)[keep])


class NextView:
    """The same planner for one search whose robot moves by itself: where it is and what it saw go in, a way out."""

    def __init__(self, ground: Ground, detector: DetectorModel) -> None:
        self._ground, self._detector = ground, detector
        self._spots = ground.spot_wedge
        self._views = np.arange(0, len(ground.xy), 1 + len(ground.xy) // MOST_VIEWS)
        self._seen_from = (self._spots[self._views] != UNSEEN).astype(np.float64)
        self._chance = np.full(self._spots.shape[1], 1 / self._spots.shape[1])
        self._aim = -1
        self._barred = np.zeros(len(self._views), bool)
        self._waited = (-1, 0)
        """The place of the last looks, and how many there were from it."""
        self._counted = np.ones(N_WEDGES + 1)
        """By how much they spoke for each wedge."""

    def look(self, place: int, bearings: list[float]) -> int | None:
        """One look from `place` that showed the target at these clockwise bearings (mostly none).

        The next place on the way to the next best view, or None where no way leads on.
        """
        ground = self._ground
        self._weigh(place, bearings)
        way = ground.path_m[place, self._views]
        self._wait(place)
        score = np.where(self._barred, 0.0, self._seen_from @ self._chance / (way + NEAR_M))
        best = int(score.argmax())
        if (
            self._aim < 0
            or self._barred[self._aim]
            or self._views[self._aim] == place
            or score[best] > LOYALTY * score[self._aim]
        ):
            self._aim = best
        steps = ground.moves[place]
        rest = np.where(steps == place, np.inf, ground.path_m[steps, self._views[self._aim]])
        step = int(steps[rest.argmin()])
        return step if np.isfinite(rest.min()) else None

    def _weigh(self, place: int, bearings: list[float]) -> None:
        """All looks from one place count as one: a detector that takes a thing for the target does so in each."""
        detector, hit = self._detector, self._detector.hit_rate / self._detector.false_rate
        before = self._counted if place == self._waited[0] else np.ones(N_WEDGES + 1)
        odds = np.where(before > 1.0, hit, (1 - detector.hit_rate) / (1 - detector.false_rate))
        odds[[wedge_of(bearing) for bearing in bearings]] = hit
        odds[UNSEEN] = 1.0
        self._chance *= (odds / before)[self._spots[place]]
        self._chance /= self._chance.sum()
        self._counted = odds

    def _wait(self, place: int) -> None:
        """A robot that does not get on cannot get there: another view is aimed at."""
        looks = self._waited[1] + 1 if place == self._waited[0] else 0
        if looks >= PATIENCE_LOOKS and self._aim >= 0:
            self._barred[self._aim] = True
            looks = 0
        if self._barred.all():
            self._barred[:] = False
        self._waited = (place, looks)
