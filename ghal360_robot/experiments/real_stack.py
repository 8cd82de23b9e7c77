"""The same searches through the robot's own brain and safety chain, to see how far the tables can be trusted.

In the loop: the brain (wedge state, policy, cue timing, intent filter, steering), the safety chain, the
base's simulated firmware and kinematics, noisy lidar scans, the furnished world in 3D. Not in the loop:
rendered pictures and a detector of pictures; an ideal one reports what is in line of sight within 8 m.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ghal360_robot import __version__
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.experiments.buildings import building_map
from ghal360_robot.experiments.grid import ground_of
from ghal360_robot.experiments.ground import far
from ghal360_robot.experiments.planner import BEYOND, PERFECT, NextView, plan_searches
from ghal360_robot.experiments.search import F1, GHAL360, NOT_FOUND, RLGS, Options, Trials, most_ticks, search
from ghal360_robot.experiments.stack_human import Shown, StackHuman
from ghal360_robot.experiments.tally import Sums
from ghal360_robot.guidance.belief import DetectorModel
from ghal360_robot.messages import Cue
from ghal360_robot.simulation.lockstep import DETECTED_M, TICK_S, Lockstep
from ghal360_robot.simulation.world import TARGETS, build_world

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ghal360_robot.experiments.ground import Ground
    from ghal360_robot.messages import Applied, Decision, Inputs, Pose2
    from ghal360_robot.simulation.operator_desk import OperatorDesk
    from ghal360_robot.simulation.world import World

PLANNER = "GHAL360+"
STACK_VERSION = 2
"""Raised when the same trial would go otherwise: kept ones of older versions are driven again."""
COMPARED = 12
"""Trials that RLGS and GHAL360 drive as well: they mostly search until the limit, which costs minutes."""
TABLE_TRIALS = 200
"""Trials on the tables from the same start: their mean has little luck left."""
WORLDS = ("office", "home")
OPTIONS = replace(F1, range_m=DETECTED_M, hold=True, inhibit=True, notice_clear=1.0, notice_cluttered=1.0)
"""As the brain does it: it holds while unsure, does not drive against an arrow; a human who looks at it sees it."""
STACK_DETECTOR = DetectorModel(hit_rate=0.9, false_rate=0.02)
"""What the planner takes the ideal detector for: on a map of cells, lines of sight are not quite those in 3D."""
IN_THE_LOOP = (
    "In the loop: brain, safety chain, simulated base firmware and kinematics, lidar with 20 mm of noise, 3D world.",
    "Not in the loop: rendered pictures and a detector of pictures; an ideal one reports what is in line of sight.",
)


@dataclass(frozen=True, slots=True)
class StackTrial:
    """One search of one system; the same number is the same world, start and heading for all systems."""

    number: int
    system: str

    def key(self) -> dict[str, Any]:
        """All that the result depends on."""
        return {"stack": asdict(self), "version": [__version__, STACK_VERSION]}


def stack_trials(count: int) -> list[StackTrial]:
    """`count` searches with the planner, the first few of them with the paper's systems too."""
    trials = [StackTrial(number, PLANNER) for number in range(count)]
    return trials + [
        StackTrial(number, system) for system in (RLGS.name, GHAL360.name) for number in range(min(count, COMPARED))
    ]


def do_trial(trial: StackTrial) -> dict[str, Any]:
    """Both times of one trial, and what filled the one through the stack, as JSON."""
    kind, target = WORLDS[trial.number % len(WORLDS)], TARGETS[trial.number // len(WORLDS) % len(TARGETS)]
    world = build_world(kind, trial.number, target)
    ground = ground_of(building_map(world), step_m=OPTIONS.step_m, range_m=OPTIONS.range_m)
    goal = ground.goals[0]
    start = int(far(ground.xy - (world.start.x, world.start.y)).argmin())
    run = _Run(world, ground, trial)
    result = run.search()
    tables = _on_tables(ground, trial, start, run.human_heading)
    sums = Sums()
    sums.add(tables, OPTIONS.limit_s)
    report = sums.report()
    return {
        "number": trial.number,
        "system": trial.system,
        "world": f"{kind}-{trial.number}-{target}",
        "distance_m": round(float(goal.distance_m[start]), 2),
        **result,
        "tables_mean_s": report["mean_time_s"],
        "tables_success": report["success"],
    }


class _Run:
    """One search through the stack in simulated time."""

    def __init__(self, world: World, ground: Ground, trial: StackTrial) -> None:
        config = with_overrides(RobotConfig(), {"perception": {"target": world.target}})
        self.lockstep = Lockstep(world, config, trial.number, self._on_tick)
        self.world, self.ground, self.trial = world, ground, trial
        self.planner = NextView(ground, STACK_DETECTOR) if trial.system == PLANNER else None
        start = int(far(ground.xy - (world.start.x, world.start.y)).argmin())
        self.reachable = np.isfinite(ground.path_m[start])
        self.human = StackHuman(
            world,
            OPTIONS,
            trial.number,
            drives=trial.system == RLGS.name,
            confirm=True,
            planner=self._arrow if self.planner is not None else None,
        )
        self.human_heading = self.human.heading
        # The human sits where the virtual operator does, and is spoken to in the same way.
        self.lockstep.desk = cast("OperatorDesk", self.human)
        self.seen: list[float] = []
        """World yaws of the target in the detections since the human last acted."""
        self.time_s = dict.fromkeys(("not armed", "driving", "arrow", "asked", "unsure"), 0.0)

    def search(self) -> dict[str, Any]:
        lockstep = self.lockstep
        while lockstep.journal.found_ns is None and lockstep.tick * TICK_S < OPTIONS.limit_s:
            lockstep.step()
        found = lockstep.journal.found_ns is not None
        return {
            "stack_s": round(lockstep.tick * TICK_S, 2),
            "found": found,
            "driven_m": round(lockstep.body.distance_m, 2),
            "collisions": lockstep.body.collisions,
            "time_s": {name: round(value, 2) for name, value in self.time_s.items()},
        }

    def _on_tick(self, inputs: Inputs, decision: Decision, applied: Applied) -> None:
        """What this tick was spent on."""
        if not inputs.armed:
            what = "not armed"
        elif abs(applied.twist.v) > 0.02 or abs(applied.twist.w) > 0.05:
            what = "driving"
        elif decision.cue in {Cue.LEFT, Cue.RIGHT}:
            what = "arrow"
        elif decision.cue is Cue.CONFIRM:
            what = "asked"
        else:
            what = "unsure"
        self.time_s[what] += TICK_S
        if decision.target_yaw is not None:
            self.seen.append(self.lockstep.body.pose.yaw + decision.target_yaw)

    def _arrow(self, pose: Pose2, now_ns: int) -> Shown:
        """The planner's arrow; asked only while the brain shows none."""
        if self.planner is None:
            return Shown()
        # A robot beside the middle of a cell may be nearest to one that no way leads to: that is not where it is.
        place = int(np.where(self.reachable, far(self.ground.xy - (pose.x, pose.y)), np.inf).argmin())
        bearings = [math.pi / 2 - yaw for yaw in self.seen]
        self.seen.clear()
        bearing = self.planner.look(place, bearings)
        return Shown(None if bearing is None else math.remainder(math.pi / 2 - bearing, math.tau))


def _on_tables(ground: Ground, trial: StackTrial, start: int, head: int) -> np.ndarray:
    """(TABLE_TRIALS,) times on the tables from the same start and heading."""
    rng = np.random.default_rng([trial.number, 55])
    n = TABLE_TRIALS
    trials = Trials(
        place=np.full(n, start),
        head=np.full(n, head),
        distance=np.zeros(n, np.int64),
        run=np.zeros(n, np.int64),
        luck=rng.random((most_ticks(OPTIONS), 4, n), dtype=np.float32),
    )
    goal = ground.goals[0]
    if trial.system == PLANNER:
        return plan_searches(ground, goal, trials, OPTIONS, replace(BEYOND, detector=PERFECT), trial.number)
    return search(ground, goal, RLGS if trial.system == RLGS.name else GHAL360, OPTIONS, trials)


def gather(pieces: Sequence[StackTrial], results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Both sides by system, the paired gap, and what the time through the stack was spent on."""
    systems: dict[str, Any] = {}
    for name in dict.fromkeys(piece.system for piece in pieces):
        mine = [result for result in results if result["system"] == name]
        times = np.array([result["stack_s"] if result["found"] else NOT_FOUND for result in mine])
        sums = Sums()
        sums.add(times, OPTIONS.limit_s)
        tables = np.array([result["tables_mean_s"] for result in mine])
        gap = np.minimum(times, OPTIONS.limit_s) - tables
        spent = {key: round(float(np.mean([r["time_s"][key] for r in mine])), 1) for key in mine[0]["time_s"]}
        systems[name] = {
            "n": len(mine),
            "stack": sums.report(),
            "tables": {
                "success": round(float(np.mean([result["tables_success"] for result in mine])), 4),
                "mean_time_s": round(float(tables.mean()), 2),
                "trials_per_start": TABLE_TRIALS,
            },
            "gap_s": round(float(gap.mean()), 2),
            "gap_se_s": round(float(gap.std(ddof=1) / math.sqrt(len(gap))), 2) if len(gap) > 1 else 0.0,
            "spent_s": spent,
            "driven_m": round(float(np.mean([result["driven_m"] for result in mine])), 2),
            "collisions": sum(result["collisions"] for result in mine),
        }
    return {
        "limit_s": OPTIONS.limit_s,
        "options": _options(OPTIONS),
        "in_the_loop": list(IN_THE_LOOP),
        "systems": systems,
        "trials": list(results),
    }


def trials_csv(results: dict[str, Any]) -> str:
    """One line per trial."""
    names = (
        "number",
        "system",
        "world",
        "distance_m",
        "found",
        "stack_s",
        "tables_mean_s",
        "tables_success",
        "driven_m",
    )
    spent = list(results["trials"][0]["time_s"])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*names, *(f"{each} s" for each in spent)])
    for trial in results["trials"]:
        writer.writerow([*(trial[name] for name in names), *(trial["time_s"][each] for each in spent)])
    return text.getvalue()


def _options(options: Options) -> dict[str, Any]:
    return asdict(options)
