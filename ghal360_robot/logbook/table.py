"""Tables of the log: which columns an entity has, what a row is, how rows become Arrow columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

# What a row holds for one column: its instances, or None.
Value: TypeAlias = "Sequence[Any] | NDArray[Any] | None"

F32, F64 = pa.float32(), pa.float64()
I64 = pa.int64()
U8, U16, U32 = pa.uint8(), pa.uint16(), pa.uint32()
BOOL, TEXT = pa.bool_(), pa.string()
BLOB = pa.list_(U8)
# The same, as Rerun's viewer wants it of images; of anything else it draws none, and does not say why.
IMAGE = pa.list_(pa.field("item", U8, nullable=False))
TENSOR = rr.components.TensorDataBatch._ARROW_DATATYPE


def strips(size: int) -> pa.DataType:
    """A line through points of `size` coordinates."""
    return pa.list_(pa.field("item", vector(size), nullable=False))


def vector(size: int) -> pa.DataType:
    """A fixed-size float32 vector, as Rerun's spatial components want it."""
    return pa.list_(pa.field("item", F32, nullable=False), size)


@dataclass(frozen=True, slots=True)
class Column:
    """One component of an entity; a row holds any number of instances of `type`, or None for "not logged"."""

    descriptor: rr.ComponentDescriptor
    type: pa.DataType
    sparse: bool = False
    """Written only where it differs from the row before; a reader carries the value forward."""

    @property
    def name(self) -> str:
        return str(self.descriptor.component)


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """One entity of the log."""

    entity: str
    columns: tuple[Column, ...]
    on_change: bool = False
    """Rows equal to the one before are left out; a reader carries the row forward."""
    keepalive_ns: int | None = None
    """With `on_change`: an unchanged row is written all the same when the last is this old."""
    compared: int | None = None
    """With `on_change`: how many leading columns make a change; None for all."""
    direct: bool = False
    """Rows large enough for a chunk of their own: written at once, not gathered for seconds."""


@dataclass(frozen=True, slots=True)
class Row:
    """One row: instants are monotonic nanoseconds, `values` go with the table's columns."""

    table: Table
    stamp_ns: int
    values: tuple[Value, ...]
    tick: int | None = None


def own(archetype: str, name: str, type_: pa.DataType, *, sparse: bool = False) -> Column:
    """A column of ours, `archetype:name`; such names never collide between entities."""
    descriptor = rr.ComponentDescriptor(name).with_builtin_archetype(archetype)
    return Column(descriptor, type_, sparse)


def same(a: Value, b: Value) -> bool:
    """Whether two values of one column are equal; arrays are compared as a whole, alone or in a list."""
    if a is None or b is None:
        return a is b
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(a, b)
    if len(a) and isinstance(a[0], np.ndarray):
        return len(a) == len(b) and all(map(np.array_equal, a, b))
    return len(a) == len(b) and all(x == y for x, y in zip(a, b, strict=True))


def encode(column: Column, values: Sequence[Value]) -> pa.Array:
    """One column of a batch: a list of instances for each row.

    Raises:
        pa.ArrowException, TypeError, ValueError, OverflowError: a value does not fit the column's type.
    """
    if pa.types.is_fixed_size_list(column.type):
        return _vectors(values, column.type)
    if pa.types.is_struct(column.type) and column.type.field(0).name == "shape":
        return _tensors(values, column.type)
    if column.type in (strips(2), strips(3)):
        values = [None if v is None else [np.asarray(line, np.float32).tolist() for line in v] for v in values]
    elif column.type in (BLOB, IMAGE):
        values = [None if v is None else [np.frombuffer(b, np.uint8) for b in v] for v in values]
    return pa.array(values, type=pa.list_(column.type))


def _vectors(values: Sequence[Value], type_: pa.DataType) -> pa.Array:
    """Arrow has no conversion from two-dimensional arrays; offsets and a flat array do it without a loop."""
    size = type_.list_size
    parts = [np.empty((0, size), np.float32) if v is None else _matrix(v, size) for v in values]
    offsets = np.concatenate(([0], np.cumsum([len(p) for p in parts]))).astype(np.int32)
    flat = pa.array(np.concatenate(parts).reshape(-1), type=F32)
    missing = pa.array([v is None for v in values], type=BOOL)
    instances = pa.FixedSizeListArray.from_arrays(flat, type=type_)
    return pa.ListArray.from_arrays(offsets, instances, mask=missing)


def _tensors(values: Sequence[Value], type_: pa.DataType) -> pa.Array:
    """One tensor of numbers a row: Arrow does not make the union in it from Python values."""
    made = [rr.components.TensorDataBatch(np.asarray(v, np.float64)).as_arrow_array() for v in values if v is not None]
    offsets = np.concatenate(([0], np.cumsum([v is not None for v in values]))).astype(np.int32)
    missing = pa.array([v is None for v in values], type=BOOL)
    return pa.ListArray.from_arrays(offsets, pa.concat_arrays(made).cast(type_), mask=missing)


def _matrix(value: Sequence[Any] | NDArray[Any], size: int) -> NDArray[np.float32]:
    return np.asarray(value, np.float32).reshape(-1, size)
