"""`ghal360 train`: learn guidance policies and draw their curves' numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from ghal360_robot.cli.experiment_progress import progress, write_results
from ghal360_robot.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

PAPER_SEEDS, EPISODES = 5, 15_000
COMPARE_FROM = 100
"""From so many seeds on, the plain learner is timed beside, which takes two seconds."""


def train(
    paper: Annotated[bool, typer.Option("--paper", help="The paper's learner: 15,000 episodes, five seeds")] = False,
    learner: Annotated[
        list[str] | None, typer.Option(help="This learner; repeat for several, 'all' for every one")
    ] = None,
    seeds: Annotated[int, typer.Option(help="Seeds 0, 1 ... of each learner", min=1, max=100_000)] = PAPER_SEEDS,
    episodes: Annotated[int, typer.Option(help="Episodes of each seed", min=100, max=10_000_000)] = EPISODES,
    jobs: Annotated[int | None, typer.Option(help="Processes; as many as there are cores unless given", min=1)] = None,
    compare: Annotated[
        bool | None, typer.Option("--compare/--no-compare", help="Time a plain-Python learner beside")
    ] = None,
    save: Annotated[Path | None, typer.Option(help="Save the first seed's policy here, for the robot")] = None,
    out: Annotated[Path, typer.Option(help="Folder of the results; an interrupted training goes on")] = Path(
        "runs/train"
    ),
    fresh: Annotated[bool, typer.Option("--fresh", help="Do not use what an earlier training kept")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Train guidance learners in the abstract simulation, with an exact test of the policy every 100 episodes.

    Example: ghal360 train --paper --json
    """
    from ghal360_robot.experiments import training_curves as curves  # noqa: PLC0415 - half a second for others
    from ghal360_robot.experiments.csv_tables import curves_csv  # noqa: PLC0415
    from ghal360_robot.experiments.work import default_jobs  # noqa: PLC0415

    learners = _learners(learner or ["paper"], curves.LEARNERS)
    if paper and (learner is not None or episodes != EPISODES):
        raise UsageError("--paper is the paper's learner with its 15,000 episodes: leave out --learner and --episodes")
    jobs = jobs or default_jobs()
    seed_list = list(range(seeds))
    pieces = curves.batches_of(learners, seed_list, episodes)
    with progress(Console(stderr=True, quiet=as_json), "training", len(pieces)) as on_done:
        results = curves.train_all(
            learners, seed_list, episodes, jobs=jobs, keep_in=None if fresh else out / "kept", on_done=on_done
        )
    if compare or (compare is None and seeds >= COMPARE_FROM):
        results["speed"] = _speed(episodes, seeds, learners, jobs)
    if save is not None:
        _save(save, learners[0], episodes)
    write_results(out, "train", results, curves_csv(results))
    if as_json:
        print(json.dumps({name: value for name, value in results.items() if name != "learners"} | {
            "learners": {name: _short(report) for name, report in results["learners"].items()},
            "results": str(out / "train.json"),
        }))  # fmt: skip
    else:
        _print(results, out)


def _learners(asked: Sequence[str], known: Sequence[str]) -> list[str]:
    if "all" in asked:
        return list(known)
    for name in asked:
        if name not in known:
            raise UsageError(f"there is no learner {name!r}; choose from {', '.join(known)}, or all")
    return list(dict.fromkeys(asked))


def _speed(episodes: int, seeds: int, learners: Sequence[str], jobs: int) -> dict[str, Any]:
    """Train again without anything kept, or a resumed training would look infinitely fast; then one plain seed."""
    from ghal360_robot.experiments import training_curves as curves  # noqa: PLC0415

    again = curves.train_all(learners[:1], list(range(seeds)), episodes, jobs=jobs)
    return curves.compare_with_plain(episodes, again["seconds"] / seeds)


def _save(path: Path, learner: str, episodes: int) -> None:
    from ghal360_robot import __version__  # noqa: PLC0415
    from ghal360_robot.experiments.training_curves import Batch  # noqa: PLC0415
    from ghal360_robot.guidance.learner import VARIANTS  # noqa: PLC0415
    from ghal360_robot.guidance.saved import SavedPolicy  # noqa: PLC0415
    from ghal360_robot.guidance.training import learn  # noqa: PLC0415
    from ghal360_robot.policy_file import save_policy  # noqa: PLC0415

    if learner not in VARIANTS:
        raise UsageError(f"the {learner} learner plans anew on the robot: there is no table of it to save")
    learned = learn(VARIANTS[learner], [0], episodes)
    provenance = Batch(learner, (0,), episodes).key() | {
        "value": round(float(learned.curve.value[0, -1]), 4),
        "made_by": f"ghal360 {__version__}",
    }
    save_policy(path, SavedPolicy(learned.q[0], provenance))


def _short(report: dict[str, Any]) -> dict[str, Any]:
    """Without the curves, which are in the file."""
    long = {"episodes", "mean", "sd", "percentiles", "curves", "training_return", "final"}
    final, tests = report["final"], report["episodes"]
    picked = [e for e in (0, 100, 500, 1000, 2000, 4000, 8000, 15000) if e in tests] or tests
    at = {str(e): report["mean"][tests.index(e)] for e in picked}
    return {name: value for name, value in report.items() if name not in long} | {
        "value": at,
        "final_mean": report["mean"][-1],
        "final_sd": report["sd"][-1],
        "final_range": [min(final), max(final)],
    }


def _print(results: dict[str, Any], out: Path) -> None:
    console = Console(highlight=False)
    table = Table(box=None, padding=(0, 2))
    for column in ("learner", "value at", "100", "1000", "4000", "8000", "15000", "SD", "> FGS", "> .99 V*"):
        table.add_column(column, justify="left" if column == "learner" else "right")
    for name, report in results["learners"].items():
        value = dict(zip(report["episodes"], report["mean"], strict=True))
        cells = [f"{value[e]:.1f}" if e in value else "" for e in (100, 1000, 4000, 8000, 15000)]
        ends = (report["first_above_fgs"], report["first_above_99_percent"])
        table.add_row(name, "", *cells, f"{report['sd'][-1]:.2f}", *("never" if e is None else str(e) for e in ends))
    console.print(table)
    references = results["references"]
    console.print(
        f"exact values over the 2,048 starts, mean of {len(results['seeds'])} seeds; FGS {references['fgs']}, "
        f"optimum {references['optimum']}; {results['seconds']:.2f} s; configuration {results['config_hash']}"
    )
    if "speed" in results:
        speed = results["speed"]
        console.print(
            f"{speed['vectorised_seconds_per_seed'] * 1e3:.1f} ms per seed, {speed['speedup']:.0f} times as fast as "
            f"the plain learner with the same tests ({speed['plain_seconds_per_seed']:.2f} s), "
            f"{speed['speedup_over_untested']:.0f} times as fast as it is without any"
        )
    console.print(f"results in {out}")
