"""What is in a recording, as one report: a pure function of what a reader gives."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter, defaultdict
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.rrd import chunk_times
from ghal360_robot.messages import STILL, Cue

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from ghal360_robot.logbook.records import Tick

NS = 1e9

# Complaints repeat; the first ones tell.
MAX_COMPLAINTS = 20


@dataclass(frozen=True, slots=True)
class FileReport:
    name: str
    bytes: int


@dataclass(frozen=True, slots=True)
class EntityReport:
    """One entity's rows; `bytes` are those in memory, before the file's compression."""

    entity: str
    rows: int
    bytes: int
    first_s: float
    """Seconds since the recording's first row."""
    last_s: float
    rate_hz: float
    max_gap_s: float


@dataclass(frozen=True, slots=True)
class VideoReport:
    units: int
    keyframes: int
    tainted: int
    missing: int
    """Sequence numbers that were skipped."""
    bytes: int


@dataclass(frozen=True, slots=True)
class Spread:
    """Percentiles of a quantity over all ticks that had it."""

    count: int
    median: float
    p99: float
    max: float


@dataclass(frozen=True, slots=True)
class DecisionReport:
    ticks: int
    missing_ticks: int
    cues_shown: dict[str, int]
    """How often each cue came up."""
    cue_s: dict[str, float]
    intentions: dict[str, int]
    """How often each world wedge became the intention."""
    armed_s: dict[str, float]
    distance_m: float
    stop_s: dict[str, float]
    """Seconds held still against the brain's wish, by reason."""


@dataclass(frozen=True, slots=True)
class RunReport:
    run_id: str
    duration_s: float
    properties: dict[str, str]
    files: tuple[FileReport, ...]
    damage: tuple[str, ...]
    entities: tuple[EntityReport, ...]
    video: VideoReport
    missing_telegrams: int
    age_ms: dict[str, Spread]
    """Age of each input at the ticks."""
    lateness_ms: Spread
    work_ms: Spread
    decisions: DecisionReport
    complaints: tuple[str, ...]
    """Warnings and errors in the log, the first few."""

    def to_json(self) -> str:
        """One line; keys as the fields."""
        return json.dumps(asdict(self), ensure_ascii=False, allow_nan=False)


def inspect_run(path: Path) -> RunReport:
    """Read a run's folder or a single .rrd file and report on it.

    Raises:
        RecordingNotReadableError: there is nothing there that can be read.
    """
    with RunReader(path) as reader:
        return report(reader)


def report(reader: RunReader) -> RunReport:
    entities, duration_s = _entities(reader)
    ticks = list(reader.ticks())
    ages: dict[str, Sequence[float]] = {
        name: [(tick.stamp_ns - stamp) / 1e6 for tick in ticks if (stamp := getattr(tick, f"{name}_ns")) is not None]
        for name in ("base", "scan", "detections", "operator")
    }
    return RunReport(
        run_id=reader.run_id,
        duration_s=duration_s,
        properties=dict(reader.properties),
        files=tuple(FileReport(part.path.name, part.path.stat().st_size) for part in reader.parts),
        entities=entities,
        video=_video(reader),
        missing_telegrams=_skipped(scan.telegram_counter for scan in reader.scans()),
        age_ms={name: _spread(values) for name, values in ages.items() if values},
        lateness_ms=_spread([tick.lateness_ms for tick in ticks]),
        work_ms=_spread([tick.work_ms for tick in ticks]),
        decisions=_decisions(ticks, reader),
        complaints=tuple(
            itertools.islice(
                (f"{t.source}: {t.text}" for t in reader.texts() if t.level in ("WARN", "ERROR", "CRITICAL")),
                MAX_COMPLAINTS,
            )
        ),
        damage=tuple(reader.damage),
    )


def _entities(reader: RunReader) -> tuple[tuple[EntityReport, ...], float]:
    times: dict[str, list[NDArray[np.int64]]] = {}
    sizes: Counter[str] = Counter()
    for part in reader.parts:
        for chunk in part.chunks():
            stamps = chunk_times(chunk)
            if stamps is not None and len(stamps):
                entity = chunk.entity_path.lstrip("/")
                times.setdefault(entity, []).append(stamps)
                sizes[entity] += chunk.to_record_batch().nbytes
    if not times:
        return (), 0.0
    begin = min(int(stamps.min()) for chunks in times.values() for stamps in chunks)
    end = max(int(stamps.max()) for chunks in times.values() for stamps in chunks)
    reports = []
    for entity, chunks in sorted(times.items()):
        stamps = np.sort(np.concatenate(chunks))
        span_s = float(stamps[-1] - stamps[0]) / NS
        reports.append(
            EntityReport(
                entity=entity,
                rows=len(stamps),
                bytes=sizes[entity],
                first_s=float(stamps[0] - begin) / NS,
                last_s=float(stamps[-1] - begin) / NS,
                rate_hz=(len(stamps) - 1) / span_s if span_s > 0 else 0.0,
                max_gap_s=float(np.diff(stamps).max()) / NS if len(stamps) > 1 else 0.0,
            )
        )
    return tuple(reports), (end - begin) / NS


def _video(reader: RunReader) -> VideoReport:
    units = keyframes = tainted = size = 0
    sequences = []
    for unit in reader.access_units():
        units += 1
        keyframes += unit.keyframe
        tainted += unit.tainted
        size += len(unit.data)
        sequences.append(unit.sequence)
    return VideoReport(units, keyframes, tainted, _skipped(sequences), size)


def _skipped(numbers: Iterable[int]) -> int:
    """How many numbers are missing; a counter that starts again or wraps counts as nothing."""
    return sum(max(0, after - before - 1) for before, after in itertools.pairwise(numbers))


def _spread(values: Sequence[float]) -> Spread:
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return Spread(0, 0.0, 0.0, 0.0)
    median, p99 = np.percentile(finite, (50, 99))
    return Spread(len(finite), float(median), float(p99), max(finite))


def _decisions(ticks: Sequence[Tick], reader: RunReader) -> DecisionReport:
    cues: Counter[str] = Counter()
    intentions: Counter[str] = Counter()
    cue_s: defaultdict[str, float] = defaultdict(float)
    armed_s: defaultdict[str, float] = defaultdict(float)
    stop_s: defaultdict[str, float] = defaultdict(float)
    before: Tick | None = None
    for tick, after in itertools.zip_longest(ticks, ticks[1:]):
        decision, applied = tick.decision, tick.applied
        held_s = 0.0 if after is None else (after.stamp_ns - tick.stamp_ns) / NS
        if decision.cue is not Cue.NONE and (before is None or before.decision.cue is not decision.cue):
            cues[decision.cue.value] += 1
        if decision.intention is not None and (before is None or before.decision.intention != decision.intention):
            intentions[str(decision.intention)] += 1
        cue_s[decision.cue.value] += held_s
        armed_s[applied.arm.value] += held_s
        if applied.twist == STILL and decision.wanted != STILL:
            for reason in applied.reasons or ("no reason given",):
                stop_s[reason] += held_s
        before = tick
    return DecisionReport(
        ticks=len(ticks),
        missing_ticks=_skipped(tick.tick for tick in ticks),
        cues_shown=dict(cues),
        cue_s={name: round(seconds, 3) for name, seconds in cue_s.items()},
        intentions=dict(intentions),
        armed_s={name: round(seconds, 3) for name, seconds in armed_s.items()},
        distance_m=_distance_m(reader),
        stop_s={name: round(seconds, 3) for name, seconds in stop_s.items()},
    )


def _distance_m(reader: RunReader) -> float:
    poses = (state.pose for state in reader.base_states())
    steps = (math.hypot(b.x - a.x, b.y - a.y) for a, b in itertools.pairwise(poses))
    return sum(step for step in steps if math.isfinite(step))
