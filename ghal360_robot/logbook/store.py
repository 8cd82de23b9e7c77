"""Where batches go: into the current part, into the log ahead of it, or into memory while no disk takes bytes."""

from __future__ import annotations

import logging
import time
from collections import defaultdict
from typing import TYPE_CHECKING

from ghal360_robot.logbook import entities
from ghal360_robot.logbook.disk import Disk, Level, look_at, takes_bytes
from ghal360_robot.logbook.encoding import joined
from ghal360_robot.logbook.errors import RecordingNotWritableError
from ghal360_robot.logbook.part import PartFile, put_back
from ghal360_robot.logbook.video_ring import PRE_TRIGGER_S, VideoRing

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    import pyarrow as pa  # type: ignore[import-untyped]

    from ghal360_robot.logbook.settings import RecorderSettings
    from ghal360_robot.logbook.table import Table

# Ten minutes of everything but pictures, for a disk that takes nothing.
MAX_PENDING_BYTES = 64 << 20

# Without pictures there is no key picture to wait for.
NO_PICTURE_S = 5.0

WORSE_THAN_LOW = Level.NO_VIDEO


class Store:
    """Owned by the writer's thread. `say` tells log and operator; `anew` asks for self-contained rows from here on."""

    def __init__(
        self,
        part: PartFile,
        folders: Sequence[Path],
        settings: RecorderSettings,
        *,
        prepare: Callable[[Path], None],
        say: Callable[[int, str], None],
        anew: Callable[[], None],
    ) -> None:
        self._part = part
        self._settings = settings
        self._prepare = prepare
        self._say = say
        self._anew = anew
        self._disks = [look_at(folder, settings.watermarks) for folder in folders]
        self._here = 0
        self._pending: defaultdict[Table, list[pa.RecordBatch]] = defaultdict(list)
        self._pending_bytes = 0
        self._ahead: list[pa.RecordBatch] = []
        self._unconfirmed: list[pa.RecordBatch] = []
        """Handed to Rerun since the last flush that succeeded."""
        self._ring = VideoRing()
        self._video_s = 0.0
        self._video_until_s = 0.0
        self.closed_because = ""
        """Why nothing is being written; empty while all is well."""
        self.reopened = 0
        self.dropped_rest = 0
        self._open_best()

    @property
    def is_open(self) -> bool:
        return not self.closed_because

    @property
    def dropped_video(self) -> int:
        """Access units that should be in the recording and are not."""
        return self._ring.let_go if self._settings.video_always else 0

    @property
    def not_recorded(self) -> tuple[str, ...]:
        """What is missing from the recording at present, and why."""
        if not self.is_open:
            return (f"nothing is recorded: {self.closed_because}",)
        disk = self._disks[self._here]
        if disk.level >= Level.NO_VIDEO and not self._wants_video():
            return (f"video is not recorded: only {disk.free_text} left in {disk.directory.parent}",)
        return ()

    def put(self, table: Table, batch: pa.RecordBatch) -> None:
        if table is entities.THETA_VIDEO:
            self._put_video(batch)
        elif table.direct:
            self._send(batch)
        elif self._pending_bytes + batch.nbytes > MAX_PENDING_BYTES:
            self.dropped_rest += batch.num_rows
        else:
            self._pending[table].append(batch)
            self._pending_bytes += batch.nbytes
            self._ahead.append(batch)

    def settle(self) -> bool:
        """Whether what was put is safe from a kill now; where the disk did not take it, it is kept."""
        if not self.is_open:
            return False
        reason = self._part.log_ahead(self._ahead) or self._part.death()
        if reason is not None:
            self._died(reason)
            return False
        if self._part.removed():
            self._restore()
            return False
        self._ahead.clear()
        if self._part.confirmed:
            self._unconfirmed.clear()
        return True

    def merge(self) -> bool:
        """Write what waits as one chunk for each table. That takes long: the newest is made safe first."""
        if not self.settle():
            return False
        for table in sorted(self._pending, key=lambda table: table is entities.LOOP_INPUTS):
            if self._pending[table]:
                self._part.send(joined(self._pending[table]))
        if not self.settle():
            return False
        if self._part.confirmed:  # or it is written again the next time: rows found twice are known by their ids
            self._pending.clear()
            self._pending_bytes = 0
            self._part.forget_ahead()
        return True

    def look(self) -> None:
        """Once a second: how the disks are, and whether another one would be better."""
        before = [disk.level for disk in self._disks]
        self._disks = [
            look_at(disk.directory, self._settings.watermarks, level)
            for disk, level in zip(self._disks, before, strict=True)
        ]
        if not self.is_open:
            self._open_best()
            return
        here = self._disks[self._here]
        if here.level is not before[self._here]:
            self._say_level(here)
        best = self._best()
        if best != self._here and self._disks[best].level < WORSE_THAN_LOW <= here.level:
            self._say(logging.WARNING, f"The recording goes on in {self._disks[best].directory}.")
            self._rotate()
        elif here.level >= Level.STOP:
            self._stop(here)
        elif self._is_due(1.1) and time.monotonic() - self._video_s > NO_PICTURE_S:
            self._rotate()

    def bookmark(self) -> None:
        """Pictures from half a minute ago until half a minute from now are wanted."""
        self._video_until_s = time.monotonic() + PRE_TRIGGER_S

    def close(self) -> str | None:
        """Write everything and the footer; why that failed, if it did."""
        if not self.merge():
            self.merge()  # where the file had died or gone, what waits goes into the next one
        if not self.is_open:
            self._part.close()
            return self.closed_because
        return self._part.close()

    def _put_video(self, batch: pa.RecordBatch) -> None:
        now_s = time.monotonic()
        self._video_s = now_s
        key = batch.column(batch.schema.names.index(entities.KEYFRAME_COLUMN))[0].is_valid
        if key and self.is_open and self._is_due(1.0):
            self._rotate()
        if self.is_open and self._wants_video():
            for earlier in self._ring.take():
                self._send(earlier)
            self._send(batch)
        else:
            self._ring.add(batch, key=key, now_s=now_s, owed=not self.is_open and self._settings.video_always)

    def _wants_video(self) -> bool:
        if time.monotonic() < self._video_until_s:
            return True
        return self._settings.video_always and self._disks[self._here].level < Level.NO_VIDEO

    def _send(self, batch: pa.RecordBatch) -> None:
        self._unconfirmed.append(batch)
        if self.is_open:
            self._part.send(batch)

    def _is_due(self, grace: float) -> bool:
        settings = self._settings
        age_s = time.monotonic() - self._part.opened_s
        return age_s > settings.part_s * grace or self._part.size > settings.part_bytes * grace

    def _rotate(self) -> None:
        self.merge()
        if self.is_open and not self._open(self._best()):
            self._part.end()

    def _stop(self, disk: Disk) -> None:
        """End the part properly while there is still room for its footer."""
        self.merge()
        if self.is_open:
            self._part.end()
            self.closed_because = f"only {disk.free_text} left in {disk.directory.parent}; make room and it goes on"
            self._say(logging.ERROR, f"Nothing is recorded any more: {self.closed_because}.")

    def _died(self, reason: str) -> None:
        self.closed_because = (
            f"{self._part.path} does not take any more ({reason}), the disk is probably full or gone; "
            "make room and it goes on in a new part"
        )
        self._say(logging.ERROR, f"Nothing is recorded any more: {self.closed_because}.")
        self._open_best()

    def _restore(self) -> None:
        """Somebody removed the file we write: go on in a new one, and put the old one back."""
        path, held = self._part.path, self._part.hold_of_removed()
        if not self._open(self._here) and not self._open(self._best()):
            return
        try:
            if held is not None:
                put_back(held, path)
            self._say(logging.WARNING, f"Somebody removed {path} while it was being written; it has been put back.")
        except OSError as error:
            self._say(logging.ERROR, f"Somebody removed {path}, and it cannot be put back ({error.strerror}).")

    def _best(self) -> int:
        """The first place where everything can be written, or else where the most can."""
        return min(range(len(self._disks)), key=lambda k: (max(self._disks[k].level, Level.LOW), k))

    def _open_best(self) -> None:
        """The best place that really takes bytes, if there is one."""
        order = sorted(range(len(self._disks)), key=lambda k: (max(self._disks[k].level, Level.LOW), k))
        for k in order:
            disk = self._disks[k]
            if disk.level < Level.STOP and takes_bytes(disk.directory) and self._open(k):
                return
        if not self.closed_because:
            disk = self._disks[0]
            self.closed_because = f"{disk.directory.parent} has {disk.free_text} left; make room and it begins"

    def _open(self, k: int) -> bool:
        """Begin the next part at place `k` and hand it everything that has not safely arrived anywhere."""
        folder = self._disks[k].directory
        try:
            self._prepare(folder)
            self._part.open_next(folder)
        except (RecordingNotWritableError, OSError) as error:
            self.closed_because = str(error)
            return False
        if self.closed_because and self._part.number > 0:
            self.reopened += 1
            self._say(logging.WARNING, f"The recording goes on in {self._part.path}.")
        self._here, self.closed_because = k, ""
        owed, self._unconfirmed = self._unconfirmed, []
        for batch in owed:
            self._send(batch)
        self._ahead = [batch for batches in self._pending.values() for batch in batches]
        self._anew()
        return True

    def _say_level(self, disk: Disk) -> None:
        what = {
            Level.FINE: (logging.INFO, "there is room again"),
            Level.LOW: (logging.WARNING, "make room soon"),
            Level.NO_VIDEO: (logging.ERROR, "video is not recorded any more, everything else is"),
        }.get(disk.level)
        if what is not None:
            level, sentence = what
            self._say(level, f"{disk.free_text} left for recordings in {disk.directory.parent}: {sentence}.")
