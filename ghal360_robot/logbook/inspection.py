"""What is in a recording, as one report: a pure function of what a reader gives."""

from __future__ import annotations

import itertools
import json
import math
from array import array
from collections import Counter, defaultdict
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.logbook.errors import MADE_OF_FLIPPED_BITS, RecordingNotReadableError
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.rrd import chunk_row_ids, chunk_times
from ghal360_robot.messages import STILL, Cue

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from ghal360_robot.logbook.records import Tick

NS = 1e9

# Complaints repeat; the first ones tell.
MAX_COMPLAINTS = 20
MAX_BOOKMARKS = 300


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
class BookmarkReport:
    at_s: float
    """Seconds since the recording's first row."""
    holder: str
    note: str


@dataclass(frozen=True, slots=True)
class RecordingReport:
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
    bookmarks: tuple[BookmarkReport, ...]
    """The first few hundred."""
    complaints: tuple[str, ...]
    """Warnings and errors in the log, the first few."""

    def to_json(self) -> str:
        """One line; keys as the fields."""
        return json.dumps(asdict(self), ensure_ascii=False, allow_nan=False)


def inspect_run(path: Path) -> RecordingReport:
    """Read a run's folder or a single .rrd file and report on it.

    Raises:
        RecordingNotReadableError: there is nothing there that can be read.
    """
    with RunReader(path) as reader:
        try:
            return report(reader)
        except MADE_OF_FLIPPED_BITS as error:
            raise RecordingNotReadableError(f"{path} is damaged: some of its rows make no sense ({error}).") from error


def report(reader: RunReader) -> RecordingReport:
    entities, begin_ns, duration_s = _entities(reader)
    tally = _Tally()
    for tick in reader.ticks():
        tally.add(tick)
    return RecordingReport(
        run_id=reader.run_id,
        duration_s=duration_s,
        properties=dict(reader.properties),
        files=tuple(FileReport(part.path.name, part.path.stat().st_size) for part in reader.parts),
        entities=entities,
        video=_video(reader),
        missing_telegrams=_skipped(scan.telegram_counter for scan in reader.scans()),
        age_ms={name: _spread(ages) for name, ages in tally.age_ms.items() if ages},
        lateness_ms=_spread(tally.lateness_ms),
        work_ms=_spread(tally.work_ms),
        decisions=tally.decisions(_distance_m(reader)),
        bookmarks=tuple(itertools.islice(_bookmarks(reader, begin_ns), MAX_BOOKMARKS)),
        complaints=tuple(itertools.islice(_complaints(reader), MAX_COMPLAINTS)),
        damage=tuple(reader.damage),
    )


class _Tally:
    """What adds up over the ticks, one by one: a long run is never in memory as a whole."""

    def __init__(self) -> None:
        self.age_ms = {name: array("d") for name in ("base", "scan", "detections", "operator")}
        self.lateness_ms = array("d")
        self.work_ms = array("d")
        self._cues: Counter[str] = Counter()
        self._intentions: Counter[str] = Counter()
        self._cue_s: defaultdict[str, float] = defaultdict(float)
        self._armed_s: defaultdict[str, float] = defaultdict(float)
        self._stop_s: defaultdict[str, float] = defaultdict(float)
        self._ticks = 0
        self._missing = 0
        self._before: Tick | None = None

    def add(self, tick: Tick) -> None:
        self.lateness_ms.append(tick.lateness_ms)
        self.work_ms.append(tick.work_ms)
        seen = (tick.base_ns, tick.scan_ns, tick.detections_ns, tick.operator_ns)
        for ages, stamp_ns in zip(self.age_ms.values(), seen, strict=True):
            if stamp_ns is not None:
                ages.append((tick.stamp_ns - stamp_ns) / 1e6)
        self._onsets(tick, self._before)
        if self._before is not None:
            self._held(self._before, (tick.stamp_ns - self._before.stamp_ns) / NS)
            self._missing += max(0, tick.tick - self._before.tick - 1)
        self._ticks += 1
        self._before = tick

    def decisions(self, distance_m: float) -> DecisionReport:
        return DecisionReport(
            ticks=self._ticks,
            missing_ticks=self._missing,
            cues_shown=dict(self._cues),
            cue_s=_rounded(self._cue_s),
            intentions=dict(self._intentions),
            armed_s=_rounded(self._armed_s),
            distance_m=distance_m,
            stop_s=_rounded(self._stop_s),
        )

    def _onsets(self, tick: Tick, before: Tick | None) -> None:
        cue, intention = tick.decision.cue, tick.decision.intention
        if cue is not Cue.NONE and (before is None or before.decision.cue is not cue):
            self._cues[cue.value] += 1
        if intention is not None and (before is None or before.decision.intention != intention):
            self._intentions[str(intention)] += 1

    def _held(self, tick: Tick, seconds: float) -> None:
        """What `tick` decided held until the next one."""
        self._cue_s[tick.decision.cue.value] += seconds
        self._armed_s[tick.applied.arm.value] += seconds
        if tick.applied.twist == STILL and tick.decision.wanted != STILL:
            for reason in tick.applied.reasons or ("no reason given",):
                self._stop_s[reason] += seconds


def _rounded(seconds: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, 3) for name, value in seconds.items()}


def _complaints(reader: RunReader) -> Iterator[str]:
    return (f"{t.source}: {t.text}" for t in reader.texts() if t.level in ("WARN", "ERROR", "CRITICAL"))


def _bookmarks(reader: RunReader, begin_ns: int) -> Iterator[BookmarkReport]:
    for mark in reader.bookmarks():
        at_s = (reader.anchor.to_wall(mark.stamp_ns) - begin_ns) / NS
        yield BookmarkReport(round(at_s, 3), mark.holder, mark.note)


def _entities(reader: RunReader) -> tuple[tuple[EntityReport, ...], int, float]:
    """The reports, the stamp of the first row (wall clock), and the seconds from there to the last."""
    times: dict[str, list[NDArray[np.int64]]] = {}
    ids: dict[str, list[bytes]] = {}
    sizes: Counter[str] = Counter()
    for part in reader.parts:
        for chunk in part.chunks():
            stamps = chunk_times(chunk)
            if stamps is not None and len(stamps):
                entity = chunk.entity_path.lstrip("/")
                times.setdefault(entity, []).append(stamps)
                ids.setdefault(entity, []).extend(chunk_row_ids(chunk))
                sizes[entity] += chunk.to_record_batch().nbytes
    if not times:
        return (), 0, 0.0
    begin = min(int(stamps.min()) for chunks in times.values() for stamps in chunks)
    end = max(int(stamps.max()) for chunks in times.values() for stamps in chunks)
    reports = []
    for entity, chunks in sorted(times.items()):
        # A row whose components lie in several chunks is one row.
        _, first = np.unique(np.array(ids[entity], "V16"), return_index=True)
        stamps = np.sort(np.concatenate(chunks)[first])
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
    return tuple(reports), begin, (end - begin) / NS


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


def _distance_m(reader: RunReader) -> float:
    poses = (state.pose for state in reader.base_states())
    steps = (math.hypot(b.x - a.x, b.y - a.y) for a, b in itertools.pairwise(poses))
    return sum(step for step in steps if math.isfinite(step))
