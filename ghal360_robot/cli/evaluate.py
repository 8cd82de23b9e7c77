"""`ghal360 evaluate`: the paper's target searches, and ours."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from ghal360_robot.cli.experiment_progress import progress, write_results
from ghal360_robot.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ghal360_robot.experiments.evaluation import Row

RUNS, PER_RUN = 5, 200
"""The paper's 1,000 trials per point in five runs."""
BEYOND_PER_RUN = 40
STACK_TRIALS = 60
RENDERED_RUNS = 1
TABLE_WIDTH = 140


def evaluate(
    paper: Annotated[
        bool, typer.Option("--paper", help="The paper's table, with what each assumption is worth")
    ] = False,
    beyond: Annotated[bool, typer.Option("--beyond", help="The search planner with fused detections")] = False,
    stack: Annotated[
        bool, typer.Option("--stack", help="The same searches through brain, safety chain and simulated robot; minutes")
    ] = False,
    rendered: Annotated[
        str | None,
        typer.Option(
            metavar="DETECTOR",
            help="With --stack: rendered pictures, and what searches them, e.g. painted or centernet",
        ),
    ] = None,
    environment: Annotated[
        list[str] | None,
        typer.Option(help="open-N, rooms-N, office-N[-target], home-N[-target], a file or a run's folder; repeatable"),
    ] = None,
    option: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE of configuration F1, e.g. notice_clear=1")
    ] = None,
    policy: Annotated[Path | None, typer.Option(help="A saved policy for RLGS and GHAL360 instead of the plan")] = None,
    runs: Annotated[int, typer.Option(help="Runs with seeds 0, 1 ...", min=1, max=1000)] = RUNS,
    trials: Annotated[
        int | None,
        typer.Option(
            help="Trials per run, target and distance; with --stack in all, on rendered pictures per distance",
            min=1,
            max=100_000,
        ),
    ] = None,
    jobs: Annotated[int | None, typer.Option(help="Processes; as many as there are cores unless given", min=1)] = None,
    out: Annotated[Path, typer.Option(help="Folder of the results; an interrupted evaluation goes on")] = Path(
        "runs/evaluate"
    ),
    fresh: Annotated[bool, typer.Option("--fresh", help="Do not use what an earlier evaluation kept")] = False,
    *,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Search for targets, five systems trial by trial from the same starts with the same luck.

    Example: ghal360 evaluate --paper --json
    """
    from ghal360_robot.experiments import evaluation as ev  # noqa: PLC0415 - half a second for others
    from ghal360_robot.experiments.csv_tables import searches_csv  # noqa: PLC0415
    from ghal360_robot.experiments.work import config_hash, default_jobs, do_all  # noqa: PLC0415

    if sum((paper, beyond, stack)) > 1:
        raise UsageError("choose one of --paper, --beyond and --stack")
    jobs, keep_in = jobs or default_jobs(), None if fresh else out / "kept"
    console = Console(stderr=True, quiet=as_json)
    if rendered is not None and (not stack or rendered in {"none", "ideal"}):
        raise UsageError("--rendered goes with --stack, and names a detector of pictures such as painted or centernet")
    if stack:
        _stack(trials, rendered, jobs, out, keep_in, console, as_json=as_json)
        return
    kind = "beyond" if beyond else "paper"
    rows = _rows(kind, environment or [], option or [])
    per_run = trials or (BEYOND_PER_RUN if beyond else PER_RUN)
    began = time.perf_counter()
    pieces = ev.pieces_of(rows, range(runs), per_run, _actions(policy))
    with progress(console, "searching", len(pieces)) as on_done:
        done = do_all(pieces, ev.do_piece, ev.Piece.key, jobs=jobs, keep_in=keep_in, on_done=on_done)
    gathered = ev.gather(pieces, done)
    results: dict[str, Any] = {
        "kind": kind,
        "config_hash": config_hash([piece.key() for piece in pieces]),
        "runs": list(range(runs)),
        "trials_per_run": per_run,
        "policy": None if policy is None else str(policy),
        **(_beyond_head(gathered) if beyond else _paper_head(gathered)),
        "rows": gathered,
    }
    if beyond:
        results["noisy_detector"] = _noisy(keep_in, jobs)
    results["seconds"] = round(time.perf_counter() - began, 2)
    write_results(out, kind, results, searches_csv(results))
    if as_json:
        print(json.dumps(results | {"results": str(out / f"{kind}.json")}))
    else:
        (_print_beyond if beyond else _print_paper)(results, _wide_console())
        print(f"results in {out}")


def _rows(kind: str, environments: Sequence[str], changes: Sequence[str]) -> list[Row]:
    from ghal360_robot.experiments import evaluation as ev  # noqa: PLC0415
    from ghal360_robot.experiments.search import F1  # noqa: PLC0415

    if kind == "beyond":
        rows = list(ev.beyond_rows(tuple(environments)))
    elif environments or changes:
        rows = [ev.PAPER_ROWS[0], ev.PAPER_ROWS[1]]
        if environments:
            rows = [replace(row, environments=tuple(environments)) for row in rows]
    else:
        rows = list(ev.PAPER_ROWS)
    if changes:
        try:
            changed = ev.with_options(F1, changes)
        except ValueError as error:
            raise UsageError(str(error)) from error
        if kind == "beyond":
            rows = [replace(row, options=changed) for row in rows]
        else:
            rows.insert(1, replace(rows[0], name=", ".join(changes), options=changed))
    return rows


def _actions(policy: Path | None) -> Any:
    if policy is None:
        return None
    from ghal360_robot.experiments.evaluation import actions_of  # noqa: PLC0415
    from ghal360_robot.policy_file import load_policy  # noqa: PLC0415

    return actions_of(load_policy(policy).q)


def _paper_head(rows: dict[str, Any]) -> dict[str, Any]:
    """The contract of --json, from configuration F1."""
    from ghal360_robot.experiments import paper as said  # noqa: PLC0415

    f1 = rows["F1"]["systems"]
    accuracy = {name: report["success"] for name, report in f1.items()}
    return {
        "trials": sum(report["n"] for report in f1.values()),
        "accuracy": accuracy,
        "accuracy_se": {name: report["success_se"] for name, report in f1.items()},
        "mean_time_s": {n: {d: s["mean_time_s"] for d, s in r["by_distance"].items()} for n, r in f1.items()},
        "mean_time_se_s": {n: {d: s["mean_time_se_s"] for d, s in r["by_distance"].items()} for n, r in f1.items()},
        "paper_accuracy": said.ACCURACY,
        "paper_range": {name: list(ends) for name, ends in said.RANGES.items()},
        "difference": {name: round(accuracy[name] - value, 4) for name, value in said.ACCURACY.items()},
        "reference_accuracy": said.REFERENCE,
        "why": [" ".join(sentence.split()) for sentence in said.WHY],
    }


def _beyond_head(rows: dict[str, Any]) -> dict[str, Any]:
    from ghal360_robot.experiments.evaluation import BEYOND_NAME, PLANNER_NAME  # noqa: PLC0415

    full = {
        name.rpartition("(")[2].rstrip(")"): row["systems"][PLANNER_NAME]
        for name, row in rows.items()
        if name.startswith(BEYOND_NAME)
    }
    return {
        "success": {where: report["success"] for where, report in full.items()},
        "success_se": {where: report["success_se"] for where, report in full.items()},
        "wrong": {where: report["wrong"] for where, report in full.items()},
        "mean_time_s": {
            where: {d: sums["mean_time_s"] for d, sums in report["by_distance"].items()}
            for where, report in full.items()
        },
    }


def _noisy(keep_in: Path | None, jobs: int) -> list[dict[str, Any]]:
    from ghal360_robot.experiments import noisy_detector  # noqa: PLC0415
    from ghal360_robot.experiments.work import do_all  # noqa: PLC0415

    results: list[dict[str, Any]] = do_all(
        noisy_detector.RATES,
        noisy_detector.compare_rates,
        lambda rates: ["noisy", *rates, noisy_detector.EPISODES],
        jobs=jobs,
        keep_in=keep_in,
    )
    return results


def _stack(
    trials: int | None,
    detector: str | None,
    jobs: int,
    out: Path,
    keep_in: Path | None,
    console: Console,
    *,
    as_json: bool,
) -> None:
    from ghal360_robot.experiments import real_stack as rs  # noqa: PLC0415 - pulls in the simulated robot
    from ghal360_robot.experiments.work import config_hash, do_all  # noqa: PLC0415

    if detector is None:
        kind, pieces = "stack", rs.stack_trials(trials or STACK_TRIALS)
    else:
        kind, pieces = f"stack-{detector}", rs.rendered_trials(trials or RENDERED_RUNS, detector)
    began = time.perf_counter()
    with progress(console, "driving", len(pieces)) as on_done:
        done = do_all(pieces, rs.do_trial, rs.StackTrial.key, jobs=jobs, keep_in=keep_in, on_done=on_done)
    results = {
        "kind": kind,
        "config_hash": config_hash([piece.key() for piece in pieces]),
        **rs.gather(pieces, done),
        "seconds": round(time.perf_counter() - began, 1),
    }
    write_results(out, kind, results, rs.trials_csv(results))
    if as_json:
        print(json.dumps(results | {"results": str(out / f"{kind}.json")}))
        return
    report = _wide_console()
    table = Table("system", "n", "stack: found", "mean s", "tables: found", "mean s", "gap s", box=None, padding=(0, 2))
    for name, row in results["systems"].items():
        table.add_row(
            name,
            str(row["n"]),
            f"{row['stack']['success']:.3f}",
            f"{row['stack']['mean_time_s']:.1f}",
            f"{row['tables']['success']:.3f}",
            f"{row['tables']['mean_time_s']:.1f}",
            f"{row['gap_s']:+.1f} ({row['gap_se_s']:.1f})",
        )
    report.print(table)
    for sentence in results["in_the_loop"]:
        report.print(f"- {sentence}")
    print(f"results in {out}")


def _wide_console() -> Console:
    """As wide as the terminal; in a pipe as wide as the tables."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=TABLE_WIDTH)


def _print_paper(results: dict[str, Any], console: Console) -> None:
    from ghal360_robot.experiments.search import SYSTEMS  # noqa: PLC0415

    names = [system.name for system in SYSTEMS]
    table = Table("share of targets found", *names, box=None, padding=(0, 2))
    for column in table.columns[1:]:
        column.justify = "right"
    table.add_row("paper, Table I", *(f"{results['paper_accuracy'][name]:.2f}" for name in names))
    ends = results["paper_range"]
    table.add_row("  its entries", *(f"{ends[n][0]:.2f}-{ends[n][1]:.2f}" if n in ends else "" for n in names))
    for name, row in results["rows"].items():
        reports = [row["systems"][system] for system in names]
        table.add_row(name, *(f"{r['success']:.3f} ({r['success_se']:.3f})" for r in reports))
    console.print(table, "")
    times = Table("mean time, s (F1)", *(f"{d} m" for d in results["mean_time_s"]["GHAL360"]), box=None, padding=(0, 2))
    for column in times.columns[1:]:
        column.justify = "right"
    for name in names:
        mean, error = results["mean_time_s"][name], results["mean_time_se_s"][name]
        times.add_row(name, *(f"{mean[d]:.1f} ({error[d]:.1f})" for d in mean))
    console.print(times, "")
    for sentence in results["why"]:
        console.print(f"- {sentence}")
    console.print(
        f"{results['trials']} trials of F1, runs {results['runs']}, standard errors in brackets; not found counts as "
        f"330 s; {results['seconds']:.1f} s; configuration {results['config_hash']}"
    )


def _print_beyond(results: dict[str, Any], console: Console) -> None:
    from ghal360_robot.experiments.evaluation import PLANNER_NAME  # noqa: PLC0415

    table = Table("the search planner", "found", "wrong", "2 m", "12 m", "n", box=None, padding=(0, 2))
    for column in table.columns[1:]:
        column.justify = "right"
    for name, row in results["rows"].items():
        report = row["systems"][PLANNER_NAME]
        by = report["by_distance"]
        near, far = (f"{by[d]['mean_time_s']:.1f} s" if d in by else "" for d in ("2", "12"))
        table.add_row(name, f"{report['success']:.4f}", f"{report['wrong']:.4f}", near, far, str(report["n"]))
    console.print(table, "")
    noisy = Table("detector (hit/false)", "picture by picture", "fused", box=None, padding=(0, 2))
    for each in results["noisy_detector"]:
        cells = (each[how] for how in ("picture by picture", "fused"))
        noisy.add_row(
            f"{each['hit_rate']}/{each['false_rate']}",
            *(f"{cell['return']:.1f} (wrong {cell['wrong']:.1%})" for cell in cells),
        )
    console.print(noisy)
    console.print(f"{results['seconds']:.1f} s; configuration {results['config_hash']}")
