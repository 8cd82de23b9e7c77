"""The paper's target search for thousands of trials at once (configuration F1 and its options).

Once in two seconds: look, end if the target is noticed, show a cue, the human acts, the intent is
estimated, the robot moves. All systems share the same starts, headings and uniform draws, so that they
are compared trial by trial. What the paper leaves open is an option here and explained in
docs/REPRODUCTION.md; `F1` is the reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.experiments.ground import DISTANCES_M, UNSEEN, Goal, Ground
from ghal360_robot.guidance.egocentric import N_WEDGES
from ghal360_robot.guidance.fgs import Tie, fgs_action
from ghal360_robot.guidance.mdp import CONFIRM, N_CLUTTER, RIGHT, one_target_codes
from ghal360_robot.guidance.rule import rule_action
from ghal360_robot.intent.head_motion import Evidence
from ghal360_robot.intent.model import UNIFORM, IntentModel

if TYPE_CHECKING:
    from collections.abc import Sequence

TICK_S = 2.0
"""One act of the human (paper)."""
DRAWS = 4
"""Uniform numbers per tick and trial: notice, follow, act, tie."""
NOT_FOUND = math.inf


class Guidance(Enum):
    """Who chooses the arrows."""

    NONE = "none"
    FGS = "fgs"
    LEARNED = "learned"
    """The learned policy's limit, which is the optimal plan; or the values given to `search`."""


@dataclass(frozen=True, slots=True)
class System:
    """What distinguishes the systems of the paper."""

    name: str
    guidance: Guidance = Guidance.NONE
    confirm: bool = False
    """Whether it asks the human to confirm what is in focus."""
    intent: bool = False
    """Whether the robot drives to where the human is believed to want to go."""
    panorama: bool = True
    """Otherwise a camera that looks ahead only: to look aside, the base turns."""


MFO = System("MFO", panorama=False)
ADV = System("ADV")
FGS = System("FGS", Guidance.FGS)
RLGS = System("RLGS", Guidance.LEARNED, confirm=True)
GHAL360 = System("GHAL360", Guidance.LEARNED, confirm=True, intent=True)
SYSTEMS = (MFO, ADV, FGS, RLGS, GHAL360)


@dataclass(frozen=True, slots=True)
class Options:
    """Configuration F1 by default; every number the paper does not give is one of these."""

    limit_s: float = 330.0
    step_m: float = 1.5
    range_m: float = 6.0
    """The detector and the human know a thing for what it is up to here."""
    fov_deg: float = 60.0
    mfo_fov_deg: float | None = None
    """Another field of view for the camera that looks ahead only."""
    follow: float = 0.95
    notice_clear: float = 0.3
    """Chance per act that a target in view is noticed."""
    notice_cluttered: float = 0.1
    """The same where the wedge in focus is cluttered."""
    notice_confirmed: float = 1.0
    """The same when the human was asked to confirm."""
    dwell_s: float = TICK_S
    """Time that an act takes while a cluttered wedge is in focus."""
    adv_along_base: bool = False
    """ADV drives along the direction it started in, instead of along the view."""
    hold: bool = False
    """GHAL360 stands still while unsure, instead of doing the human's forward and back."""
    inhibit: bool = False
    """GHAL360 does not drive while an arrow is shown."""
    literal: bool = False
    """Forward and back are drawn with probability 1/2 also while an arrow is shown."""
    threshold: float = 0.7
    rho: float = 0.1
    """Chance that an intention changes between two acts."""
    eps: float = 0.1

    def __post_init__(self) -> None:
        chances = (self.follow, self.notice_clear, self.notice_cluttered, self.notice_confirmed, self.rho)
        if not all(0 <= chance <= 1 for chance in chances):
            raise ValueError("Chances lie between 0 and 1.")
        if min(self.limit_s, self.step_m, self.range_m, self.fov_deg, self.dwell_s) <= 0:
            raise ValueError("Times, lengths and the field of view must be positive.")

    @property
    def intent(self) -> IntentModel:
        """The intent filter for acts two seconds apart."""
        tau_s = -TICK_S / math.log(1 - self.rho)
        return IntentModel(tau_int_s=tau_s, tau_c_s=TICK_S, eps=self.eps, p_still=0.1, p_h=0.9, lam=0.0)


F1 = Options()
NO_HANDICAP = Options(notice_clear=1.0, notice_cluttered=1.0)
NOBODY_CONFIRMS = Options(notice_confirmed=0.3)
DWELL = Options(dwell_s=10.0, notice_clear=1.0, notice_cluttered=1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Trials:
    """What all systems share: where the trials start, and their luck."""

    place: NDArray[np.int64]
    """(m,)"""
    head: NDArray[np.int64]
    """(m,)"""
    distance: NDArray[np.int64]
    """(m,) index into DISTANCES_M."""
    run: NDArray[np.int64]
    """(m,) which of the repeated runs a trial belongs to."""
    luck: NDArray[np.float32]
    """(ticks, DRAWS, m) uniform draws."""


def draw_trials(
    ground: Ground, goal: Goal, runs: Sequence[int], per_run: int, ticks: int, stream: Sequence[int] = ()
) -> Trials:
    """`per_run` trials per run and distance; a distance without a place to start from has none.

    The same run and `stream` give the same trials whatever else is drawn.
    """
    parts = []
    for run in runs:
        for d, distance_m in enumerate(DISTANCES_M):
            starts = ground.starts(goal, distance_m)
            if not starts.size:
                continue
            rng = np.random.default_rng([run, d, *stream])
            parts.append(
                Trials(
                    place=starts[rng.integers(len(starts), size=per_run)],
                    head=rng.integers(N_WEDGES, size=per_run),
                    distance=np.full(per_run, d),
                    run=np.full(per_run, run),
                    luck=rng.random((ticks, DRAWS, per_run), dtype=np.float32),
                )
            )
    if not parts:
        raise ValueError(f"{ground.name}: no place is {DISTANCES_M} m from the {goal.name} and leads to it")
    return Trials(
        np.concatenate([part.place for part in parts]),
        np.concatenate([part.head for part in parts]),
        np.concatenate([part.distance for part in parts]),
        np.concatenate([part.run for part in parts]),
        np.concatenate([part.luck for part in parts], axis=2),
    )


def most_ticks(options: Options) -> int:
    """Acts that fit into the time limit."""
    return math.ceil(options.limit_s / TICK_S)


def search(
    ground: Ground,
    goal: Goal,
    system: System,
    options: Options,
    trials: Trials,
    actions: NDArray[np.int64] | None = None,
) -> NDArray[np.float64]:
    """(m,) seconds until the target was noticed, NOT_FOUND where it was not within the limit.

    `actions` (8, 256): for the target's offset and the clutter mask, the action of a learned policy in
    place of the optimal one.
    """
    return _Search(ground, goal, system, options, trials, actions).run()


def action_table(q: NDArray[np.float64]) -> NDArray[np.int64]:
    """(8, 256) the greedy actions of values (2048, 3); a confirmation elsewhere than at the target is no arrow."""
    table: NDArray[np.int64] = q.argmax(axis=1).reshape(N_WEDGES, N_CLUTTER)
    return table


@cache
def _arrows(guidance: Guidance) -> NDArray[np.int64]:
    """(2, 8, 256) the action for a tie-breaking draw below or above one half."""
    codes = one_target_codes().tolist()
    if guidance is Guidance.FGS:
        both = [[fgs_action(code, Tie.RANDOM, u) for code in codes] for u in (0.0, 0.5)]
    else:
        both = [[rule_action(code) for code in codes]] * 2
    return np.array(both).reshape(2, N_WEDGES, N_CLUTTER)


def likelihoods(model: IntentModel) -> NDArray[np.float32]:
    """(3, 8, 8) by head motion (left, still, right), wedge in focus and intended wedge."""
    rows = [
        [model.likelihood(Evidence(delta, focus, focus), TICK_S) for focus in range(N_WEDGES)] for delta in (-1, 0, 1)
    ]
    return np.array(rows, np.float32)


FORWARD, BACK, LOOK_LEFT, LOOK_RIGHT = range(4)
TURN = np.array([0, 0, -1, 1])
"""Wedges to the right of each act."""


class _Search:
    """All trials of one system on one target; those that ended are dropped."""

    def __init__(
        self,
        ground: Ground,
        goal: Goal,
        system: System,
        options: Options,
        trials: Trials,
        actions: NDArray[np.int64] | None,
    ) -> None:
        self.system, self.options, self.luck = system, options, trials.luck
        self.moves, self.wedge, self.clutter = ground.moves, goal.wedge, goal.clutter.astype(np.int64)
        fov = options.fov_deg if system.panorama else options.mfo_fov_deg or options.fov_deg
        self.view = goal.in_view(math.radians(fov)).astype(np.int64)
        arrows = _arrows(system.guidance) if system.guidance is not Guidance.NONE else None
        if actions is not None and system.guidance is Guidance.LEARNED:
            arrows = np.stack([actions, actions])
        self.arrows = arrows
        self.trial = np.arange(len(trials.place))
        self.place, self.head = trials.place.copy(), trials.head.copy()
        self.base = trials.head.copy()
        self.clock = np.zeros(len(self.trial))
        self.belief = np.tile(np.array(UNIFORM, np.float32), (len(self.trial), 1)) if system.intent else None
        self.likelihoods = likelihoods(options.intent) if system.intent else np.empty(0)
        self.found = np.full(len(self.trial), NOT_FOUND)

    def run(self) -> NDArray[np.float64]:
        for tick in range(len(self.luck)):
            if not len(self.trial):
                break
            self._tick(self.luck[tick][:, self.trial])
        return self.found

    def _tick(self, luck: NDArray[np.float32]) -> None:
        options = self.options
        seen_at = self.wedge[self.place]
        masks = self.clutter[self.place]
        cluttered = (masks >> self.head & 1).astype(bool)
        offset = (seen_at - self.head) & (N_WEDGES - 1)
        seen = seen_at != UNSEEN
        asked = seen & (offset == 0) if self.system.confirm else np.zeros(len(seen), bool)
        self._notice(luck[0], cluttered, asked)
        going = np.isinf(self.found[self.trial])
        self.clock += np.where(cluttered, options.dwell_s, TICK_S)
        going &= self.clock < options.limit_s
        if not going.all():
            self._drop(going)
            luck, masks, offset, seen = luck[:, going], masks[going], offset[going], seen[going]
        act, arrow = self._act(luck, masks, offset, seen)
        self._move(act, arrow)

    def _notice(self, luck: NDArray[np.float32], cluttered: NDArray[np.bool_], asked: NDArray[np.bool_]) -> None:
        options = self.options
        in_view = (self.view[self.place] >> self.head & 1).astype(bool)
        chance = np.where(cluttered, options.notice_cluttered, options.notice_clear)
        chance = np.where(asked, np.maximum(chance, options.notice_confirmed), chance)
        noticed = in_view & (luck < chance)
        self.found[self.trial[noticed]] = self.clock[noticed]

    def _act(
        self, luck: NDArray[np.float32], masks: NDArray[np.int64], offset: NDArray[np.int64], seen: NDArray[np.bool_]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """What the human does, and whether an arrow was shown."""
        act = (luck[2] * 4).astype(np.int64)
        if self.arrows is None:
            return act, np.zeros(len(act), bool)
        egocentric = (masks >> self.head | masks << N_WEDGES - self.head) & (N_CLUTTER - 1)
        advice = self.arrows[(luck[3] >= 0.5).astype(np.int64), offset, egocentric]
        arrow = seen & (advice != CONFIRM) & (offset != 0)
        obeys = arrow & (luck[1] < self.options.follow)
        if self.options.literal:
            obeys &= act >= LOOK_LEFT
        told = np.where(advice == RIGHT, LOOK_RIGHT, LOOK_LEFT)
        return np.where(obeys, told, act), arrow

    def _move(self, act: NDArray[np.int64], arrow: NDArray[np.bool_]) -> None:
        focus = self.head
        turn = TURN[act]
        self.head = (focus + turn) & (N_WEDGES - 1)
        along = focus
        if self.options.adv_along_base and self.system.name == "ADV":
            along = self.base
        goes = act <= BACK
        heading = np.where(act == BACK, along + N_WEDGES // 2, along) & (N_WEDGES - 1)
        if self.belief is not None:
            goes, heading = self._intend(self.belief, turn, focus, goes, heading, arrow)
        self.place = np.where(goes, self.moves[self.place, heading], self.place)

    def _intend(
        self,
        before: NDArray[np.float32],
        turn: NDArray[np.int64],
        focus: NDArray[np.int64],
        goes: NDArray[np.bool_],
        heading: NDArray[np.int64],
        arrow: NDArray[np.bool_],
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Where the robot goes once it knows what the human did."""
        options = self.options
        belief = (1 - options.rho) * before + np.float32(options.rho / N_WEDGES)
        belief *= self.likelihoods[turn + 1, focus]
        belief /= belief.sum(axis=1, keepdims=True)
        self.belief = belief
        wanted = belief.argmax(axis=1)
        sure = belief[np.arange(len(wanted)), wanted] >= options.threshold
        if options.inhibit:
            sure &= ~arrow
        if options.hold:
            goes = np.zeros_like(goes)
        return goes | sure, np.where(sure, wanted, heading)

    def _drop(self, keep: NDArray[np.bool_]) -> None:
        for name in ("trial", "place", "head", "base", "clock"):
            setattr(self, name, getattr(self, name)[keep])
        if self.belief is not None:
            self.belief = self.belief[keep]
