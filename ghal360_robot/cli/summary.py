"""The summary of a run, for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from ghal360_robot.journal import RunReport


def print_summary(report: RunReport) -> None:
    """What was found, how long it took, how the devices and the loop did, where the recording is."""
    table = Table(show_header=False, box=None, padding=(0, 2))
    if report.found:
        table.add_row("target found", f"after {report.seconds_to_found:.1f} s")
    else:
        table.add_row("target found", "no")
    table.add_row("distance driven", f"{report.distance_m:.1f} m")
    table.add_row("cues shown", ", ".join(f"{count} {cue}" for cue, count in report.cues.items()) or "none")
    table.add_row("stops", "; ".join(f"{s['t_s']:.1f} s {s['reason']}" for s in report.stops) or "none")
    if report.simulation is not None and "collisions" in report.simulation:
        table.add_row("collisions", str(report.simulation["collisions"]))
    late = report.tick_lateness_ms
    table.add_row(
        "tick lateness",
        f"p50 {late['p50']:.2f} ms, p99 {late['p99']:.2f} ms, max {late['max']:.1f} ms "
        f"over {report.ticks} ticks, {report.ticks_skipped} skipped",
    )
    for name, device in (("theta", report.theta), ("rmp110", report.rmp110), ("tim571", report.tim571)):
        table.add_row(
            name,
            f"{device['received']} received at {device['rate_hz']:.1f} Hz, {device['lost']} lost, "
            f"{device['damaged']} damaged, {device['reconnects']} reconnects",
        )
    table.add_row("recording", f"{escape(str(report.recording))} ({report.recording_bytes / 1e6:.1f} MB)")
    Console(highlight=False, soft_wrap=True).print(table)
