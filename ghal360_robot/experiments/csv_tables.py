"""Results as flat tables for other programs."""

from __future__ import annotations

import csv
import io
from typing import Any


def curves_csv(results: dict[str, Any]) -> str:
    """learner, episodes, mean, sd and percentiles of every test."""
    rows: list[list[Any]] = []
    for name, report in results["learners"].items():
        bands = report["percentiles"]
        rows += [
            [name, episode, report["mean"][i], report["sd"][i], *(bands[p][i] for p in bands)]
            for i, episode in enumerate(report["episodes"])
        ]
    percentiles = next(iter(results["learners"].values()))["percentiles"]
    return _csv(["learner", "episodes", "mean", "sd", *(f"p{p}" for p in percentiles)], rows)


FIGURES = (
    "n",
    "success",
    "success_se",
    "wrong",
    "mean_time_s",
    "mean_time_se_s",
    "found_only_mean_time_s",
    "found_only_mean_time_se_s",
)


def searches_csv(results: dict[str, Any]) -> str:
    """row, system, distance and the figures of each; distance "all" is the total."""
    rows: list[list[Any]] = []
    for name, row in results["rows"].items():
        for system, report in row["systems"].items():
            rows.append([name, system, "all", *(report[figure] for figure in FIGURES)])
            rows += [
                [name, system, key, *(sums[figure] for figure in FIGURES)]
                for key, sums in report["by_distance"].items()
            ]
    return _csv(["row", "system", "distance_m", *FIGURES], rows)


def _csv(header: list[str], rows: list[list[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
