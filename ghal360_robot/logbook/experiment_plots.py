"""Results of experiments as Rerun time series and bar charts, for those who look at runs there anyway."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ghal360_robot.logbook.errors import RecordingNotWritableError

if TYPE_CHECKING:
    from pathlib import Path

APPLICATION_ID = "ghal360-experiments"


def write_plots(path: Path, results: list[dict[str, Any]]) -> None:
    """One .rrd with everything that can be drawn of these results.

    Raises RecordingNotWritableError where the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    except OSError as error:
        raise RecordingNotWritableError(f"Cannot write {path}: {error.strerror}.") from error
    views: list[Any] = []
    with rr.RecordingStream(APPLICATION_ID, recording_id=_name(results)) as stream:
        stream.save(path)
        for result in results:
            views += _DRAW[result["kind"]](stream, result)
        stream.send_blueprint(rrb.Blueprint(rrb.Grid(*views), collapse_panels=True))
        stream.flush()


def _name(results: list[dict[str, Any]]) -> str:
    return "-".join(result["config_hash"] for result in results)


def _train(stream: rr.RecordingStream, result: dict[str, Any]) -> list[Any]:
    for name, report in result["learners"].items():
        lines = {"mean": report["mean"], **{f"p{p}": band for p, band in report["percentiles"].items()}}
        for line, values in lines.items():
            _series(stream, f"train/{name}/{line}", "episode", report["episodes"], values)
    for name, value in result["references"].items():
        _series(stream, f"train/reference/{name}", "episode", [0, result["episodes"]], [value, value])
    return [rrb.TimeSeriesView(origin="train", name=f"return of the greedy policy, {len(result['seeds'])} seeds")]


def _paper(stream: rr.RecordingStream, result: dict[str, Any]) -> list[Any]:
    names = list(result["accuracy"])
    for which, values in (("paper", result["paper_accuracy"]), ("ours", result["accuracy"])):
        stream.log(f"accuracy/{which}", rr.BarChart(np.array([values[name] for name in names])), static=True)
    for name, by in result["mean_time_s"].items():
        _series(stream, f"time/{name}", "distance_m", [float(d) for d in by], list(by.values()))
    return [
        rrb.BarChartView(origin="accuracy/ours", name="accuracy: " + ", ".join(names)),
        rrb.BarChartView(origin="accuracy/paper", name="Table I: " + ", ".join(names)),
        rrb.TimeSeriesView(origin="time", name="mean time, s, against distance, m"),
    ]


def _beyond(stream: rr.RecordingStream, result: dict[str, Any]) -> list[Any]:
    for name, row in result["rows"].items():
        step, _, where = name.rpartition(" (")
        by = row["systems"]["GHAL360+"]["by_distance"]
        entity = f"beyond/{where.rstrip(')')}/{step.replace(' ', '_')}"
        _series(stream, entity, "distance_m", [float(d) for d in by], [sums["mean_time_s"] for sums in by.values()])
    noisy = result["noisy_detector"]
    for how in ("picture by picture", "fused"):
        values = np.array([one[how]["return"] for one in noisy])
        stream.log(f"fusion/{how.replace(' ', '_')}", rr.BarChart(values), static=True)
    return [
        *(rrb.TimeSeriesView(origin=f"beyond/{where}", name=f"planner, {where}: s") for where in result["success"]),
        rrb.BarChartView(origin="fusion/fused", name="return, fused"),
        rrb.BarChartView(origin="fusion/picture_by_picture", name="return, picture by picture"),
    ]


def _stack(stream: rr.RecordingStream, result: dict[str, Any]) -> list[Any]:
    views = []
    for name in result["systems"]:
        mine = sorted((t for t in result["trials"] if t["system"] == name), key=lambda trial: trial["tables_mean_s"])
        ranks = list(range(len(mine)))
        for what in ("stack_s", "tables_mean_s"):
            _series(stream, f"stack/{name}/{what}", "trial", ranks, [trial[what] for trial in mine])
        views.append(rrb.TimeSeriesView(origin=f"stack/{name}", name=f"{name}: seconds, by trial"))
    return views


def _series(stream: rr.RecordingStream, entity: str, timeline: str, at: list[Any], values: list[float]) -> None:
    # Rerun's time lines are whole numbers; distances are whole metres, episodes and trials are counts.
    times = rr.TimeColumn(timeline, sequence=np.array(at).astype(np.int64))
    stream.send_columns(entity, indexes=[times], columns=rr.Scalars.columns(scalars=np.array(values, np.float64)))


_DRAW = {"train": _train, "paper": _paper, "beyond": _beyond, "stack": _stack}
