"""What a robot that was killed leaves behind, put in order: the rows logged ahead of a part, and the part's footer."""

from __future__ import annotations

import contextlib
import logging
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import rerun as rr
import rerun_cli  # type: ignore[import-untyped]

from ghal360_robot.logbook.encoding import chunk, identified, without
from ghal360_robot.logbook.errors import RecordingNotReadableError
from ghal360_robot.logbook.rrd import PartReader, chunk_row_ids
from ghal360_robot.logbook.statics import APPLICATION_ID
from ghal360_robot.logbook.wal import SUFFIX, is_being_written, read_wal

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pyarrow as pa  # type: ignore[import-untyped]

# A part of 512 MiB takes some seconds; one that takes this long is not worth the robot's attention.
MERGE_TIMEOUT_S = 300.0

# Other robots' and other days' runs are not this boot's business.
MAX_RUNS = 20

logger = logging.getLogger(__name__)


def read_tail(log: Path) -> PartReader | None:
    """The rows that a log has and its part lacks, as a part of their own that goes away when it is closed."""
    batches = list(_missing(log))
    if not batches:
        return None
    with tempfile.NamedTemporaryFile(prefix=f"ghal360-{log.stem}-", suffix=".rrd", delete=False) as file:
        path = Path(file.name)
    try:
        _write(batches, path, log.parent.name)
        return PartReader(path, temporary=True)
    except (RecordingNotReadableError, RuntimeError, ValueError, OSError) as error:
        path.unlink(missing_ok=True)
        logger.warning("%s cannot be read (%s): the last seconds of its part may be missing", log, error)
        return None


def recover_runs(directory: Path) -> list[str]:
    """Give every part under `directory` that was not ended properly its rows and its footer.

    Returns what was done, in sentences. Takes long, and reads what may be damaged: for a process of its own
    (`python -m ghal360_robot.logbook.recovery DIRECTORY`).
    """
    done = []
    for folder in sorted(directory.glob("*/"), reverse=True)[:MAX_RUNS]:
        for log in sorted(folder.glob(f"part-*{SUFFIX}")):
            part = log.with_suffix(".rrd")
            try:
                with log.open("rb") as held:
                    if is_being_written(held.fileno()):
                        continue
                    recover_part(part)
                done.append(f"{part} was not ended properly; it has been put in order.")
            except (OSError, RuntimeError, ValueError, subprocess.SubprocessError) as error:
                done.append(f"{part} was not ended properly, and cannot be put in order ({error}).")
    return done


def recover_part(part: Path) -> None:
    """Write the part again, with the rows of its log and a footer, and replace it. Raises OSError and others."""
    log = part.with_suffix(SUFFIX)
    tail, whole = part.with_name(f".{part.stem}-tail.rrd"), part.with_name(f".{part.stem}-whole.rrd")
    inputs = [part]
    try:
        batches = list(_missing(log)) if log.exists() else []
        if batches:
            _write(batches, tail, part.parent.name)
            inputs.append(tail)
        # Not `optimize`: it parses the video, and complains of every byte of a damaged access unit.
        command = [str(Path(rerun_cli.__file__).parent / "rerun"), "rrd", "merge", "--continue-on-error"]
        subprocess.run(  # noqa: S603 - Rerun's own command line, on our own files
            [*command, *map(str, inputs), "-o", str(whole)],
            check=True,
            timeout=MERGE_TIMEOUT_S,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        with whole.open("rb") as file:
            os.fsync(file.fileno())
        whole.replace(part)
        log.unlink(missing_ok=True)
    finally:
        for leftover in (tail, whole):
            leftover.unlink(missing_ok=True)


def start_recovery(directory: Path) -> subprocess.Popen[bytes] | None:
    """Begin `recover_runs` behind everything else this machine has to do; what a boot of the robot calls."""
    if not any(directory.glob(f"*/part-*{SUFFIX}")):
        return None
    command = ["nice", "-n", "19", sys.executable, "-m", "ghal360_robot.logbook.recovery", str(directory)]
    with contextlib.suppress(OSError):
        return subprocess.Popen(  # noqa: S603 - this module
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True
        )
    return None


def _missing(log: Path) -> Iterator[pa.RecordBatch]:
    """What the log has and its part lacks."""
    try:
        batches = list(read_wal(log))
    except OSError:
        return
    if not batches:
        return
    known: set[bytes] = set()
    part = log.with_suffix(".rrd")
    if part.exists():
        with contextlib.suppress(RecordingNotReadableError):
            reader = PartReader(part)
            wanted = {batch.schema.metadata[b"rerun:entity_path"].decode() for batch in batches}
            known = {
                row_id
                for chunk_ in reader.chunks()
                if not chunk_.is_static and chunk_.entity_path in wanted
                for row_id in chunk_row_ids(chunk_)
            }
            reader.close()
    for batch in batches:
        left = without(batch, known)
        if left is not None:
            yield left


def _write(batches: list[pa.RecordBatch], path: Path, run_id: str) -> None:
    stream = rr.RecordingStream(APPLICATION_ID, recording_id=run_id, send_properties=False)
    stream.save(path)
    for batch in batches:
        stream.send_chunks(chunk(identified(batch)))
    stream.flush()
    stream.disconnect()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)
    for sentence in recover_runs(Path(sys.argv[1])):
        logger.info("%s", sentence)
