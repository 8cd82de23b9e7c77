"""A recording, read back as what was recorded: in time order, exactly, as far as the files go."""

from __future__ import annotations

import heapq
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ghal360_robot.logbook import row_values
from ghal360_robot.logbook.clock import Anchor
from ghal360_robot.logbook.errors import MADE_OF_FLIPPED_BITS, RecordingNotReadableError
from ghal360_robot.logbook.recovery import read_tail
from ghal360_robot.logbook.rrd import PartReader, chunk_rows, ordered_rows
from ghal360_robot.logbook.run_folder import files_of, read_meta
from ghal360_robot.logbook.tick_rows import read_ticks
from ghal360_robot.logbook.wal import SUFFIX

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from types import TracebackType
    from typing import Self

    from ghal360_robot.logbook.records import AccessUnit, CanFrame, Link, Map, Telegram, Text, Tick, Truth
    from ghal360_robot.logbook.row_values import Values
    from ghal360_robot.logbook.rrd import StoredRow
    from ghal360_robot.messages import BaseState, Bookmark, Detections, LidarScan, OperatorInput

T = TypeVar("T")

RUN_PROPERTY = "__properties/run"
ROBOT_PROPERTY = "__properties/robot"


class RunReader:
    """A run's folder, or a single .rrd file. Iterators are lazy: a long run never lies in memory.

    Raises:
        RecordingNotReadableError: there is nothing here that can be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parts: list[PartReader] = []
        self._unreadable: list[str] = []
        files, logs = _files(path)
        for file in files:
            try:
                self.parts.append(PartReader(file))
            except RecordingNotReadableError as error:
                self._unreadable.append(str(error))
        self.parts += [tail for log in logs if (tail := read_tail(log)) is not None]
        if not self.parts:
            raise RecordingNotReadableError(" ".join(self._unreadable))
        self.properties: dict[str, str] = {}
        self.run_id = ""
        self.config_json = ""
        self.anchor = self._read_properties()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        for part in self.parts:
            part.close()

    @property
    def damage(self) -> list[str]:
        """What is wrong with the files, in sentences. Damage inside a file shows once it has been read."""
        return self._unreadable + [sentence for part in self.parts for sentence in part.damage]

    @property
    def meta(self) -> dict[str, Any]:
        """The run's `meta.json`; empty for a single file or where it is missing or damaged."""
        return read_meta(self.path)

    def entities(self) -> list[str]:
        """Entities with temporal rows."""
        found = {chunk.entity_path.lstrip("/") for p in self.parts for chunk in p.chunks() if not chunk.is_static}
        return sorted(found)

    def rows(self, entity: str, from_ns: int | None = None, to_ns: int | None = None) -> Iterator[StoredRow]:
        """The raw rows of any entity, in time order; with stamps, those between them."""
        begin, end = (None if ns is None else self.anchor.to_wall(ns) for ns in (from_ns, to_ns))
        return ordered_rows(self.parts, entity, begin, end)

    def access_units(self, from_ns: int | None = None, to_ns: int | None = None) -> Iterator[AccessUnit]:
        """The video as received; with `from_ns`, from the last key picture on that is not later."""
        begin_ns = None if from_ns is None else self._key_before(from_ns)
        return self._read("theta/video", row_values.access_unit, begin_ns, to_ns)

    def detections(self) -> Iterator[Detections]:
        return self._read("theta/objects", row_values.detections)

    def telegrams(self) -> Iterator[Telegram]:
        return self._read("lidar/raw", row_values.telegram)

    def scans(self) -> Iterator[LidarScan]:
        return self._read("lidar/scan", row_values.Scans())

    def can_frames(self) -> Iterator[CanFrame]:
        """Both directions, merged by time."""
        both = (self._read(f"can/{way}", partial(row_values.can_frame, way)) for way in ("rx", "tx"))
        return heapq.merge(*both, key=lambda frame: frame.stamp_ns)

    def base_states(self) -> Iterator[BaseState]:
        return self._read("base/state", row_values.BaseStates())

    def operator_inputs(self) -> Iterator[OperatorInput]:
        return self._read("operator/command", row_values.OperatorInputs())

    def links(self) -> Iterator[Link]:
        """Every device's link, merged by time; the counts are as of that moment."""
        devices = [e.removeprefix("state/") for e in self.entities() if e.startswith("state/")]
        links = (
            self._read(f"state/{device}", partial(row_values.link, device))
            for device in devices
            if device not in ("arm", "base")
        )
        return heapq.merge(*links, key=lambda link: link.stamp_ns)

    def texts(self) -> Iterator[Text]:
        """Everything under `log/`, merged by time."""
        sources = [e for e in self.entities() if e.startswith("log/")]
        texts = (self._read(source, partial(row_values.text, source.removeprefix("log/"))) for source in sources)
        return heapq.merge(*texts, key=lambda text: text.stamp_ns)

    def bookmarks(self) -> Iterator[Bookmark]:
        return self._read("log/bookmark", row_values.bookmark)

    def truths(self) -> Iterator[Truth]:
        return self._read("sim/truth", row_values.truth)

    def maps(self, entity: str = "world/map") -> Iterator[Map]:
        """The floor as the robot came to know it, or, as `sim/map`, as it is in the simulation."""
        return self._read(entity, row_values.grid_map)

    def ticks(self) -> Iterator[Tick]:
        """Every whole tick. A torn end never shows a tick with another tick's decision."""
        return read_ticks(self.rows, self.anchor, self._complain)

    def _complain(self, sentence: str) -> None:
        if sentence not in self._unreadable:
            self._unreadable.append(sentence)

    def _key_before(self, stamp_ns: int) -> int:
        keys = (
            self._stamp(row)
            for part in self.parts
            for chunk in part.chunks("theta/video", ["VideoStream:is_keyframe"])
            for row in chunk_rows(chunk)
            if "VideoStream:is_keyframe" in row.values
        )
        return max((key for key in keys if key <= stamp_ns), default=stamp_ns)

    def _read(
        self, entity: str, make: Callable[[int, Values], T], from_ns: int | None = None, to_ns: int | None = None
    ) -> Iterator[T]:
        """What each row of an entity says. One that flipped bits made senseless is left out; `damage` tells so."""
        told = False
        for row in self.rows(entity, from_ns, to_ns):
            try:
                made = make(self._stamp(row), row.values)
            except MADE_OF_FLIPPED_BITS as error:
                if not told:
                    self._complain(f"A row of {entity} makes no sense and is left out, perhaps others too ({error}).")
                told = True
                continue
            yield made

    def _stamp(self, row: StoredRow) -> int:
        return self.anchor.to_monotonic(row.t_ns)

    def _read_properties(self) -> Anchor:
        anchor = Anchor(0, 0)
        for part in self.parts:
            for chunk in part.chunks(RUN_PROPERTY):
                for row in chunk_rows(chunk):
                    self.run_id = row.values["Run:run_id"][0]
                    self.config_json = row.values.get("Run:config_json", [""])[0]
                    anchor = Anchor(int(row.values["Run:monotonic_ns"][0]), int(row.values["Run:wall_ns"][0]))
            for chunk in part.chunks(ROBOT_PROPERTY):
                for row in chunk_rows(chunk):
                    for name, value in row.values.items():
                        self.properties[name.removeprefix("Robot:")] = value[0]
        if anchor == Anchor(0, 0):
            self._unreadable.append(f"{self.path} does not say how its robot's clock ran: stamps are wall-clock time.")
        return anchor


def _files(path: Path) -> tuple[list[Path], list[Path]]:
    """The parts of a run, wherever they were written, and the logs ahead of parts that were not ended properly."""
    if path.is_file():
        return [path], []
    if not path.is_dir():
        raise RecordingNotReadableError(f"There is no recording at {path}.")
    files = files_of(path, ".rrd")
    if not files:
        raise RecordingNotReadableError(f"{path} holds no recording: there is no part-*.rrd in it.")
    here = {file.parent for file in files}
    return files, [log for log in files_of(path, SUFFIX) if log.parent in here]
