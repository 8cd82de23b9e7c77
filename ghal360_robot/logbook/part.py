"""The file side of a run: numbered .rrd parts with their write-ahead logs, and whether they still take bytes."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from typing import TYPE_CHECKING

import rerun as rr
from rerun import unregister_shutdown

from ghal360_robot.logbook.blueprint import operator_blueprint
from ghal360_robot.logbook.encoding import chunk, identified
from ghal360_robot.logbook.errors import RecordingNotWritableError
from ghal360_robot.logbook.flusher import Flusher
from ghal360_robot.logbook.statics import log_statics
from ghal360_robot.logbook.wal import SUFFIX, WriteAheadLog

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    import pyarrow as pa  # type: ignore[import-untyped]

    from ghal360_robot.logbook.statics import Run

# The tick must always win: a flush by bytes of one entity cancels the next tick of all others
# (fact sheet rerun_and_style, A4, "batcher starvation").
FLUSH_TICK_S = 0.2
FLUSH_BYTES = 32 << 20


class PartFile:
    """Writes `part-NNN.rrd` and its log. Owned by the writer's thread once constructed."""

    def __init__(self, application_id: str, run: Run) -> None:
        self._application_id = application_id
        self._run = run
        self._begin_stream()
        self.number = -1
        self.path: Path
        self.opened_s = 0.0
        self._wal: WriteAheadLog | None = None
        self._held: int | None = None
        """Our own hold on the file: what somebody removes under our hands can be put back."""

    def open_next(self, folder: Path) -> None:
        """Finish the current part, if any, and begin the next in `folder` with everything static in it.

        Raises:
            RecordingNotWritableError: the file cannot be created, or takes nothing; the old part is finished.
        """
        number = self.number + 1
        path = folder / f"part-{number:03d}.rrd"
        wal: WriteAheadLog | None = None
        if self._flusher.stuck:
            unregister_shutdown()  # or the interpreter would wait for what never ends
            self._begin_stream()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            wal = WriteAheadLog(path.with_suffix(SUFFIX))
            self._begin_file(path)
            held = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except (RuntimeError, OSError, ValueError) as error:
            if wal is not None:
                wal.close(remove=True)
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
            raise RecordingNotWritableError(
                f"The recording {path} cannot be written ({error}): make room or choose another place."
            ) from error
        self._let_go()
        self.number, self.path, self._wal, self._held = number, path, wal, held
        self.opened_s = time.monotonic()

    def send(self, batch: pa.RecordBatch) -> None:
        """Hand a batch to Rerun; whether it arrived is for `death` to say. Raises ValueError for a bad batch."""
        self._stream.send_chunks(chunk(identified(batch)))

    def log_ahead(self, batches: Iterable[pa.RecordBatch]) -> str | None:
        """Keep rows safe until their chunk is written; why that failed, if it did."""
        try:
            if self._wal is not None:
                self._wal.append(batches)
        except OSError as error:
            return error.strerror or str(error)
        return None

    def forget_ahead(self) -> None:
        """Everything logged ahead has reached the part."""
        if self._wal is not None:
            with contextlib.suppress(OSError):  # rows found twice are known by their ids
                self._wal.clear()

    def death(self) -> str | None:
        """Push everything to the operating system; why the file's writer is gone, if it is."""
        return self._flusher.flush()

    @property
    def confirmed(self) -> bool:
        """Whether everything sent before the last `death` has reached the operating system."""
        return not self._flusher.pending

    @property
    def size(self) -> int:
        return 0 if self._held is None else os.fstat(self._held).st_size

    def removed(self) -> bool:
        """Whether the file was taken away while we write it; everything written since goes nowhere."""
        if self._held is None:
            return False
        try:
            return self.path.stat().st_ino != os.fstat(self._held).st_ino
        except OSError:
            return True

    def hold_of_removed(self) -> int | None:
        """Our hold on the current file, for `put_back`; the caller closes it."""
        return None if self._held is None else os.dup(self._held)

    def end(self) -> None:
        """Finish the current part and write nowhere until the next is opened."""
        self._disconnect()
        self._let_go()

    def close(self) -> str | None:
        """Write the footer; why that failed, if it did. The log stays where its rows have not all arrived."""
        reason = self.death()
        self._disconnect()
        self._flusher.close()
        if self._wal is not None:
            self._wal.close(remove=reason is None)
            self._wal = None
        self._let_go()
        return reason

    def _begin_file(self, path: Path) -> None:
        """Raises OSError, RuntimeError or ValueError where it takes nothing."""
        self._stream.save(path, default_blueprint=operator_blueprint())
        log_statics(self._stream, self._run)
        reason = self._flusher.flush()
        if reason is not None or self._flusher.pending:
            raise OSError(reason or "the disk does not answer")

    def _begin_stream(self) -> None:
        self._stream = rr.RecordingStream(
            self._application_id,
            recording_id=self._run.run_id,
            send_properties=False,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=FLUSH_TICK_S, flush_num_bytes=FLUSH_BYTES),
        )
        self._flusher = Flusher(self._stream)

    def _disconnect(self) -> None:
        if self._flusher.stuck:
            unregister_shutdown()
        else:
            self._stream.disconnect()

    def _let_go(self) -> None:
        if self._held is not None:
            os.close(self._held)
            self._held = None
        if self._wal is not None:
            self._wal.close(remove=True)
            self._wal = None


def put_back(held: int, path: Path) -> None:
    """Write a removed file again from our hold on it, which is closed. Raises OSError."""
    with open(held, "rb") as source:
        source.seek(0)
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as target:
            shutil.copyfileobj(source, target, 1 << 20)
