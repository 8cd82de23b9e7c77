"""The same searches through the robot's own brain and safety chain, to see how far the tables can be trusted.

In the loop: the brain (wedge state, its fusion, policy, cue timing, intent filter, steering), the safety chain,
the base's simulated firmware and kinematics, noisy lidar scans, the furnished world in 3D; and, for some trials,
rendered pictures with a detector of pictures. For the others an ideal one reports what is in line of sight.
"""

from __future__ import annotations

import csv
import io
import math
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ghal360_robot import __version__
from ghal360_robot.angles import wrap
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.experiments.buildings import building_map
from ghal360_robot.experiments.grid import ground_of
from ghal360_robot.experiments.ground import DISTANCES_M, far
from ghal360_robot.experiments.planner import BEYOND, PERFECT, NextView, plan_searches
from ghal360_robot.experiments.search import F1, GHAL360, NOT_FOUND, RLGS, Options, Trials, most_ticks, search
from ghal360_robot.experiments.stack_human import Shown, StackHuman
from ghal360_robot.experiments.tally import Sums
from ghal360_robot.guidance.belief import DetectorModel, likely_wedge
from ghal360_robot.guidance.egocentric import WEDGE_WIDTH
from ghal360_robot.messages import Cue, Pose2
from ghal360_robot.simulation.lockstep import DETECTED_M, TICK_S, Camera, Lockstep
from ghal360_robot.simulation.rendered_eye import RenderedEye
from ghal360_robot.simulation.world import ROBOT_RADIUS_M, TARGETS, build_world

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ghal360_robot.experiments.ground import Ground
    from ghal360_robot.messages import Applied, Decision, Inputs
    from ghal360_robot.simulation.operator_desk import OperatorDesk
    from ghal360_robot.simulation.world import World

PLANNER = "GHAL360+"
STACK_VERSION = 6
"""Raised when the same trial would go otherwise: kept ones of older versions are driven again."""
COMPARED = 12
"""Trials that RLGS and GHAL360 drive as well: they mostly search until the limit, which costs minutes."""
TABLE_TRIALS = 200
"""Trials on the tables from the same start: their mean has little luck left."""
NEAR_M = DISTANCES_M[:2]
WORLDS = ("office", "home")
ROOM_M = 0.15
"""Around a robot at a start chosen by distance, so that it can turn."""
OPTIONS = replace(F1, range_m=DETECTED_M, hold=True, inhibit=True, notice_clear=1.0, notice_cluttered=1.0)
"""As the brain does it: it holds while unsure, does not drive against an arrow; a human who looks at it sees it."""
IN_THE_LOOP = (
    "In the loop: brain, safety chain, simulated base firmware and kinematics, lidar with 20 mm of noise, 3D world.",
    "With ideal eyes: no pictures, whatever is in line of sight within 8 m is reported in its direction.",
    "With a detector's name: 1920 x 960 pictures are rendered and searched, without the video codec in between.",
)
IDEAL = "ideal"


@dataclass(frozen=True, slots=True)
class Eyes:
    """How a detector's pictures come, and what the planner takes it for."""

    every_ticks: int
    delay_ticks: int
    reach_m: float | tuple[tuple[str, float], ...]
    """How far it finds things; for each target where they differ."""
    rates: DetectorModel

    def reach(self, target: str) -> float:
        return self.reach_m if isinstance(self.reach_m, float) else dict(self.reach_m)[target]


EYES = {
    # On a map of cells, lines of sight are not quite those in 3D.
    IDEAL: Eyes(12, 8, DETECTED_M, DetectorModel(hit_rate=0.98, false_rate=0.02)),
    "painted": Eyes(12, 8, 6.0, DetectorModel(hit_rate=0.9, false_rate=0.02)),
}
NETWORK_EYES = Eyes(
    every_ticks=20,
    delay_ticks=20,
    reach_m=(("television", 4.0), ("laptop", 2.5), ("bottle", 1.5), ("backpack", 2.0)),
    rates=DetectorModel(hit_rate=0.6, false_rate=0.02),
)
"""Of small networks on two cores: 2.5 pictures a second, each known 0.4 s later; reaches as `benchmarks/recall.py`
demands them in the rendered world."""


@dataclass(frozen=True, slots=True)
class StackTrial:
    """One search of one system; the same number is the same world, start and heading for all systems."""

    number: int
    system: str
    eyes: str = IDEAL
    """`ideal`, or the detector that searches rendered pictures."""
    distance_m: float | None = None
    """Straight to the target at the start; None starts where the world has its start."""

    def key(self) -> dict[str, Any]:
        """All that the result depends on."""
        return {"stack": asdict(self), "version": [__version__, STACK_VERSION]}


def stack_trials(count: int) -> list[StackTrial]:
    """`count` searches with the planner, the first few of them with the paper's systems too."""
    trials = [StackTrial(number, PLANNER) for number in range(count)]
    return trials + [
        StackTrial(number, system) for system in (RLGS.name, GHAL360.name) for number in range(min(count, COMPARED))
    ]


def rendered_trials(runs: int, detector: str) -> list[StackTrial]:
    """By that detector on rendered pictures and by the ideal one, `runs` worlds each.

    The planner from six distances; RLGS and GHAL360 from the near ones, as from further away they mostly search until
    the limit, which with rendered pictures costs minutes each.
    """
    return [
        StackTrial(run * len(DISTANCES_M) + i, system, eyes, distance_m)
        for system, distances in ((PLANNER, DISTANCES_M), (RLGS.name, NEAR_M), (GHAL360.name, NEAR_M))
        for run in range(runs)
        for i, distance_m in enumerate(distances)
        for eyes in (IDEAL, detector)
    ]


def do_trial(trial: StackTrial) -> dict[str, Any]:
    """Both times of one trial, and what filled the one through the stack, as JSON.

    Raises UsageError for an unknown detector, WeightsError where its weights are missing.
    """
    n = trial.number if trial.distance_m is None else trial.number + trial.number // len(DISTANCES_M)
    kind, target = WORLDS[n % len(WORLDS)], TARGETS[trial.number // len(WORLDS) % len(TARGETS)]
    world = build_world(kind, trial.number, target)
    building = building_map(world)
    ground = ground_of(building, step_m=OPTIONS.step_m, range_m=OPTIONS.range_m)
    goal = ground.goals[0]
    if trial.distance_m is not None:
        world = replace(world, start=_start(world, ground, trial.distance_m))
    start = int(far(ground.xy - (world.start.x, world.start.y)).argmin())
    eyes = EYES.get(trial.eyes, NETWORK_EYES)
    reach_m = eyes.reach(target)
    seen = ground if reach_m == OPTIONS.range_m else ground_of(building, step_m=OPTIONS.step_m, range_m=reach_m)
    config = with_overrides(
        RobotConfig(), {"perception": {"target": target, "detector": "none" if trial.eyes == IDEAL else trial.eyes}}
    )
    with ExitStack() as stack:
        camera = None
        if trial.eyes != IDEAL:
            eye = stack.enter_context(RenderedEye(world, config))
            camera = Camera(eye.look, eyes.every_ticks, eyes.delay_ticks)
        run = _Run(world, seen, trial, config, camera)
        result = run.search()
    tables = _on_tables(ground, trial, start, run.human_heading)
    sums = Sums()
    sums.add(tables, OPTIONS.limit_s)
    report = sums.report()
    return {
        "number": trial.number,
        "system": trial.system,
        "eyes": trial.eyes,
        "world": f"{kind}-{trial.number}-{target}",
        "distance_m": round(float(goal.distance_m[start]), 2),
        **result,
        "tables_mean_s": report["mean_time_s"],
        "tables_success": report["success"],
    }


def _start(world: World, ground: Ground, distance_m: float) -> Pose2:
    """A place with room to turn, about so far from the target, from which the target can be reached."""
    goal = ground.goals[0]
    leads = ground.leads_to_view(goal)
    roomy = world.clearances(ground.xy[:, 0], ground.xy[:, 1]) > ROBOT_RADIUS_M + ROOM_M
    off = np.where(leads & roomy, np.abs(goal.distance_m - distance_m), np.inf)
    rng = np.random.default_rng([world.seed, round(distance_m)])
    best = int(rng.choice(np.flatnonzero(off <= max(ground.tolerance_m, float(off.min())))))
    x, y = ground.xy[best].tolist()
    return Pose2(x, y, float(rng.uniform(-math.pi, math.pi)))


class _Run:
    """One search through the stack in simulated time."""

    def __init__(
        self, world: World, ground: Ground, trial: StackTrial, config: RobotConfig, camera: Camera | None
    ) -> None:
        self.lockstep = Lockstep(world, config, trial.number, self._on_tick, camera)
        self.world, self.ground, self.trial = world, ground, trial
        rates = EYES.get(trial.eyes, NETWORK_EYES).rates
        self.planner = NextView(ground, rates) if trial.system == PLANNER else None
        self.start = int(far(ground.xy - (world.start.x, world.start.y)).argmin())
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
        self.questions = self.wrong_questions = 0
        self._cue = Cue.NONE
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
            "questions": self.questions,
            "wrong_questions": self.wrong_questions,
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
        if decision.cue is Cue.CONFIRM and self._cue is not Cue.CONFIRM:
            self.questions += 1
            self.wrong_questions += not self._target_ahead(inputs)
        self._cue = decision.cue
        if decision.target_yaw is not None and believed(decision):
            self.seen.append(self.lockstep.body.pose.yaw + decision.target_yaw)

    def _target_ahead(self, inputs: Inputs) -> bool:
        """Whether the target really is about where the operator looks, hidden or not."""
        pose, target = self.lockstep.body.pose, self.world.target_object()
        gaze = pose.yaw + (0.0 if inputs.operator is None else inputs.operator.head.yaw)
        return abs(wrap(math.atan2(target.y - pose.y, target.x - pose.x) - gaze)) <= WEDGE_WIDTH

    def _arrow(self, pose: Pose2, now_ns: int) -> Shown:
        """The planner's arrow; asked only while the brain shows none."""
        if self.planner is None:
            return Shown()
        # A robot beside the middle of a cell may be nearest to one that no way leads to: that is not where it is.
        reachable = np.isfinite(self.ground.path_m[self.start])
        place = int(np.where(reachable, far(self.ground.xy - (pose.x, pose.y)), np.inf).argmin())
        bearings = [math.pi / 2 - yaw for yaw in self.seen]
        self.seen.clear()
        step = self.planner.look(place, bearings)
        if step is None:
            return Shown()
        # From where the robot is, not from the middle of its cell: a way that is out by as little misses a door.
        x, y = self.ground.xy[step].tolist()
        return Shown(math.atan2(y - pose.y, x - pose.x))


def believed(decision: Decision) -> bool:
    """Whether the brain takes the target to be in view.

    It also remembers what it saw only weakly, and would not point at: a planner that did would never leave it.
    """
    chances = np.array(decision.target_chances)
    return len(chances) > 0 and likely_wedge(chances) is not None


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
    both = len({piece.eyes for piece in pieces}) > 1
    for system, eyes in dict.fromkeys((piece.system, piece.eyes) for piece in pieces):
        name = f"{system}, {eyes}" if both else system
        mine = [result for result in results if (result["system"], result["eyes"]) == (system, eyes)]
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
            "questions": sum(result["questions"] for result in mine),
            "wrong_questions": sum(result["wrong_questions"] for result in mine),
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
        "eyes",
        "world",
        "distance_m",
        "found",
        "stack_s",
        "tables_mean_s",
        "tables_success",
        "driven_m",
        "questions",
        "wrong_questions",
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
