"""Rows waiting to be written, table by table, and their way into columns."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

from . import entities
from .table import Row, Table, encode, same

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .clock import Anchor

TIME, TICK = "t", "tick"

# Everything that a value of the wrong kind can make Arrow, NumPy or Rerun raise.
BAD_ROW = (pa.ArrowException, ValueError, TypeError, OverflowError, AttributeError, RuntimeError, LookupError)


class ColumnSink(Protocol):
    """The part of a recording stream that is needed here."""

    def send_columns(
        self, entity_path: str, indexes: list[rr.TimeColumn], columns: list[rr.ComponentColumn], *, strict: bool | None
    ) -> None: ...


class Batches:
    """Collects rows per table and sends each table's rows as one batch with its own time columns.

    Nothing here touches Rerun's sticky clock: a row has exactly the times it was given.
    """

    def __init__(self, sink: ColumnSink, anchor: Anchor) -> None:
        self._sink = sink
        self._anchor = anchor
        self._rows: dict[Table, list[Row]] = {table: [] for table in entities.ORDER}
        self._last: dict[Table, Row] = {}
        self.failures: Counter[str] = Counter()
        """Rows that could not be written, by entity, since the last `take_failures`."""
        self.failed = 0
        self.written = 0
        self.last_failure = ""

    def add(self, row: Row) -> None:
        table = row.table
        last = self._last.get(table)
        if last is not None:
            if table.on_change and self._repeats(row, last):
                return
            row = _without_repeats(row, last)
        self._last[table] = _carried(row, last)
        self._rows.setdefault(table, []).append(row)

    def begin_anew(self) -> int:
        """A new file begins: what waits may lean on rows that the old one lost, so it goes; how many rows.

        The next row of every table is written in full.
        """
        waiting = sum(map(len, self._rows.values()))
        for rows in self._rows.values():
            rows.clear()
        self._last.clear()
        return waiting

    def flush(self, *, slow: bool = True) -> Iterator[Table]:
        """Send table by table, the slow ones if `slow`; yields after each, to let other threads run.

        `loop/inputs` goes last, so that a tick found in the file is whole.
        """
        waiting = sorted(self._rows, key=lambda table: table is entities.LOOP_INPUTS)
        for table in waiting:
            rows = self._rows[table]
            if rows and (slow or not table.slow):
                self._rows[table] = []
                self._send(table, rows)
                yield table

    def fail(self, entity: str, error: BaseException, rows: int = 1) -> None:
        self.failed += rows
        self.failures[entity] += rows
        self.last_failure = f"{type(error).__name__}: {error}"

    def take_failures(self) -> Counter[str]:
        failures, self.failures = self.failures, Counter()
        return failures

    def _send(self, table: Table, rows: Sequence[Row]) -> None:
        """One batch per run of rows with the same timelines; a bad row is found by sending it alone."""
        for same_timelines in _split_by_tick(rows):
            try:
                self._send_batch(table, same_timelines)
            except BAD_ROW as error:
                self._last.pop(table, None)
                if len(same_timelines) == 1:
                    self.fail(table.entity, error)
                    continue
                middle = len(same_timelines) // 2
                self._send(table, same_timelines[:middle])
                self._send(table, same_timelines[middle:])

    def _send_batch(self, table: Table, rows: Sequence[Row]) -> None:
        stamps = np.array([self._anchor.to_wall(row.stamp_ns) for row in rows], np.int64)
        indexes = [rr.TimeColumn(TIME, timestamp=stamps.astype("datetime64[ns]"))]
        if rows[0].tick is not None:
            indexes.append(rr.TimeColumn(TICK, sequence=[row.tick for row in rows if row.tick is not None]))
        columns = []
        for k, column in enumerate(table.columns):
            values = [row.values[k] for row in rows]
            if any(value is not None for value in values):
                columns.append(encode(column, values))
        self._sink.send_columns(table.entity, indexes, columns, strict=True)
        self.written += len(rows)

    @staticmethod
    def _repeats(row: Row, last: Row) -> bool:
        table = row.table
        if table.keepalive_ns is not None and row.stamp_ns - last.stamp_ns >= table.keepalive_ns:
            return False
        return all(map(same, row.values[: table.compared], last.values[: table.compared]))


def _without_repeats(row: Row, last: Row) -> Row:
    """`row` with None in every sparse column that says the same as before."""
    columns = row.table.columns
    if not any(column.sparse for column in columns):
        return row
    values = tuple(
        None if column.sparse and same(value, before) else value
        for column, value, before in zip(columns, row.values, last.values, strict=True)
    )
    return Row(row.table, row.stamp_ns, values, row.tick)


def _carried(row: Row, last: Row | None) -> Row:
    """What a reader holds to be current after `row`."""
    columns = row.table.columns
    if last is None or not any(column.sparse for column in columns):
        return row
    values = tuple(
        before if column.sparse and value is None else value
        for column, value, before in zip(columns, row.values, last.values, strict=True)
    )
    return Row(row.table, row.stamp_ns, values, row.tick)


def _split_by_tick(rows: Sequence[Row]) -> Iterator[Sequence[Row]]:
    ticked = [row for row in rows if row.tick is not None]
    if len(ticked) in (0, len(rows)):
        yield rows
        return
    yield ticked
    yield [row for row in rows if row.tick is None]
