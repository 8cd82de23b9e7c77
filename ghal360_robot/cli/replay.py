"""`ghal360 replay`: today's brain and safety chain on a recorded run."""

from __future__ import annotations

import contextlib
import json
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ghal360_robot.assembly import camera_view, detector_options, lidar_mount, make_brain, make_safety
from ghal360_robot.config import load_config, parse_config, with_overrides
from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.logbook.outcome import Outcome
from ghal360_robot.logbook.overlay import Overlay
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.redetection import redetect
from ghal360_robot.logbook.replay import replay as replay_run
from ghal360_robot.perception.detectors.base import make_detector
from ghal360_robot.policy_file import KNOWN, known_before

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ghal360_robot.config import RobotConfig
    from ghal360_robot.logbook.replay import Replayed
    from ghal360_robot.messages import Detections

SHOWN = 5
"""Differing ticks that are printed one by one."""


@dataclass(slots=True)
class Comparison:
    """What would have been decided otherwise."""

    ticks: int = 0
    differing_ticks: int = 0
    fields: Counter[str] = field(default_factory=Counter)
    cues: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Recorded cue and today's, where they differ."""
    first: list[Replayed] = field(default_factory=list)
    span_s: float = 0.0
    recorded: Outcome = field(default_factory=Outcome)
    replayed: Outcome = field(default_factory=Outcome)

    def note(self, tick: Replayed) -> None:
        self.ticks += 1
        stamp_ns = tick.inputs.stamp_ns
        self.recorded.note(stamp_ns, tick.recorded.decision, tick.recorded.applied)
        self.replayed.note(stamp_ns, tick.decision, tick.applied)
        differing = tick.differing
        if not differing:
            return
        self.differing_ticks += 1
        self.fields.update(differing)
        if "cue" in differing:
            self.cues[tick.recorded.decision.cue.value, tick.decision.cue.value] += 1
        if len(self.first) < SHOWN:
            self.first.append(tick)

    def as_json(self) -> dict[str, Any]:
        return {
            "ticks": self.ticks,
            "differing_ticks": self.differing_ticks,
            "differing_fields": dict(self.fields),
            "differing_cues": {f"{was} -> {now}": n for (was, now), n in self.cues.items()},
            "first_differing_tick": self.first[0].recorded.tick if self.first else None,
            "recorded": self.recorded.figures(),
            "replayed": self.replayed.figures(),
        }


def replay(
    run: Annotated[Path, typer.Argument(help="A run's folder, or one .rrd file")],
    check: Annotated[
        bool, typer.Option("--check", help="Exit 1 if any decision differs from the recorded one")
    ] = False,
    config: Annotated[
        Path | None, typer.Option("-c", "--config", help="These settings instead of the recorded ones")
    ] = None,
    policy: Annotated[str, typer.Option(help="Another guidance policy: plan, rule, fgs, none ...")] = "",
    detector: Annotated[str, typer.Option(help="Another detector on the recorded pictures")] = "",
    overlay: Annotated[
        Path | None, typer.Option(help="Where the second recording goes; by default into the run's folder")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Run today's code on the inputs of a recorded run and compare what it decides.

    With another configuration, policy or detector it says what would have differed, as a table and as a second
    recording, which `ghal360 view` shows over the first.

    Example: ghal360 replay runs/2026-10-11T09-30-00Z-a1b2c3 --check
    """
    if check and (config is not None or policy or detector):
        raise UsageError("--check compares with the recorded settings: leave out --config, --policy and --detector")
    began = time.perf_counter()
    with RunReader(run) as reader:
        settings = _settings(reader, config, policy, detector)
        label = "-".join(part for part in (config.stem if config else "", policy, detector) if part)
        path = overlay or (run / f"replayed-{label}.rrd" if label and run.is_dir() else None)
        comparison = compare(reader, settings, detector, path)
        damage = reader.damage
    seconds = time.perf_counter() - began
    report = comparison.as_json() | {
        "times_real_time": round(comparison.span_s / seconds, 1),
        "overlay": None if path is None else str(path),
        "damage": damage,
        "ok": not comparison.differing_ticks,
    }
    if as_json:
        print(json.dumps(report))
    else:
        _print(comparison, report, damage)
    if check and comparison.differing_ticks:
        raise GhalError(
            f"{comparison.differing_ticks} of {comparison.ticks} ticks are decided otherwise than in the recording, "
            f"the first is tick {report['first_differing_tick']}"
        )


def compare(
    reader: RunReader, settings: RobotConfig, detector: str = "", overlay_path: Path | None = None
) -> Comparison:
    """Replay the whole run with these settings, and with `detector` where one is named."""
    comparison = Comparison()
    camera = camera_view(settings)
    with contextlib.ExitStack() as stack:
        overlay = None
        if overlay_path is not None:
            overlay = stack.enter_context(Overlay(overlay_path, reader.run_id, reader.anchor, camera))

        def found(detections: Detections) -> None:
            comparison.replayed.detected(detections)
            if overlay is not None:
                overlay.detections(detections)

        other: Iterator[Detections] | None = None
        if detector:
            chosen, rate_hz = make_detector(detector, detector_options(settings)), settings.perception.rate_hz
            other = redetect(reader, chosen, rate_hz=rate_hz, camera=camera, told=found)
            for detections in reader.detections():
                comparison.recorded.detected(detections)
        first_ns: int | None = None
        known = known_before(str(reader.path / KNOWN)) if reader.path.is_dir() else None
        parts = make_brain(settings, known), make_safety(settings), lidar_mount(settings)
        for tick in replay_run(reader, *parts, other):
            first_ns = tick.inputs.stamp_ns if first_ns is None else first_ns
            comparison.note(tick)
            comparison.span_s = (tick.inputs.stamp_ns - first_ns) / 1e9
            if overlay is not None:
                overlay.tick(tick)
    if not comparison.ticks:
        raise GhalError(f"{reader.path} holds no control tick: there is nothing to replay")
    return comparison


def _settings(reader: RunReader, config: Path | None, policy: str, detector: str) -> RobotConfig:
    if config is None and not reader.config_json:
        raise GhalError(f"{reader.path} does not hold its settings: name them with --config")
    settings = parse_config(reader.config_json, str(reader.path)) if config is None else load_config(config)
    if policy:
        settings = with_overrides(settings, {"guidance": {"policy": policy}})
    return with_overrides(settings, {"perception": {"detector": detector}}) if detector else settings


def _print(comparison: Comparison, report: dict[str, Any], damage: list[str]) -> None:
    console = Console(highlight=False)
    speed = f"{report['times_real_time']:g} times real time"
    console.print(f"{comparison.ticks} ticks replayed at {speed}, {comparison.differing_ticks} decided otherwise")
    if comparison.fields:
        console.print(_outcomes(comparison))
        table = Table("differing field", "ticks", box=None, padding=(0, 2))
        table.columns[1].justify = "right"
        for name, count in comparison.fields.most_common():
            table.add_row(name, str(count))
        for (was, now), count in comparison.cues.most_common():
            table.add_row(f"cue {was} -> {now}", str(count))
        console.print(table)
    for tick in comparison.first:
        for name in tick.differing:
            before, today = tick.values(name)
            console.print(escape(f"tick {tick.recorded.tick}: {name} was {before}, now {today}"))
    if report["overlay"]:
        console.print(f"second recording: {escape(report['overlay'])}; `ghal360 view` shows it over the first")
    for sentence in damage:
        console.print(f"[yellow]{escape(sentence)}")


def _outcomes(comparison: Comparison) -> Table:
    """Recorded and replayed figures side by side."""
    table = Table("", "recorded", "replayed", box=None, padding=(0, 2))
    for column in table.columns[1:]:
        column.justify = "right"
    recorded, replayed = comparison.recorded.figures(), comparison.replayed.figures()
    for name in [*recorded, *(name for name in replayed if name not in recorded)]:
        before, now = recorded.get(name, 0), replayed.get(name, 0)
        table.add_row(escape(name), str(before), str(now), style="" if before == now else "bold")
    return table
