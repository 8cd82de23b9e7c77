"""Rows out of .rrd files in the order of their times, as far as the files can be read."""

from __future__ import annotations

import heapq
import shutil
import struct
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
from rerun.chunk import RrdReader

from ghal360_robot.logbook.encoding import ROW_ID, TICK, TIME
from ghal360_robot.logbook.errors import RecordingNotReadableError
from ghal360_robot.logbook.table import BLOB, IMAGE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rerun.chunk import Chunk

MAGIC = b"RRF2"
# A file begins with magic, version and options; each message with its kind and its length.
FILE_HEADER_BYTES = 12
MESSAGE_HEADER = struct.Struct("<QQ")
# The kind of the message that ends a file; the footer follows.
END = 0
# The file's last bytes: this mark, then a number of four bytes.
FOOTER_MARK, FOOTER_MARK_FROM_END = b"RRF2FOOT", 12
# Kinds are single digits in every version so far. After a power cut a file may end in zeros or in anything.
MAX_KIND = 15


@dataclass(frozen=True, slots=True)
class StoredRow:
    """One row as stored: `t_ns` is wall-clock time, `values` are by component name."""

    t_ns: int
    tick: int | None
    values: dict[str, Any]
    row_id: bytes = b""
    """Grows with the order of writing."""


class PartReader:
    """One .rrd file. A torn end is cut off in a temporary copy, which goes away with `close`."""

    def __init__(self, path: Path, *, temporary: bool = False) -> None:
        """`temporary`: the file is ours and goes away with `close`."""
        self.path = path
        self.damage: list[str] = []
        self._copy: Path | None = path if temporary else None
        end, has_footer = _messages_end(path)
        size = path.stat().st_size
        if end < size and not has_footer:
            self.damage.append(
                f"{path.name} is torn: its last {size - end} bytes are not a whole message, "
                "everything before them is readable."
            )
            self._copy = _copy_head(path, end)
        try:
            self._open()
        except RecordingNotReadableError:
            if not has_footer:
                raise
            self.damage.append(f"{path.name} has a damaged end: its table of contents is lost, its rows are not.")
            self._copy = _copy_head(path, end)
            self._open()
        if not has_footer:
            self.damage.append(f"{path.name} was not closed properly: up to half a second may be missing at its end.")

    def _open(self) -> None:
        try:
            with warnings.catch_warnings():
                # A missing footer is told above, in our words.
                warnings.simplefilter("ignore")
                self._reader = RrdReader(str(self._copy or self.path))
                recordings = self._reader.recordings()
        except (RuntimeError, ValueError, OSError) as error:
            self.close()
            raise RecordingNotReadableError(f"{self.path} cannot be read ({error}).") from error
        if not recordings:
            self.close()
            raise RecordingNotReadableError(f"{self.path} holds no recording: it was cut off at its very beginning.")

    def chunks(self, entity: str | None = None, components: list[str] | None = None) -> Iterator[Chunk]:
        """Chunks in the file's order. Damage in the middle ends the iteration and is noted."""
        stream = self._reader.stream()
        if entity is not None or components is not None:
            content = None if entity is None else f"/{entity}"
            stream = stream.filter(content=content, components=components)
        try:
            yield from stream
        except (RuntimeError, ValueError, OSError) as error:
            note = f"{self.path.name} is damaged in the middle ({error}): what follows is missing."
            if note not in self.damage:
                self.damage.append(note)

    def close(self) -> None:
        if self._copy is not None:
            self._copy.unlink(missing_ok=True)
            self._copy = None


def ordered_rows(
    parts: list[PartReader], entity: str, begin_ns: int | None = None, end_ns: int | None = None
) -> Iterator[StoredRow]:
    """The temporal rows of one entity by time, whatever order and shape the file has them in.

    With `begin_ns` and `end_ns` (wall clock, both included), those between.

    Two passes: the first learns when each chunk begins, so that the second holds back only the rows that a
    later chunk may still precede. Rerun's `optimize` spreads the components of one row over several chunks;
    they are one row again here.
    """
    begin = -(1 << 63) if begin_ns is None else begin_ns
    end = (1 << 63) - 1 if end_ns is None else end_ns
    starts = [int(stamps.min()) for _, stamps in _chunks_between(parts, entity, begin, end)]
    # earliest[k] is the first instant in any chunk from k on.
    earliest = np.minimum.accumulate(np.array(starts, np.int64)[::-1])[::-1]
    held: list[tuple[int, bytes, int, StoredRow]] = []
    count = 0
    for seen, (chunk, _) in enumerate(_chunks_between(parts, entity, begin, end), 1):
        for row in chunk_rows(chunk):
            if begin <= row.t_ns <= end:
                heapq.heappush(held, (row.t_ns, row.row_id, count, row))
                count += 1
        bound = int(earliest[seen]) if seen < len(earliest) else None
        while held and (bound is None or held[0][0] < bound):
            yield _pop_row(held)


def _chunks_between(
    parts: list[PartReader], entity: str, begin_ns: int, end_ns: int
) -> Iterator[tuple[Chunk, np.ndarray[Any, np.dtype[np.int64]]]]:
    for part in parts:
        for chunk in part.chunks(entity):
            stamps = chunk_times(chunk)
            if stamps is not None and len(stamps) and stamps.min() <= end_ns and stamps.max() >= begin_ns:
                yield chunk, stamps


def _pop_row(held: list[tuple[int, bytes, int, StoredRow]]) -> StoredRow:
    row = heapq.heappop(held)[-1]
    while held and held[0][1] == row.row_id and held[0][0] == row.t_ns:
        row.values.update(heapq.heappop(held)[-1].values)
    return row


def chunk_times(chunk: Chunk) -> np.ndarray[Any, np.dtype[np.int64]] | None:
    """Wall-clock nanoseconds of a chunk's rows; None for a static chunk."""
    if chunk.is_static or TIME not in chunk.timeline_names:
        return None
    return _integers(chunk.to_record_batch().column(TIME))


def chunk_row_ids(chunk: Chunk) -> list[bytes]:
    """Sixteen bytes for each row, unique in the recording."""
    ids: list[bytes] = chunk.to_record_batch().column(ROW_ID).to_pylist()
    return ids


def chunk_rows(chunk: Chunk) -> Iterator[StoredRow]:
    """The rows of one chunk, in its order."""
    batch = chunk.to_record_batch()
    stamps = _integers(batch.column(TIME)) if TIME in chunk.timeline_names else np.zeros(chunk.num_rows, np.int64)
    ticks = _integers(batch.column(TICK)) if TICK in chunk.timeline_names else None
    ids = chunk_row_ids(chunk)
    lists = {
        name: batch.column(name)
        for name in batch.schema.names
        if ":" in name and pa.types.is_list(batch.column(name).type)
    }
    for k in range(chunk.num_rows):
        values = {name: _instances(array[k]) for name, array in lists.items() if array[k].is_valid}
        yield StoredRow(int(stamps[k]), None if ticks is None else int(ticks[k]), values, ids[k])


def _instances(cell: pa.ListScalar) -> Any:
    """One cell: an array of numbers, a list of bytes, or a list of Python values."""
    array = cell.values
    if array.type in (BLOB, IMAGE):
        return [blob.values.to_numpy(zero_copy_only=False).tobytes() for blob in array]
    if pa.types.is_integer(array.type) or pa.types.is_floating(array.type):
        return array.to_numpy(zero_copy_only=False)
    return array.to_pylist()


def _integers(array: pa.Array) -> np.ndarray[Any, np.dtype[np.int64]]:
    return np.asarray(array.cast(pa.int64()).to_numpy(zero_copy_only=False), np.int64)


def _messages_end(path: Path) -> tuple[int, bool]:
    """Where the whole messages of a file end, and whether a footer follows there."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(FILE_HEADER_BYTES)[: len(MAGIC)] != MAGIC:
            raise RecordingNotReadableError(f"{path} is not a Rerun recording, or not one byte of it is left.")
        at = FILE_HEADER_BYTES
        while at + MESSAGE_HEADER.size <= size:
            file.seek(at)
            kind, length = MESSAGE_HEADER.unpack(file.read(MESSAGE_HEADER.size))
            if kind > MAX_KIND or length == 0 or at + MESSAGE_HEADER.size + length > size:
                return at, False
            if kind == END:
                file.seek(size - FOOTER_MARK_FROM_END)
                return at, file.read(len(FOOTER_MARK)) == FOOTER_MARK
            at += MESSAGE_HEADER.size + length
    return at, False


def _copy_head(path: Path, length: int) -> Path:
    with tempfile.NamedTemporaryFile(prefix="ghal360-", suffix=".rrd", delete=False) as copy, path.open("rb") as file:
        shutil.copyfileobj(file, copy)
        copy.truncate(length)
        return Path(copy.name)
