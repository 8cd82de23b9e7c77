"""What the rest of the robot calls to have something logged: typed, from any thread, never waiting."""

from __future__ import annotations

import contextlib
import itertools
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import TYPE_CHECKING, Literal

from rerun import unregister_shutdown

from ghal360_robot.logbook import entities, rows, run_folder
from ghal360_robot.logbook.clock import Anchor
from ghal360_robot.logbook.live_feed import LiveFeed
from ghal360_robot.logbook.mailbox import MAX_BYTES, MAX_ENTRIES, Entry, Mailbox
from ghal360_robot.logbook.part import PartFile
from ghal360_robot.logbook.settings import RecorderSettings
from ghal360_robot.logbook.statics import APPLICATION_ID, Mount, Run
from ghal360_robot.logbook.store import Store
from ghal360_robot.logbook.tick_drawing import TickRows
from ghal360_robot.logbook.writer import Writer
from ghal360_robot.messages import ArmState, Bookmark
from ghal360_robot.perception.panorama import CameraView

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    import numpy as np
    from numpy.typing import NDArray

    from ghal360_robot.logbook.live_feed import LiveStats
    from ghal360_robot.logbook.settings import LiveSettings
    from ghal360_robot.logbook.table import Row
    from ghal360_robot.messages import (
        Applied,
        BaseState,
        Decision,
        Detections,
        Inputs,
        LidarScan,
        LinkStats,
        OperatorInput,
        Pose2,
        Received,
    )

# systemd and the person at the robot both wait for this one, and for the interpreter after it: three seconds in all.
CLOSE_TIMEOUT_S = 2.0

ROBOT = "robot"
"""Who sets the bookmarks that nobody sets."""

# What meta.json lists; the recording has all of them.
MAX_BOOKMARKS = 100
MAX_NAME = 64
MAX_NOTE = 200


@dataclass(frozen=True, slots=True)
class RecorderStats:
    """How the recording is doing."""

    part: str
    """Name of the file being written."""
    written: int
    """Rows handed on to the file; what is unchanged is not handed on."""
    queued: int
    queued_bytes: int
    dropped_video: int
    """Access units that are missing because disk or writer could not take them; video goes first."""
    dropped_rest: int
    failed_rows: int
    """Rows that could not be logged; `log/logbook` says which."""
    failed: str | None
    """Why nothing is being written at present; None when all is well."""
    not_recorded: tuple[str, ...]
    """What is missing from the recording at present, and why, in sentences for the person at the robot."""
    reopened: int
    """How often a new part was begun after the file had died."""
    writer_cpu_s: float
    live: LiveStats | None
    """The live view's feed, where there is one."""


@dataclass(frozen=True, slots=True)
class BookmarkEntry:
    """A bookmark as meta.json lists it."""

    stamp_ns: int
    wall: str
    holder: str
    note: str
    part: str


class Recorder:
    """One run's recording: `<directory>/<run_id>/part-000.rrd` and `meta.json`.

    Stamps are `time.monotonic_ns()`; the file has wall-clock time, through one anchor taken here.
    All methods but `close` only queue what they are given, which must not be changed afterwards.

    Raises:
        RecordingNotWritableError: the directory cannot be written.
    """

    def __init__(
        self,
        directory: Path,
        *,
        run_id: str | None = None,
        application_id: str = APPLICATION_ID,
        properties: Mapping[str, str],
        config_json: str,
        calibration_json: str = "{}",
        mounts: Mapping[str, Mount] | None = None,
        settings: RecorderSettings | None = None,
        live: LiveSettings | None = None,
        max_bytes: int = MAX_BYTES,
        max_entries: int = MAX_ENTRIES,
    ) -> None:
        self.anchor = Anchor.now()
        if mounts is None:
            mounts = {"lidar": Mount(), "theta": Mount()}
        self.run_id = run_id or run_folder.new_run_id(self.anchor.wall_ns)
        self._run = Run(self.run_id, self.anchor, config_json, dict(properties), dict(mounts), calibration_json)
        settings = settings or RecorderSettings()
        second = [] if settings.second_directory is None else [settings.second_directory]
        self._folders = run_folder.create([directory, *second], self._run)
        self.folder = directory / self.run_id
        camera = mounts.get("theta", Mount())
        self._camera = CameraView(camera.yaw, camera.pitch, camera.roll)
        self._part = PartFile(application_id, self._run)
        self._mailbox: Mailbox[Entry] = Mailbox(max_bytes, max_entries)
        self._live = None if live is None else LiveFeed(live, self._run)
        self._bookmarks: list[BookmarkEntry] = []
        self._estop = False
        self._tick_rows = TickRows(mounts)

        def open_store(writer: Writer) -> Store:
            return Store(
                self._part,
                self._folders,
                settings,
                prepare=self._prepare,
                say=writer.say,
                anew=writer.batches.begin_anew,
            )

        self._writer = Writer(self._mailbox, self.anchor, open_store, self._live)
        self._base_states = itertools.count()
        if self._live is not None:
            self._live.start()
        self._writer.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def stats(self) -> RecorderStats:
        mailbox, writer = self._mailbox, self._writer
        store = writer.store
        return RecorderStats(
            part=self._part.path.name if self._part.number >= 0 else "",
            written=writer.batches.given,
            queued=len(mailbox),
            queued_bytes=mailbox.bytes,
            dropped_video=mailbox.dropped_video + store.dropped_video,
            dropped_rest=mailbox.dropped_rest + store.dropped_rest,
            failed_rows=writer.batches.failed,
            failed=writer.failed or store.closed_because or None,
            not_recorded=store.not_recorded if writer.failed is None else (writer.failed,),
            reopened=store.reopened,
            writer_cpu_s=writer.cpu_s,
            live=None if self._live is None else self._live.stats(),
        )

    @property
    def bookmarks(self) -> tuple[BookmarkEntry, ...]:
        """The first hundred."""
        return tuple(self._bookmarks)

    def bookmark(self, mark: Bookmark) -> None:
        """Mark a moment: named in log and meta.json, with pictures from 30 s before to 30 s after it."""
        mark = Bookmark(mark.stamp_ns, mark.holder[:MAX_NAME], mark.note[:MAX_NOTE])
        self._put("log/bookmark", partial(rows.bookmark, mark), len(mark.note))
        self._writer.store.bookmark()
        if len(self._bookmarks) < MAX_BOOKMARKS:
            wall = datetime.fromtimestamp(self.anchor.to_wall(mark.stamp_ns) / 1e9, UTC)
            told = wall.isoformat(timespec="milliseconds"), mark.holder, mark.note, self.stats.part
            self._bookmarks.append(BookmarkEntry(mark.stamp_ns, *told))

    def access_unit(self, stamp_ns: int, data: bytes, sequence: int, keyframe: bool, tainted: bool) -> None:
        """One H.264 access unit as received (Annex B); `keyframe` only for an IDR that brings its SPS.

        `stamp_ns` is the camera's instant; what has passed since is logged as the unit's latency.
        """
        latency_ns = time.monotonic_ns() - stamp_ns
        make = partial(rows.access_unit, stamp_ns, data, sequence, keyframe, tainted, latency_ns)
        self._put("theta/video", make, len(data), video=True, keyframe=keyframe)

    def detections(self, found: Detections) -> None:
        self._put("theta/objects", partial(rows.detections, found, self._camera))

    def lidar_telegram(self, stamp_ns: int, data: bytes) -> None:
        """One telegram as received, framing included."""
        self._put("lidar/raw", partial(rows.lidar_telegram, stamp_ns, data), len(data))

    def lidar_scan(self, scan: LidarScan) -> None:
        size = scan.ranges.nbytes + scan.yaw.nbytes + (scan.rssi.nbytes if scan.rssi is not None else 0)
        self._put("lidar/scan", partial(rows.lidar_scan, scan), size)

    def can_frame(self, stamp_ns: int, direction: Literal["rx", "tx"], can_id: int, data: bytes) -> None:
        self._put(f"can/{direction}", partial(rows.can_frame, stamp_ns, direction, can_id, data), len(data))

    def base_state(self, state: BaseState) -> None:
        self._put("base/state", partial(rows.base_state, state, next(self._base_states)))

    def operator(self, message: OperatorInput) -> None:
        """A message of the operator that the robot took in; refused ones go to `operator_refused`."""
        self._put("operator/command", partial(rows.operator, message))

    def operator_refused(self, stamp_ns: int, holder: object, reason: str) -> None:
        """A message that was not taken in: who claims to have sent it, and why it was refused."""
        self._put("operator/refused", partial(rows.operator_refused, stamp_ns, str(holder)[:MAX_NAME], reason))

    def received(self, wish: Received) -> None:
        """A wish of a remote operator as it came in, counted or not."""
        self._put("operator/received", partial(rows.received, wish))

    def tick(self, inputs: Inputs, decision: Decision, applied: Applied, lateness_ms: float, work_ms: float) -> None:
        """What one control tick saw, decided and did, and how late it was. An emergency stop is a bookmark."""
        self._put("loop/inputs", partial(self._tick_rows.rows, inputs, decision, applied, lateness_ms, work_ms))
        stopped = applied.arm is ArmState.ESTOP
        if stopped and not self._estop:
            self.bookmark(Bookmark(inputs.stamp_ns, ROBOT, "emergency stop: " + ", ".join(applied.reasons)))
        self._estop = stopped

    def link(self, device: str, stats: LinkStats) -> None:
        """How a device is doing now; about once a second and on every change."""
        self._put(f"state/{device}", partial(rows.link, time.monotonic_ns(), device, stats))

    def truth(self, stamp_ns: int, pose: Pose2, target: tuple[float, float] | None = None) -> None:
        """Where the simulated robot really is, and its target, in the simulated world."""
        self._put("sim/truth", partial(rows.truth, stamp_ns, pose, target))

    def true_map(self, stamp_ns: int, cells: NDArray[np.uint8], resolution_m: float, origin: Pose2) -> None:
        """The floor of the simulated world: `cells` (rows, columns) uint8; `origin` is its lower left corner's pose.

        Once is not enough: every part and every viewer that comes late should have it. Repeats cost nothing.
        """
        make = partial(rows.grid_map, entities.SIM_MAP, stamp_ns, cells, resolution_m, origin)
        self._put("sim/map", make, cells.nbytes)

    def text(self, stamp_ns: int, source: str, level: str, text: str) -> None:
        """A line for people, `level` as in Rerun: TRACE, DEBUG, INFO, WARN, ERROR, CRITICAL."""
        self._put(entities.log_table(source).entity, partial(rows.text, stamp_ns, source, level, text), len(text))

    def close(self, timeout_s: float | None = None) -> bool:
        """Write what waits and end the file properly; False where that did not succeed in time.

        Takes `timeout_s` at most (CLOSE_TIMEOUT_S without), the live view's end included: that one is not waited
        for where time runs out.
        """
        timeout_s = CLOSE_TIMEOUT_S if timeout_s is None else timeout_s
        until_s = time.monotonic() + timeout_s
        self._mailbox.close()
        if self._live is not None:
            self._live.abandon()
        if not self._writer.stop(timeout_s):
            unregister_shutdown()  # or the interpreter would wait for a disk that does not answer
            return False
        self._write_ending()
        if self._live is not None:
            self._live.join(until_s - time.monotonic())
        return self._writer.failed is None

    def _prepare(self, folder: Path) -> None:
        """Make a folder of this run where there is none yet, or none any more. Raises OSError."""
        if not (folder / run_folder.META).exists():
            folder.mkdir(parents=True, exist_ok=True)
            run_folder.write_meta(folder, run_folder.meta(self._run, self._folders))

    def _write_ending(self) -> None:
        ending = run_folder.ending(self._run, self.stats, self._bookmarks)
        for folder in self._folders:
            content = run_folder.read_meta(folder)
            if content and "ended" not in content:
                with contextlib.suppress(OSError):  # said already: nothing can be written here
                    run_folder.write_meta(folder, content | ending, sync=False)

    def _put(
        self,
        entity: str,
        make: Callable[[], Iterable[Row]],
        size: int = 0,
        *,
        video: bool = False,
        keyframe: bool = False,
    ) -> None:
        self._mailbox.put(Entry(entity, make, size, video, keyframe))
