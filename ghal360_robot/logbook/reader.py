"""A recording, read back as what was recorded: in time order, exactly, as far as the files go."""

from __future__ import annotations

import heapq
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.logbook import scan_values
from ghal360_robot.logbook.clock import Anchor
from ghal360_robot.logbook.errors import RecordingNotReadableError
from ghal360_robot.logbook.records import AccessUnit, CanFrame, Link, Map, Telegram, Text, Truth
from ghal360_robot.logbook.recovery import read_tail
from ghal360_robot.logbook.rrd import PartReader, chunk_rows, ordered_rows
from ghal360_robot.logbook.run_folder import files_of, read_meta
from ghal360_robot.logbook.tick_rows import read_ticks
from ghal360_robot.logbook.wal import SUFFIX
from ghal360_robot.messages import (
    BaseMode,
    BaseState,
    Bookmark,
    Detection,
    Detections,
    HeadPose,
    LidarScan,
    LinkStats,
    OperatorInput,
    Pose2,
    Twist,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import TracebackType
    from typing import Self

    from ghal360_robot.logbook.records import Tick
    from ghal360_robot.logbook.rrd import StoredRow

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
        for row in self.rows("theta/video", begin_ns, to_ns):
            values = row.values
            yield AccessUnit(
                self._stamp(row),
                values["VideoStream:sample"][0],
                bool(values.get("VideoStream:is_keyframe", [False])[0]),
                int(values["AccessUnit:sequence"][0]),
                bool(values["AccessUnit:tainted"][0]),
                int(values["AccessUnit:latency_ns"][0]),
            )

    def detections(self) -> Iterator[Detections]:
        for row in self.rows("theta/objects"):
            names = row.values["Detections:names"]
            numbers = row.values["Detections:values"].reshape(-1, 5).tolist()
            objects = tuple(Detection(name, *five) for name, five in zip(names, numbers, strict=True))
            picture = int(row.values["Detections:picture"][0])
            yield Detections(self._stamp(row), picture, row.values["Detections:detector"][0], objects)

    def telegrams(self) -> Iterator[Telegram]:
        for row in self.rows("lidar/raw"):
            yield Telegram(self._stamp(row), row.values["Telegram:bytes"].tobytes())

    def scans(self) -> Iterator[LidarScan]:
        yaw = np.empty(0, np.float32)
        for row in self.rows("lidar/scan"):
            values = row.values
            yaw = values.get("LidarScan:yaw", yaw)
            whole = values.get("LidarScan:ranges_mm")
            ranges = values["LidarScan:ranges_m"] if whole is None else scan_values.metres(whole)
            rssi = next(
                (
                    values[name]
                    for name in ("LidarScan:rssi_u8", "LidarScan:rssi_u16", "LidarScan:rssi")
                    if name in values
                ),
                None,
            )
            scan_counter, telegram_counter, device_time_us = values["LidarScan:counters"].tolist()
            yield LidarScan(
                self._stamp(row),
                ranges,
                yaw,
                scan_counter,
                telegram_counter,
                device_time_us,
                bool(values["LidarScan:device_ok"][0]),
                None if rssi is None else rssi.astype(np.float32),
            )

    def can_frames(self) -> Iterator[CanFrame]:
        """Both directions, merged by time."""
        return heapq.merge(self._can("rx"), self._can("tx"), key=lambda frame: frame.stamp_ns)

    def base_states(self) -> Iterator[BaseState]:
        mode = BaseMode.UNKNOWN
        faults: tuple[str, ...] = ()
        warnings: tuple[str, ...] = ()
        temperature: float | None = None
        covariance = [0.0] * 6
        for row in self.rows("base/state"):
            values = row.values
            if "BaseState:mode" in values:
                mode = BaseMode(values["BaseState:mode"][0])
            if "BaseState:faults" in values:
                faults = tuple(values["BaseState:faults"])
            if "BaseState:warnings" in values:
                warnings = tuple(values["BaseState:warnings"])
            if "BaseState:temperature_degc" in values:
                temperature = next(iter(values["BaseState:temperature_degc"].tolist()), None)
            if "BaseState:covariance" in values:
                covariance = values["BaseState:covariance"].tolist()
            v, w, battery = values["Scalars:scalars"].tolist()
            pose = Pose2(*values["BaseState:pose"].tolist())
            xx, xy, x_yaw, yy, y_yaw, yaw_yaw = covariance
            yield BaseState(
                self._stamp(row),
                mode,
                pose,
                Twist(v, w),
                battery,
                faults,
                temperature,
                (xx, xy, x_yaw, yy, y_yaw, yaw_yaw),
                warnings,
            )

    def operator_inputs(self) -> Iterator[OperatorInput]:
        holder, latency_s = "", 0.0
        for row in self.rows("operator/command"):
            values = row.values
            holder = values.get("OperatorInput:holder", [holder])[0]
            latency_s = float(values.get("OperatorInput:latency_s", [latency_s])[0])
            stick = values["OperatorInput:stick"].tolist()
            arm, disarm, estop, found = values["OperatorInput:presses"].tolist()
            yield OperatorInput(
                self._stamp(row),
                HeadPose(*values["OperatorInput:head"].tolist()),
                bool(values["OperatorInput:deadman"][0]),
                Twist(*stick) if stick else None,
                arm,
                disarm,
                estop,
                found,
                holder,
                latency_s,
            )

    def links(self) -> Iterator[Link]:
        """Every device's link, merged by time; the counts are as of that moment."""
        devices = [e.removeprefix("state/") for e in self.entities() if e.startswith("state/")]
        return heapq.merge(
            *(self._link(device) for device in devices if device not in ("arm", "base")),
            key=lambda link: link.stamp_ns,
        )

    def texts(self) -> Iterator[Text]:
        """Everything under `log/`, merged by time."""
        sources = [e for e in self.entities() if e.startswith("log/")]
        return heapq.merge(*map(self._texts, sources), key=lambda text: text.stamp_ns)

    def bookmarks(self) -> Iterator[Bookmark]:
        for row in self.rows("log/bookmark"):
            yield Bookmark(self._stamp(row), row.values["Bookmark:holder"][0], row.values["Bookmark:note"][0])

    def truths(self) -> Iterator[Truth]:
        for row in self.rows("sim/truth"):
            yield Truth(self._stamp(row), Pose2(*row.values["Truth:pose"].tolist()))

    def maps(self, entity: str = "world/map") -> Iterator[Map]:
        """The floor as the robot came to know it, or, as `sim/map`, as it is in the simulation."""
        for row in self.rows(entity):
            values = row.values
            shape = values["GridMap:format"][0]
            cells = np.frombuffer(values["GridMap:data"][0], np.uint8).reshape(shape["height"], shape["width"])
            yield Map(
                self._stamp(row),
                cells,
                float(values["Map:resolution_m"][0]),
                Pose2(*values["Map:origin"].tolist()),
            )

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

    def _can(self, direction: str) -> Iterator[CanFrame]:
        for row in self.rows(f"can/{direction}"):
            can_id = int(row.values["CanFrame:id"][0])
            yield CanFrame(self._stamp(row), direction, can_id, row.values["CanFrame:data"].tobytes())

    def _texts(self, entity: str) -> Iterator[Text]:
        for row in self.rows(entity):
            level, text = row.values["TextLog:level"][0], row.values["TextLog:text"][0]
            yield Text(self._stamp(row), entity.removeprefix("log/"), level, text)

    def _link(self, device: str) -> Iterator[Link]:
        for row in self.rows(f"state/{device}"):
            values = row.values
            last = values["LinkStats:last_ns"].tolist()
            received, lost, damaged, reconnects = values["LinkStats:counts"].tolist()
            stats = LinkStats(
                values["LinkStats:link"][0],
                values["LinkStats:detail"][0],
                received,
                lost,
                damaged,
                reconnects,
                float(values["LinkStats:rate_hz"][0]),
                last[0] if last else None,
                values["LinkStats:condition"][0] if "LinkStats:condition" in values else "",
            )
            yield Link(self._stamp(row), device, stats)

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
