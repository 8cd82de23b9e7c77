"""The paper's evaluation and ours: rows of systems and options, over environments, targets, distances and runs."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot import __version__
from ghal360_robot.experiments.environments import OPEN, ROOMS, ground_for, load_environment
from ghal360_robot.experiments.errors import EnvironmentFileError
from ghal360_robot.experiments.ground import DISTANCES_M
from ghal360_robot.experiments.planner import BEYOND, PERFECT, PlannerOptions, plan_searches
from ghal360_robot.experiments.search import (
    DWELL,
    F1,
    GHAL360,
    NO_HANDICAP,
    NOBODY_CONFIRMS,
    RLGS,
    SYSTEMS,
    Options,
    action_table,
    draw_trials,
    most_ticks,
    search,
)
from ghal360_robot.experiments.tally import Difference, Tally
from ghal360_robot.guidance.belief import DetectorModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ghal360_robot.experiments.ground import Ground

RESULTS_VERSION = 1
"""Raised when the same settings would give other results: kept pieces of older versions are not used."""
PAIR = (RLGS.name, GHAL360.name)
PLANNER_NAME = "GHAL360+"


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the results: the paper's systems with some options, or the sixth system."""

    name: str
    options: Options = F1
    planner: PlannerOptions | None = None
    """With it, the row is of the search planner alone."""
    environments: tuple[str, ...] = OPEN


@dataclass(frozen=True, slots=True)
class Piece:
    """One row on one target: what a process does at a time."""

    row: Row
    environment: str
    goal: int
    number: int
    """Place of the environment in the row: part of the trials' random stream."""
    runs: tuple[int, ...]
    per_run: int
    policy: tuple[tuple[int, ...], ...] | None = field(default=None, repr=False)
    """(8, 256) actions of a learned policy, in place of the optimal ones."""

    def key(self) -> dict[str, Any]:
        """All that the result depends on."""
        return {**_plain(asdict(self)), "version": [__version__, RESULTS_VERSION]}


PAPER_ROWS = (
    Row("F1"),
    Row("everyone recognises at once", NO_HANDICAP),
    Row("nobody is asked to confirm", NOBODY_CONFIRMS),
    Row("a look at clutter takes 10 s, recognised at once", DWELL),
    Row("F1 on unseen floors", environments=("open-3", "open-4", "open-5")),
    Row("F1 on floors with rooms", environments=ROOMS),
    Row("F1, GHAL360 holds while unsure", replace(F1, hold=True)),
    Row("F1, no driving while an arrow is shown", replace(F1, inhibit=True)),
)
"""F1 is compared with the paper; the others show what each assumption is worth."""

_HASTY = DetectorModel(sure=0.6)
BEYOND_STEPS = {
    "planner, perfect detector": PlannerOptions(PERFECT, inhibit=False, continuous=False),
    "and no driving while an arrow is shown": PlannerOptions(PERFECT, inhibit=True, continuous=False),
    "and a continuous arrow": PlannerOptions(PERFECT, inhibit=True, continuous=True),
    "and a detector of .8/.05, fused, asking at .97": BEYOND,
    "the same, asking at .6": PlannerOptions(_HASTY, inhibit=True, continuous=True),
}
BEYOND_NAME = "and a detector of .8/.05, fused, asking at .97"


def beyond_rows(given: tuple[str, ...] = ()) -> tuple[Row, ...]:
    """The sixth system step by step, on open floors and on floors with rooms, or on given environments."""
    places = (("given", given),) if given else (("open", OPEN), ("rooms", ROOMS))
    return tuple(
        Row(f"{name} ({where})", planner=planner, environments=floors)
        for where, floors in places
        for name, planner in BEYOND_STEPS.items()
    )


def pieces_of(
    rows: Sequence[Row], runs: Sequence[int], per_run: int, actions: NDArray[np.int64] | None = None
) -> list[Piece]:
    """What there is to do. Raises EnvironmentFileError for environments that cannot be had."""
    policy = None if actions is None else tuple(tuple(row) for row in actions.tolist())
    return [
        Piece(row, environment, goal, number, tuple(runs), per_run, None if row.planner else policy)
        for row in rows
        for number, environment in enumerate(row.environments)
        for goal in range(len(_ground(environment, row.options.step_m, row.options.range_m).goals))
    ]


def do_piece(piece: Piece) -> dict[str, Any]:
    """The sums of one piece, as JSON."""
    options = piece.row.options
    ground = _ground(piece.environment, options.step_m, options.range_m)
    goal = ground.goals[piece.goal]
    stream = (piece.number, piece.goal)
    try:
        trials = draw_trials(ground, goal, piece.runs, piece.per_run, most_ticks(options), stream)
    except ValueError as error:
        raise EnvironmentFileError(str(error)) from error
    if piece.row.planner is not None:
        seed = 100 * piece.number + piece.goal
        found = plan_searches(ground, goal, trials, options, piece.row.planner, seed)
        tally = Tally()
        tally.add(found, trials.distance, trials.run, options.limit_s)
        return {"systems": {PLANNER_NAME: tally.to_json()}}
    actions = None if piece.policy is None else np.array(piece.policy)
    times = {system.name: search(ground, goal, system, options, trials, actions) for system in SYSTEMS}
    tallies = {}
    for name, found in times.items():
        tallies[name] = Tally()
        tallies[name].add(found, trials.distance, trials.run, options.limit_s)
    gap = Difference()
    gap.add(times[PAIR[0]], times[PAIR[1]], trials.distance, options.limit_s)
    return {"systems": {name: tally.to_json() for name, tally in tallies.items()}, "pair": gap.to_json()}


def gather(pieces: Sequence[Piece], results: Sequence[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """The report of every row: systems with overall and by-distance figures, and the paired difference."""
    rows: dict[str, dict[str, Any]] = {}
    for row in dict.fromkeys(piece.row for piece in pieces):
        mine = [(p, r) for p, r in zip(pieces, results, strict=True) if p.row == row]
        tallies: dict[str, Tally] = {}
        apart: dict[str, list[float]] = {}
        gap = Difference()
        for _, result in mine:
            for name, body in result["systems"].items():
                tally = Tally.from_json(body)
                tallies.setdefault(name, Tally()).merge(tally)
                apart.setdefault(name, []).append(round(tally.total.found / tally.total.n, 4))
            if "pair" in result:
                gap.merge(Difference.from_json(result["pair"]))
        rows[row.name] = {
            "environments": list(row.environments),
            "options": _changed(row.options),
            "planner": None if row.planner is None else _plain(asdict(row.planner)),
            "systems": {name: {**tally.report(), "success_by_target": apart[name]} for name, tally in tallies.items()},
            "rlgs_minus_ghal360_s": gap.report(),
        }
    return rows


def actions_of(q: NDArray[np.float64]) -> NDArray[np.int64]:
    """A learned policy as `pieces_of` takes it."""
    return action_table(q)


def with_options(options: Options, changes: Sequence[str]) -> Options:
    """Options with NAME=VALUE changes. Raises ValueError, naming the known ones, for any other."""
    values: dict[str, Any] = {}
    known = {each.name: each for each in fields(Options)}
    for change in changes:
        name, equals, text = change.partition("=")
        if not equals or name not in known:
            raise ValueError(f"{change!r} is not NAME=VALUE with one of {', '.join(known)}")
        values[name] = _value(name, text, getattr(options, name))
    return replace(options, **values)


def _value(name: str, text: str, now: object) -> bool | float:
    if isinstance(now, bool):
        if text.lower() not in {"true", "false"}:
            raise ValueError(f"{name} is true or false, not {text!r}")
        return text.lower() == "true"
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{name} is a number, not {text!r}") from None


def _changed(options: Options) -> dict[str, Any]:
    """What differs from F1."""
    return {
        each.name: value for each in fields(Options) if (value := getattr(options, each.name)) != getattr(F1, each.name)
    }


def _plain(value: Any) -> Any:
    """The same, as JSON would give it back."""
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value


@lru_cache(maxsize=16)
def _ground(environment: str, step_m: float, range_m: float) -> Ground:
    ground = ground_for(load_environment(environment), step_m=step_m, range_m=range_m)
    if not any(ground.starts(goal, d).size for goal in ground.goals for d in DISTANCES_M):
        raise EnvironmentFileError(f"{environment}: there is no place to start from at {DISTANCES_M} m of any target")
    return ground
