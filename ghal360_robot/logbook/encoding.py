"""From rows to Arrow record batches that Rerun takes as they are: with row ids and times of their own.

A row keeps its id wherever it goes (file, write-ahead log, live view, a second file after a disk has died), so
that a row which is found twice is known to be one.
"""

from __future__ import annotations

import itertools
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr
from rerun.chunk import Chunk

from ghal360_robot.logbook.table import Column, Table, encode

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from ghal360_robot.logbook.clock import Anchor
    from ghal360_robot.logbook.table import Row

TIME, TICK = "t", "tick"
ROW_ID = "rerun.controls.RowId"
SORTED = b"rerun:is_sorted"

_chunk_numbers = itertools.count()


class Encoder:
    """Numbers the rows of one recording: ids grow in the order of encoding."""

    def __init__(self, anchor: Anchor, first: int = 0) -> None:
        self._anchor = anchor
        self._next = first

    def encode(self, table: Table, rows: Sequence[Row]) -> pa.RecordBatch:
        """`rows` of one table as one batch with every column of the table, rows without a value being null.

        Raises:
            pa.ArrowException, TypeError, ValueError, OverflowError: a value does not fit its column's type.
        """
        stamps = np.array([self._anchor.to_wall(row.stamp_ns) for row in rows], np.int64)
        arrays = [self._ids(len(rows)), pa.array(stamps.view("datetime64[ns]"))]
        ticked = rows[0].tick is not None
        if ticked:
            arrays.append(pa.array([row.tick for row in rows], pa.int64()))
        arrays += [encode(column, [row.values[k] for row in rows]) for k, column in enumerate(table.columns)]
        self._next += len(rows)
        return pa.RecordBatch.from_arrays(arrays, schema=_schema(table, ticked))

    def _ids(self, count: int) -> pa.Array:
        ids = np.empty((count, 2), ">u8")
        ids[:, 0] = self._anchor.wall_ns
        ids[:, 1] = np.arange(self._next, self._next + count)
        return pa.FixedSizeBinaryArray.from_buffers(pa.binary(16), count, [None, pa.py_buffer(ids.tobytes())])


def joined(batches: Sequence[pa.RecordBatch]) -> pa.RecordBatch:
    """Batches of one table as one."""
    if len(batches) == 1:
        return batches[0]
    columns = [pa.concat_arrays([batch.column(k) for batch in batches]) for k in range(batches[0].num_columns)]
    return pa.RecordBatch.from_arrays(columns, schema=batches[0].schema)


def identified(batch: pa.RecordBatch) -> pa.RecordBatch:
    """`batch` ready for Rerun: without its empty columns, with a chunk id, and saying what is in order."""
    arrays, fields = [], []
    for array, field in zip(batch.columns, batch.schema, strict=True):
        if array.null_count == len(array):
            continue
        if field.metadata[b"rerun:kind"] == b"index" and _is_sorted(array):
            field = field.with_metadata({**field.metadata, SORTED: b"true"})  # noqa: PLW2901 - the same field, told more
        arrays.append(array)
        fields.append(field)
    first = int.from_bytes(batch.column(0)[0].as_py()[:8], "big")
    chunk_id = f"chunk_{first:016X}{(1 << 63) + next(_chunk_numbers):016x}"
    metadata = {**batch.schema.metadata, b"rerun:id": chunk_id.encode()}
    return pa.RecordBatch.from_arrays(arrays, schema=pa.schema(fields, metadata))


def chunk(batch: pa.RecordBatch) -> Chunk:
    """The identified batch as a chunk; raises ValueError where Rerun does not take it."""
    (made,) = Chunk.from_record_batch(batch)
    return made


def to_bytes(batch: pa.RecordBatch) -> bytes:
    """An Arrow IPC stream of one batch."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
    return bytes(sink.getvalue())


def from_bytes(data: bytes) -> pa.RecordBatch:
    """The inverse; raises pa.ArrowException or OSError for anything else."""
    batch = pa.ipc.open_stream(data).read_next_batch()
    batch.validate(full=True)
    return batch


def row_ids(batches: Iterable[pa.RecordBatch]) -> set[bytes]:
    return {row_id for batch in batches for row_id in batch.column(0).to_pylist()}


def without(batch: pa.RecordBatch, known: set[bytes]) -> pa.RecordBatch | None:
    """The rows whose ids are not `known`; None where nothing is left."""
    keep = [row_id not in known for row_id in batch.column(0).to_pylist()]
    if all(keep):
        return batch
    return batch.filter(pa.array(keep)) if any(keep) else None


def _is_sorted(array: pa.Array) -> bool:
    values: NDArray[np.int64] = array.cast(pa.int64()).to_numpy(zero_copy_only=False)
    return bool(np.all(values[1:] >= values[:-1]))


@cache
def _schema(table: Table, ticked: bool) -> pa.Schema:
    row_id = {"rerun:kind": "control", "ARROW:extension:name": "rerun.datatypes.TUID", SORTED: "true"}
    row_id["ARROW:extension:metadata"] = '{"namespace":"row"}'
    fields = [
        pa.field(ROW_ID, pa.binary(16), nullable=False, metadata=row_id),
        pa.field(TIME, pa.timestamp("ns"), metadata={"rerun:kind": "index", "rerun:index_name": TIME}),
    ]
    if ticked:
        fields.append(pa.field(TICK, pa.int64(), metadata={"rerun:kind": "index", "rerun:index_name": TICK}))
    fields += [_field(column) for column in table.columns]
    return pa.schema(fields, {**_format(), b"rerun:entity_path": f"/{table.entity}".encode()})


def _field(column: Column) -> pa.Field:
    about = column.descriptor
    metadata = {"rerun:kind": "data", "rerun:component": about.component}
    if about.archetype:
        metadata["rerun:archetype"] = about.archetype
    if about.component_type:
        metadata["rerun:component_type"] = about.component_type
    return pa.field(column.name, pa.list_(column.type), metadata=metadata)


@cache
def _format() -> dict[bytes, bytes]:
    """What Rerun itself says about its format's version in every chunk."""
    sample = Chunk.from_columns("/", [], rr.Scalars.columns(scalars=[0.0]))
    metadata: dict[Any, Any] = sample.to_record_batch().schema.metadata
    return {key: value for key, value in metadata.items() if key == b"sorbet:version"}
