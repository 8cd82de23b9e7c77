"""The file side of a run: numbered .rrd parts, and whether the current one still takes bytes."""

from __future__ import annotations

import os
import shutil
from typing import TYPE_CHECKING

import rerun as rr

from ghal360_robot.logbook.blueprint import operator_blueprint
from ghal360_robot.logbook.errors import RecordingNotWritableError
from ghal360_robot.logbook.statics import log_statics

if TYPE_CHECKING:
    from pathlib import Path

    from ghal360_robot.logbook.statics import Run

# The tick must always win: a flush by bytes of one entity cancels the next tick of all others
# (fact sheet rerun_and_style, A4, "batcher starvation").
FLUSH_TICK_S = 0.2
FLUSH_BYTES = 32 << 20

# A healthy writer answers a flush in about a millisecond; a slow disk may take longer, a dead one raises.
PROBE_TIMEOUT_S = 0.5

# Below this a new part would die at once, and the system with it.
MIN_FREE_BYTES = 16 << 20

# A trial this long does not fit into the last corner of a full disk.
TRIAL_BYTES = 1 << 20


class PartFile:
    """Writes `part-NNN.rrd` in `folder`. Owned by the writer's thread once constructed."""

    def __init__(self, folder: Path, application_id: str, run: Run) -> None:
        self._folder = folder
        self._run = run
        self.number = -1
        self.stream = rr.RecordingStream(
            application_id,
            recording_id=run.run_id,
            send_properties=False,
            batcher_config=rr.ChunkBatcherConfig(flush_tick=FLUSH_TICK_S, flush_num_bytes=FLUSH_BYTES),
        )
        self.open_next()

    @property
    def path(self) -> Path:
        return self._folder / f"part-{self.number:03d}.rrd"

    def open_next(self) -> None:
        """Finish the current part, if any, and begin the next with everything static in it.

        Raises:
            RecordingNotWritableError: the file cannot be created, or takes nothing.
        """
        self.number += 1
        path = self.path
        try:
            self.stream.save(path, default_blueprint=operator_blueprint())
            log_statics(self.stream, self._run)
            self.stream.flush(timeout_sec=PROBE_TIMEOUT_S)
        except (RuntimeError, OSError, ValueError) as error:
            self.number -= 1
            raise RecordingNotWritableError(
                f"The recording {path} cannot be written ({error}): make room or choose another place."
            ) from error

    def death(self) -> str | None:
        """Push everything to the operating system; why the file's writer is gone, if it is."""
        try:
            self.stream.flush(timeout_sec=PROBE_TIMEOUT_S)
        except (RuntimeError, ValueError) as error:
            reason = str(error)
            slow = "timed out" in reason.lower() or "timeout" in reason.lower()
            return None if slow else reason
        return None

    def disk_takes_bytes(self) -> bool:
        """Whether a new part has a chance: there is room, and a trial file really arrives on the disk."""
        trial = self._folder / ".trial"
        try:
            if shutil.disk_usage(self._folder).free < MIN_FREE_BYTES:
                return False
            try:
                with trial.open("wb") as file:
                    file.write(bytes(TRIAL_BYTES))
                    file.flush()
                    os.fdatasync(file.fileno())
            finally:
                trial.unlink(missing_ok=True)
        except OSError:
            return False
        return True

    def close(self) -> str | None:
        """Write the footer; why that failed, if it did."""
        reason = self.death()
        self.stream.disconnect()
        return reason
