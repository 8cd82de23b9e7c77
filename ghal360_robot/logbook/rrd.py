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

from .batches import TICK, TIME
from .errors import RecordingNotReadableError
from .table import BLOB

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rerun.chunk import Chunk

MAGIC = b"RRF2"
# A file begins with magic, version and options; each message with its kind and its length.
FILE_HEADER_BYTES = 12
MESSAGE_HEADER = struct.Struct("<QQ")
# The kind of the message that ends a file; the footer follows.
END = 0


@dataclass(frozen=True, slots=True)
class StoredRow:
    """One row as stored: `t_ns` is wall-clock time, `values` are by component name."""

    t_ns: int
    tick: int | None
    values: dict[str, Any]


class PartReader:
    """One .rrd file. A torn end is cut off in a temporary copy, which goes away with `close`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: list[str] = []
        self._copy: Path | None = None
        whole = _whole_bytes(path)
        size = path.stat().st_size
        if whole < size:
            self.damage.append(
                f"{path.name} is torn: its last {size - whole} bytes belong to a message that was not "
                "written to its end, everything before it is readable."
            )
            self._copy = _copy_head(path, whole)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                self._reader = RrdReader(str(self._copy or path))
                has_recording = bool(self._reader.recordings())
            except (RuntimeError, ValueError, OSError) as error:
                self.close()
                raise RecordingNotReadableError(f"{path} cannot be read ({error}).") from error
        if not has_recording:
            self.close()
            raise RecordingNotReadableError(f"{path} holds no recording: it was cut off at its very beginning.")
        if caught:
            self.damage.append(f"{path.name} was not closed properly: up to half a second may be missing at its end.")

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


def ordered_rows(parts: list[PartReader], entity: str) -> Iterator[StoredRow]:
    """The temporal rows of one entity by time, whatever order the file has them in.

    Two passes: the first learns when each chunk begins, so that the second holds back only the rows that a
    later chunk may still precede.
    """
    starts = [
        int(stamps.min())
        for part in parts
        for chunk in part.chunks(entity)
        if (stamps := chunk_times(chunk)) is not None and len(stamps)
    ]
    # earliest[k] is the first instant in any chunk from k on.
    earliest = np.minimum.accumulate(np.array(starts, np.int64)[::-1])[::-1]
    held: list[tuple[int, int, StoredRow]] = []
    count = seen = 0
    for part in parts:
        for chunk in part.chunks(entity):
            stamps = chunk_times(chunk)
            if stamps is None or not len(stamps):
                continue
            for row in chunk_rows(chunk):
                heapq.heappush(held, (row.t_ns, count, row))
                count += 1
            seen += 1
            bound = int(earliest[seen]) if seen < len(earliest) else None
            while held and (bound is None or held[0][0] < bound):
                yield heapq.heappop(held)[2]


def chunk_times(chunk: Chunk) -> np.ndarray[Any, np.dtype[np.int64]] | None:
    """Wall-clock nanoseconds of a chunk's rows; None for a static chunk."""
    if chunk.is_static or TIME not in chunk.timeline_names:
        return None
    return _integers(chunk.to_record_batch().column(TIME))


def chunk_rows(chunk: Chunk) -> Iterator[StoredRow]:
    """The rows of one chunk, in its order."""
    batch = chunk.to_record_batch()
    stamps = _integers(batch.column(TIME)) if TIME in chunk.timeline_names else np.zeros(chunk.num_rows, np.int64)
    ticks = _integers(batch.column(TICK)) if TICK in chunk.timeline_names else None
    lists = {
        name: batch.column(name)
        for name in batch.schema.names
        if ":" in name and pa.types.is_list(batch.column(name).type)
    }
    for k in range(chunk.num_rows):
        values = {name: _instances(array[k]) for name, array in lists.items() if array[k].is_valid}
        yield StoredRow(int(stamps[k]), None if ticks is None else int(ticks[k]), values)


def _instances(cell: pa.ListScalar) -> Any:
    """One cell: an array of numbers, a list of bytes, or a list of Python values."""
    array = cell.values
    if array.type == BLOB:
        return [blob.values.to_numpy(zero_copy_only=False).tobytes() for blob in array]
    if pa.types.is_integer(array.type) or pa.types.is_floating(array.type):
        return array.to_numpy(zero_copy_only=False)
    return array.to_pylist()


def _integers(array: pa.Array) -> np.ndarray[Any, np.dtype[np.int64]]:
    return np.asarray(array.cast(pa.int64()).to_numpy(zero_copy_only=False), np.int64)


def _whole_bytes(path: Path) -> int:
    """How far into the file its messages are complete; the whole size where nothing is torn."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if file.read(FILE_HEADER_BYTES)[: len(MAGIC)] != MAGIC:
            raise RecordingNotReadableError(f"{path} is not a Rerun recording, or not one byte of it is left.")
        at = FILE_HEADER_BYTES
        while at + MESSAGE_HEADER.size <= size:
            file.seek(at)
            kind, length = MESSAGE_HEADER.unpack(file.read(MESSAGE_HEADER.size))
            if at + MESSAGE_HEADER.size + length > size:
                return at
            if kind == END:
                return size
            at += MESSAGE_HEADER.size + length
    return at


def _copy_head(path: Path, length: int) -> Path:
    with tempfile.NamedTemporaryFile(prefix="ghal360-", suffix=".rrd", delete=False) as copy, path.open("rb") as file:
        shutil.copyfileobj(file, copy)
        copy.truncate(length)
        return Path(copy.name)
