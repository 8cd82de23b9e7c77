"""Figures from saved results, byte for byte the same from the same file: no dates, fixed identifiers, one style."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from ghal360_robot.experiments.paper import OPTIMUM

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "svg.hashsalt": "ghal360",
    "svg.fonttype": "path",
    "savefig.dpi": 150,
}
COLOURS = {
    "MFO": "#7f7f7f",
    "ADV": "#b08d57",
    "FGS": "#d97706",
    "RLGS": "#2563eb",
    "GHAL360": "#047857",
    "GHAL360+": "#7c3aed",
}
MARKS = {"MFO": "s", "ADV": "x", "FGS": "^", "RLGS": "o", "GHAL360": "D", "GHAL360+": "*"}
PALETTE = ("#2563eb", "#d97706", "#047857", "#7c3aed", "#be123c", "#0891b2", "#65a30d", "#7f7f7f", "#a21caf", "#1f2937")


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """The figures of one file of results, by name. Raises KeyError for results of an unknown kind."""
    makers: dict[str, dict[str, Callable[[dict[str, Any]], Figure]]] = {
        "train": {"learning-curve": learning_curve, "learning-curve-end": learning_end},
        "paper": {"accuracy": accuracy, "time-against-distance": times, "assumptions": assumptions},
        "beyond": {"beyond": beyond, "fusion": fusion},
        "stack": {"stack": stack},
    }
    with mpl.rc_context(STYLE):
        return {name: make(results) for name, make in makers[results["kind"]].items()}


def to_png(figure: Figure) -> bytes:
    with mpl.rc_context(STYLE):
        FigureCanvasAgg(figure)
        data = io.BytesIO()
        figure.savefig(data, format="png", metadata={"Software": None})
    return data.getvalue()


def to_svg(figure: Figure) -> bytes:
    with mpl.rc_context(STYLE):
        FigureCanvasSVG(figure)
        data = io.BytesIO()
        figure.savefig(data, format="svg", metadata={"Date": None, "Creator": None})
    return data.getvalue()


def learning_curve(results: dict[str, Any]) -> Figure:
    """Exact value of the greedy policy against training episodes: the paper's learning curve."""
    figure, axes = _axes(8.4, 4.4)
    _curves(axes, results)
    axes.set_ylim(-260, 260)
    axes.set_title("Guidance learned in the abstract simulation")
    return _finish(figure, _training_note(results))


def learning_end(results: dict[str, Any]) -> Figure:
    """The same, near the top: where the learned policy passes FGS."""
    figure, axes = _axes(8.4, 4.4)
    _curves(axes, results)
    axes.set_ylim(219, 230.5)
    axes.set_title("The last ten units: where learning passes the fixed strategy")
    return _finish(figure, _training_note(results))


def _curves(axes: Axes, results: dict[str, Any]) -> None:
    for colour, (name, report) in zip(PALETTE * 2, results["learners"].items(), strict=False):
        episodes, bands = report["episodes"], report["percentiles"]
        label = f"{name} (mean; band: 5 to 95 % of seeds)" if len(results["learners"]) == 1 else name
        axes.plot(episodes, report["mean"], color=colour, linewidth=1.4, label=label)
        axes.fill_between(episodes, bands["5"], bands["95"], color=colour, alpha=0.18, linewidth=0)
    references = results["references"]
    axes.axhline(references["optimum"], color="black", linewidth=0.8, linestyle="--")
    axes.axhline(references["fgs"], color=COLOURS["FGS"], linewidth=0.8, linestyle="--")
    axes.plot([], [], color="black", linewidth=0.8, linestyle="--", label=f"optimum {references['optimum']}")
    axes.plot([], [], color=COLOURS["FGS"], linewidth=0.8, linestyle="--", label=f"FGS {references['fgs']}")
    axes.set_xlim(0, results["episodes"])
    axes.set_xlabel("training episodes")
    axes.set_ylabel("return of the greedy policy\n(exact mean over the 2,048 starts)")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7.5)


def accuracy(results: dict[str, Any]) -> Figure:
    """Table I and ours side by side."""
    figure, axes = _axes(7.2, 4.0)
    names = list(results["accuracy"])
    free = results["rows"].get("everyone recognises at once", {}).get("systems", {})
    groups: list[tuple[str, list[float], list[float], str]] = [
        ("paper, Table I", [results["paper_accuracy"][n] for n in names], [], "#c7cdd6"),
        ("ours, configuration F1", [results["accuracy"][n] for n in names],
         [results["accuracy_se"][n] for n in names], "#2563eb"),
    ]  # fmt: skip
    if free:
        values = [free[n]["success"] for n in names]
        groups.append(("ours, everyone recognises at once", values, [free[n]["success_se"] for n in names], "#047857"))
    width = 0.8 / len(groups)
    for g, (label, heights, errors, colour) in enumerate(groups):
        at = [i + (g - (len(groups) - 1) / 2) * width for i in range(len(names))]
        axes.bar(at, heights, width * 0.92, color=colour, label=label)
        if errors:
            axes.errorbar(at, heights, [2 * e for e in errors], fmt="none", ecolor="black", elinewidth=0.8, capsize=2)
        for x, height in zip(at, heights, strict=True):
            axes.text(x, height + 0.015, f"{height:.2f}" if g == 0 else f"{height:.3f}", ha="center", fontsize=6.5)
    axes.set_xticks(range(len(names)), names)
    axes.set_ylim(0, 1)
    axes.set_ylabel("share of targets found within 330 s")
    axes.set_title("Accuracy of the five systems")
    axes.grid(visible=False, axis="x")
    axes.legend(loc="upper left", fontsize=8)
    return _finish(figure, _f1_note(results))


def times(results: dict[str, Any]) -> Figure:
    """Mean time against starting distance."""
    figure, axes = _axes(6.4, 4.2)
    for name, by in results["mean_time_s"].items():
        distance = [float(d) for d in by]
        error = [2 * results["mean_time_se_s"][name][d] for d in by]
        line = "--" if name == "ADV" else "-"
        axes.errorbar(
            distance, list(by.values()), error, color=COLOURS[name], marker=MARKS[name], markersize=5, linewidth=1.3,
            linestyle=line, capsize=2, label="ADV (covers MFO)" if name == "ADV" else name,
        )  # fmt: skip
    axes.set_xlabel("distance to the target at the start, m")
    axes.set_ylabel("mean time until it is found, s\n(not found: 330 s)")
    axes.set_ylim(0, 330)
    axes.set_title("Time against distance")
    axes.legend(loc="upper left", fontsize=8)
    return _finish(figure, _f1_note(results))


def assumptions(results: dict[str, Any]) -> Figure:
    """What every assumption is worth: one line per row."""
    rows = results["rows"]
    figure, axes = _axes(7.6, 0.42 * len(rows) + 1.5)
    for y, row in enumerate(rows.values()):
        for name, report in row["systems"].items():
            axes.plot(report["success"], -y, MARKS[name], color=COLOURS[name], markersize=6, fillstyle="none",
                      markeredgewidth=1.4, label=name if y == 0 else None)  # fmt: skip
    axes.set_yticks([-y for y in range(len(rows))], list(rows), fontsize=8)
    axes.set_xlabel("share of targets found within 330 s")
    axes.set_title("What each assumption is worth")
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, -0.9 / (0.42 * len(rows) + 0.6)), ncols=5, fontsize=8)
    return _finish(figure, _search_note(results))


def beyond(results: dict[str, Any]) -> Figure:
    """The search planner, step by step: time against distance on open floors and on floors with rooms."""
    figure = Figure(figsize=(8.4, 4.2), layout="constrained")
    where = list(results["success"])
    axes_of = dict(zip(where, figure.subplots(1, len(where), sharey=True, squeeze=False)[0], strict=True))
    names = list(dict.fromkeys(name.rpartition(" (")[0] for name in results["rows"]))
    for name, row in results["rows"].items():
        step, _, place = name.rpartition(" (")
        report = row["systems"]["GHAL360+"]
        by = report["by_distance"]
        axes = axes_of[place.rstrip(")")]
        label = f"{step}: {report['success']:.3f} found, {report['wrong']:.3f} wrong"
        axes.errorbar(
            [float(d) for d in by], [s["mean_time_s"] for s in by.values()],
            [2 * (s["mean_time_se_s"] or 0) for s in by.values()],
            color=PALETTE[names.index(step)], marker="o", markersize=3.5, linewidth=1.2, capsize=2, label=label,
        )  # fmt: skip
    for place, axes in axes_of.items():
        axes.set_title({"open": "open floors", "rooms": "floors with rooms"}.get(place, place))
        axes.set_xlabel("distance at the start, m")
        axes.legend(loc="upper left", fontsize=6.2)
    highest = max(
        s["mean_time_s"] for r in results["rows"].values() for s in r["systems"]["GHAL360+"]["by_distance"].values()
    )
    first = axes_of[where[0]]
    first.set_ylim(0, 1.5 * highest)
    first.set_ylabel("mean time until it is found, s\n(not found or wrong: 330 s)")
    figure.suptitle("Guidance also while the target is not in view", fontsize=10)
    return _finish(figure, _search_note(results) + "; bars: two standard errors")


def fusion(results: dict[str, Any]) -> Figure:
    """What fusing detections is worth in the abstract simulation."""
    figure, axes = _axes(6.0, 3.8)
    each = results["noisy_detector"]
    for i, (how, colour) in enumerate((("picture by picture", "#c7cdd6"), ("fused", "#2563eb"))):
        at = [k + (i - 0.5) * 0.38 for k in range(len(each))]
        heights = [one[how]["return"] for one in each]
        axes.bar(at, heights, 0.36, color=colour, label=how)
        for x, height, one in zip(at, heights, each, strict=True):
            label = f"{height:.0f}\n{one[how]['wrong']:.1%}"
            inside = height > 60
            axes.text(x, height - 4 if inside else height + 4, label, ha="center", va="top" if inside else "bottom",
                      fontsize=7, color="white" if inside and i else "black")  # fmt: skip
    axes.axhline(OPTIMUM, color="black", linewidth=0.8, linestyle="--")
    axes.set_xticks(range(len(each)), [f"{one['hit_rate']}/{one['false_rate']}" for one in each])
    axes.set_xlabel("detector: chance to report the target / to invent it, per wedge and look")
    axes.set_ylabel("mean return\n(label: return, wrong confirmations)")
    axes.set_ylim(0, 290)
    axes.set_title("Fusing detections")
    axes.grid(visible=False, axis="x")
    axes.legend(loc="upper center", ncols=2, fontsize=8)
    note = f"{each[0]['episodes']} episodes each; dashed: optimum; configuration {results['config_hash']}"
    return _finish(figure, note)


def stack(results: dict[str, Any]) -> Figure:
    """Every trial through the real stack against the same start on the tables."""
    figure, axes = _axes(5.6, 4.6)
    limit = results["limit_s"]
    for name in results["systems"]:
        mine = [trial for trial in results["trials"] if trial["system"] == name]
        axes.plot([t["tables_mean_s"] for t in mine], [t["stack_s"] for t in mine], MARKS[name], color=COLOURS[name],
                  markersize=5, fillstyle="none", label=f"{name} (n = {len(mine)})")  # fmt: skip
    axes.plot([0, limit], [0, limit], color="black", linewidth=0.8, linestyle="--")
    axes.set_xlim(0, limit * 1.02)
    axes.set_ylim(0, limit * 1.02)
    axes.set_xlabel("mean time on the tables from the same start, s")
    axes.set_ylabel("time through brain, safety chain and base, s")
    axes.set_title("The vectorised model against the real stack")
    axes.legend(loc="lower right", fontsize=8)
    note = f"not found: {limit:g} s; dashed: equal; configuration {results['config_hash']}"
    return _finish(figure, note)


def _axes(width: float, height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def _finish(figure: Figure, note: str) -> Figure:
    """Below every figure, in small print, what it was made from."""
    figure.supxlabel(note, fontsize=6.5, color="#555555", x=0.01, ha="left")
    return figure


def _training_note(results: dict[str, Any]) -> str:
    seeds = results["seeds"]
    said = f"{len(seeds)} seeds ({seeds[0]} to {seeds[-1]})"
    return f"{said}, tested every {results['snapshot_every']} episodes; configuration {results['config_hash']}"


def _f1_note(results: dict[str, Any]) -> str:
    runs = (
        f"runs {results['runs'][0]} to {results['runs'][-1]}, {results['trials_per_run']} each per target and distance"
    )
    return (
        f"{results['trials']:,} trials of F1: {runs}; configuration {results['config_hash']}; bars: two standard errors"
    )


def _search_note(results: dict[str, Any]) -> str:
    n = sum(report["n"] for row in results["rows"].values() for report in row["systems"].values())
    runs = f"runs {results['runs'][0]} to {results['runs'][-1]}, {results['trials_per_run']} trials each per target"
    return f"{n:,} trials in all: {runs} and distance; configuration {results['config_hash']}"
