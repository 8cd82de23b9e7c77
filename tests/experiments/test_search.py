"""The target searches: the numbers of configuration F1, and what each rule of the simulation does."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from ghal360_robot.experiments.evaluation import PAPER_ROWS, do_piece, gather, pieces_of
from ghal360_robot.experiments.floors import open_floor, room_floor
from ghal360_robot.experiments.grid import GridMap, Thing, ground_of
from ghal360_robot.experiments.ground import DISTANCES_M, Goal, Ground
from ghal360_robot.experiments.planner import BEYOND, PERFECT, WRONG, NextView, PlannerOptions, plan_searches
from ghal360_robot.experiments.real_stack import believed
from ghal360_robot.experiments.search import (
    ADV,
    F1,
    FGS,
    GHAL360,
    MFO,
    NO_HANDICAP,
    RLGS,
    SYSTEMS,
    Options,
    Trials,
    draw_trials,
    most_ticks,
    search,
)
from ghal360_robot.guidance.belief import DetectorModel
from ghal360_robot.messages import STILL, Cue, Decision

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.fixture(scope="module")
def f1() -> dict[str, dict[str, object]]:
    pieces = pieces_of(PAPER_ROWS[:2], range(2), 200)
    return gather(pieces, [do_piece(piece) for piece in pieces])


def mean_times(row: dict, system: str) -> list[float]:
    return [sums["mean_time_s"] for sums in row["systems"][system]["by_distance"].values()]


def test_f1_has_the_accuracies_of_the_reference(f1: dict) -> None:
    systems = f1["F1"]["systems"]
    assert sum(report["n"] for report in systems.values()) == 72_000
    reference = {"MFO": 0.56, "ADV": 0.56, "FGS": 0.74, "RLGS": 0.79, "GHAL360": 0.84}
    for name, accuracy in reference.items():
        assert systems[name]["success"] == pytest.approx(accuracy, abs=0.03)
        assert 0 < systems[name]["success_se"] < 0.006


def test_f1_has_the_papers_shape_over_distance(f1: dict) -> None:
    times = {name: np.array(mean_times(f1["F1"], name)) for name in ("MFO", "ADV", "FGS", "RLGS", "GHAL360")}
    assert np.array_equal(times["MFO"], times["ADV"])
    assert np.all(times["GHAL360"] < times["FGS"])
    assert np.all(times["FGS"] < times["ADV"])
    assert times["GHAL360"][:2] == pytest.approx(times["RLGS"][:2], abs=1.0)
    assert times["RLGS"][5] - times["GHAL360"][5] > 30
    paired = f1["F1"]["rlgs_minus_ghal360_s"]["12"]
    assert paired["mean_s"] == pytest.approx(times["RLGS"][5] - times["GHAL360"][5], abs=0.02)
    assert paired["se_s"] < 4


def test_without_the_handicap_fgs_is_as_good_as_the_learned_policy(f1: dict) -> None:
    systems = f1["everyone recognises at once"]["systems"]
    assert systems["FGS"]["success"] == pytest.approx(systems["RLGS"]["success"], abs=0.01)


ROOM = GridMap("room", 0.5, ("." * 40,) * 40, (Thing("backpack", 10.25, 10.25),), ())


@pytest.fixture(scope="module")
def room() -> tuple[Ground, Goal]:
    ground = ground_of(ROOM, step_m=1.5, range_m=6.0)
    return ground, ground.goals[0]


def at(ground: Ground, x: float, y: float) -> int:
    return int(np.hypot(*(ground.xy - (x, y)).T).argmin())


def one_trial(place: int, head: int, luck: list[float], ticks: int = 20) -> Trials:
    """A trial with the same four draws at every tick: notice, follow, act, tie."""
    draws = np.tile(np.array(luck, np.float32)[None, :, None], (ticks, 1, 1))
    return Trials(np.array([place]), np.array([head]), np.array([0]), np.array([0]), draws)


FORWARD, LEFT = 0.1, 0.6


def test_wedges_are_clockwise_from_north_and_a_step_is_a_metre_and_a_half(room: tuple[Ground, Goal]) -> None:
    ground, goal = room
    here = at(ground, 10.25, 7.25)
    assert goal.wedge[here] == 0
    assert goal.wedge[at(ground, 7.25, 10.25)] == 2
    east = ground.xy[ground.moves[here, 2]] - ground.xy[here]
    north_east = ground.xy[ground.moves[here, 1]] - ground.xy[here]
    assert east == pytest.approx([1.5, 0.0])
    assert north_east == pytest.approx([1.0, 1.0])


def test_a_blocked_step_is_none_or_as_far_as_it_goes() -> None:
    rows = ["." * 10] * 4
    rows[1] = "....o....."
    grid = GridMap("corridor", 0.5, tuple(rows), (Thing("x", 0.25, 0.25),), ())
    for partial, x in ((False, 1.25), (True, 1.75)):
        ground = ground_of(replace(grid, partial_steps=partial), step_m=1.5, range_m=6.0)
        assert ground.xy[ground.moves[at(ground, 1.25, 1.25), 2], 0] == pytest.approx(x)


def test_walls_hide_and_furniture_does_not() -> None:
    for cell, seen in (("#", False), ("o", True)):
        grid = GridMap("wall", 0.5, ("." * 5 + cell + "." * 5,) * 3, (Thing("x", 5.25, 0.75),), ())
        ground = ground_of(grid, step_m=0.5, range_m=6.0)
        assert np.isfinite(ground.goals[0].bearing[at(ground, 0.25, 0.75)]) == seen
        assert (ground.starts(ground.goals[0], 4.0).size > 0) == seen


def test_a_target_straight_ahead_that_is_recognised_ends_the_search_at_once(room: tuple[Ground, Goal]) -> None:
    ground, goal = room
    here = at(ground, 10.25, 7.25)
    for system in SYSTEMS:
        assert search(ground, goal, system, NO_HANDICAP, one_trial(here, 0, [0.5, 0.0, FORWARD, 0.0])) == 0.0


def test_only_learned_systems_ask_to_confirm(room: tuple[Ground, Goal]) -> None:
    ground, goal = room
    unlucky = one_trial(at(ground, 10.25, 7.25), 0, [0.5, 0.0, LEFT, 0.0], ticks=1)
    assert search(ground, goal, RLGS, F1, unlucky) == 0.0
    assert np.isinf(search(ground, goal, FGS, F1, unlucky))


def test_an_arrow_is_followed_wedge_by_wedge(room: tuple[Ground, Goal]) -> None:
    ground, goal = room
    trial = one_trial(at(ground, 10.25, 7.25), 5, [0.0, 0.94, LEFT, 0.0])
    assert search(ground, goal, FGS, F1, trial) == 6.0
    ignoring = one_trial(at(ground, 10.25, 7.25), 5, [0.0, 0.96, LEFT, 0.0])
    assert search(ground, goal, FGS, F1, ignoring) == 10.0


def test_a_target_too_far_away_is_neither_shown_nor_noticed(room: tuple[Ground, Goal]) -> None:
    ground, goal = room
    far_away = one_trial(at(ground, 10.25, 2.25), 0, [0.0, 0.0, LEFT, 0.0])
    assert np.isinf(search(ground, goal, RLGS, F1, far_away))
    walking = one_trial(at(ground, 10.25, 2.25), 0, [0.0, 0.0, FORWARD, 0.0])
    assert search(ground, goal, RLGS, F1, walking) == 4.0


def test_clutter_takes_its_time(room: tuple[Ground, Goal]) -> None:
    grid = replace(ROOM, clutter=(Thing("chair", 7.25, 7.25),))
    ground = ground_of(grid, step_m=1.5, range_m=6.0)
    trial = one_trial(at(ground, 10.25, 7.25), 6, [0.0, 0.0, LEFT, 0.0])
    assert search(ground, ground.goals[0], FGS, F1, trial) == 4.0
    assert search(ground, ground.goals[0], FGS, replace(F1, dwell_s=10.0), trial) == 12.0


def test_intent_drives_where_the_human_keeps_looking(room: tuple[Ground, Goal]) -> None:
    ground, goal = room
    here = at(ground, 10.25, 1.25)
    # Forward and back leave the gaze where it is: two holds are an intention, and the robot goes.
    still = one_trial(here, 0, [0.0, 0.0, 0.3, 0.0], ticks=12)
    holding = search(ground, goal, GHAL360, replace(F1, hold=True), still)
    assert np.isfinite(holding)
    assert np.isinf(search(ground, goal, RLGS, F1, still))


def test_adv_can_drive_along_its_base_and_mfo_look_through_a_narrow_camera(room: tuple[Ground, Goal]) -> None:
    ground, goal = room
    trials = draw_trials(ground, goal, [0], 100, most_ticks(F1))
    plain = search(ground, goal, ADV, F1, trials)
    assert (
        np.isfinite(search(ground, goal, ADV, replace(F1, adv_along_base=True), trials)).mean()
        < np.isfinite(plain).mean()
    )
    narrow = np.isfinite(search(ground, goal, MFO, replace(F1, mfo_fov_deg=30.0), trials)).mean()
    assert narrow < np.isfinite(plain).mean()


def test_trials_are_the_same_for_the_same_run_whatever_else_is_drawn(room: tuple[Ground, Goal]) -> None:
    ground, goal = room
    one, many = draw_trials(ground, goal, [3], 10, 5), draw_trials(ground, goal, [1, 3], 10, 5)
    assert np.array_equal(one.place, many.place[many.run == 3])
    assert np.array_equal(one.luck, many.luck[:, :, many.run == 3])
    for d, distance_m in enumerate(DISTANCES_M):
        assert goal.distance_m[one.place[one.distance == d]] == pytest.approx(distance_m, abs=0.25)


def test_a_learned_policy_takes_the_place_of_the_optimal_one(room: tuple[Ground, Goal]) -> None:
    ground, goal = room
    trials = draw_trials(ground, goal, [0], 50, most_ticks(F1))
    always_left = np.zeros((8, 256), np.int64)
    worse = search(ground, goal, RLGS, F1, trials, always_left)
    plan = search(ground, goal, RLGS, F1, trials)
    near = trials.distance == 0
    assert worse[near].mean() > plan[near].mean() + 1


def test_options_that_make_no_sense_are_refused() -> None:
    for kwargs in ({"follow": 1.2}, {"limit_s": 0.0}, {"notice_clear": -0.1}):
        with pytest.raises(ValueError, match=r"Chances|positive"):
            Options(**kwargs)


@pytest.mark.parametrize(("floor", "far_s"), [(open_floor, 66.0), (room_floor, 105.0)])
def test_the_planner_finds_nearly_everything_and_is_fast(floor: Callable[[int], GridMap], far_s: float) -> None:
    """Few trials of each target; `ghal360 evaluate --beyond` has 7,200: 51 s and 80 s at 12 m."""
    found, times = [], []
    for number in range(2):
        ground = ground_of(floor(number), step_m=1.5, range_m=6.0)
        for n, goal in enumerate(ground.goals):
            trials = draw_trials(ground, goal, [0], 10, most_ticks(F1), (number, n))
            seconds = plan_searches(ground, goal, trials, F1, BEYOND, 2 * number + n)
            found.append(np.isfinite(seconds) & (seconds >= 0))
            times.append(np.where(found[-1], seconds, 330.0)[trials.distance == 5])
    assert np.concatenate(found).mean() >= 0.98
    assert np.concatenate(times).mean() <= far_s


def test_who_asks_too_early_is_often_wrong() -> None:
    ground = ground_of(open_floor(1), step_m=1.5, range_m=6.0)
    trials = draw_trials(ground, ground.goals[1], [0], 40, most_ticks(F1))
    shares = []
    for sure in (0.6, 0.97):
        planner = PlannerOptions(DetectorModel(sure=sure))
        shares.append(np.mean(plan_searches(ground, ground.goals[1], trials, F1, planner) == WRONG))
    assert shares[0] > 3 * shares[1]


def test_the_planner_with_a_perfect_detector_is_never_wrong() -> None:
    ground = ground_of(open_floor(0), step_m=1.5, range_m=6.0)
    trials = draw_trials(ground, ground.goals[0], [0], 20, most_ticks(F1))
    seconds = plan_searches(ground, ground.goals[0], trials, F1, PlannerOptions(PERFECT))
    assert np.all(seconds >= 0)


def test_the_next_view_is_around_the_corner_until_it_has_been_seen() -> None:
    rows = ("." * 20,) * 3 + ("#" * 17 + "...",) + ("." * 20,) * 8
    grid = GridMap("corner", 0.5, rows, (Thing("x", 1.25, 5.25),), ())
    ground = ground_of(grid, step_m=1.5, range_m=6.0)
    planner = NextView(ground, DetectorModel())
    place = at(ground, 2.25, 1.25)
    for _ in range(12):
        step = planner.look(place, [])
        assert step is not None
        assert step in ground.moves[place]
        place = step
    assert ground.xy[place, 1] > 4.0


@pytest.mark.parametrize("bearings", [[], [0.8]])
def test_looks_from_one_place_count_once_however_many_they_are(bearings: list[float]) -> None:
    ground = ground_of(open_floor(0), step_m=1.5, range_m=6.0)
    begin = at(ground, 4.25, 4.25)

    def way(looks: int) -> list[int | None]:
        planner = NextView(ground, DetectorModel(hit_rate=0.6, false_rate=0.02))
        steps = [planner.look(begin, bearings) for _ in range(looks)][-1:]
        while len(steps) < 12 and steps[-1] is not None:
            steps.append(planner.look(steps[-1], []))
        return steps

    assert way(6) == way(1)


def test_only_what_the_brain_believes_to_be_in_view_leads_the_planner() -> None:
    nothing = Decision(Cue.NONE, 0.3, (0,) * 8, None, (0.125,) * 8, None, STILL, ())
    assert not believed(nothing)
    assert not believed(replace(nothing, target_chances=(0.3,) + (0.02,) * 7 + (0.56,)))
    assert believed(replace(nothing, target_chances=(0.5,) + (0.02,) * 7 + (0.36,)))
