"""`ghal360 inspect`: what is in a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ghal360_robot.logbook.inspection import inspect_run

if TYPE_CHECKING:
    from ghal360_robot.logbook.inspection import RecordingReport


def inspect(
    run: Annotated[Path, typer.Argument(help="A run's folder, or one .rrd file")],
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Rates, gaps, damage, ages, decisions and size by entity.

    Example: ghal360 inspect runs/2026-10-11T09-30-00Z-a1b2c3
    """
    report = inspect_run(run)
    if as_json:
        print(report.to_json())
    else:
        _print(report, Console(highlight=False))


def _print(report: RecordingReport, console: Console) -> None:
    console.print(f"[bold]{escape(report.run_id)}[/]  {report.duration_s:.1f} s")
    console.print(", ".join(f"{key} {escape(value)}" for key, value in report.properties.items() if value))
    for file in report.files:
        console.print(f"{escape(file.name)}  {file.bytes / 1e6:.2f} MB")
    table = Table("entity", "rows", "rate Hz", "longest gap s", "kB", box=None, padding=(0, 2))
    for column in table.columns[1:]:
        column.justify = "right"
    for row in sorted(report.entities, key=lambda row: -row.bytes):
        table.add_row(row.entity, str(row.rows), f"{row.rate_hz:.2f}", f"{row.max_gap_s:.2f}", f"{row.bytes / 1e3:.0f}")
    console.print(table)
    video, decisions = report.video, report.decisions
    console.print(
        f"video: {video.units} access units, {video.keyframes} key pictures, {video.tainted} tainted, "
        f"{video.missing} missing; lidar: {report.missing_telegrams} telegrams missing"
    )
    for name, age in report.age_ms.items():
        console.print(f"age of {name}: median {age.median:.0f} ms, p99 {age.p99:.0f} ms, max {age.max:.0f} ms")
    late = report.lateness_ms
    console.print(f"tick lateness: median {late.median:.2f} ms, p99 {late.p99:.2f} ms, max {late.max:.1f} ms")
    console.print(
        f"decisions: {decisions.ticks} ticks ({decisions.missing_ticks} missing), "
        f"cues {decisions.cues_shown or 'none'}, {decisions.distance_m:.1f} m driven"
    )
    for reason, seconds in sorted(decisions.stop_s.items(), key=lambda item: -item[1]):
        console.print(f"  held {seconds:.1f} s: {escape(reason)}")
    for mark in report.bookmarks:
        console.print(f"bookmark at {mark.at_s:.1f} s by {escape(mark.holder)}: {escape(mark.note) or '(no note)'}")
    for complaint in (*report.damage, *report.complaints):
        console.print(f"[yellow]{escape(complaint)}[/]")
