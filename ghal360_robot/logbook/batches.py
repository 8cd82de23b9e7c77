"""Rows waiting to be written, table by table, and their way into columns."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import rerun as rr

from ghal360_robot.logbook import entities
from ghal360_robot.logbook.table import Row, Table, encode, same

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ghal360_robot.logbook.clock import Anchor

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
        self._sent: dict[Table, Row] = {}
        """What a reader of the file holds to be current."""
        self.failures: Counter[str] = Counter()
        """Rows that could not be written, by entity, since the last `take_failures`."""
        self.failed = 0
        self.written = 0
        self.last_failure = ""

    def add(self, row: Row) -> None:
        self._rows.setdefault(row.table, []).append(row)

    def begin_anew(self) -> None:
        """A new file begins: the next row of every table is written in full."""
        self._sent.clear()

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
        """One batch, or halves of it until the bad row is found. What repeats is left out of what is sent.

        A row leans only on rows that really were sent.
        """
        thin, current = _thinned(rows, self._sent.get(table))
        if not thin:
            return
        try:
            self._send_batch(table, thin)
        except BAD_ROW as error:
            if len(rows) == 1:
                self.fail(table.entity, error)
                return
            middle = len(rows) // 2
            self._send(table, rows[:middle])
            self._send(table, rows[middle:])
        else:
            self._sent[table] = current
            self.written += len(thin)

    def _send_batch(self, table: Table, rows: Sequence[Row]) -> None:
        stamps = np.array([self._anchor.to_wall(row.stamp_ns) for row in rows], np.int64)
        indexes = [rr.TimeColumn(TIME, timestamp=stamps.astype("datetime64[ns]"))]
        if rows[0].tick is not None:
            indexes.append(rr.TimeColumn(TICK, sequence=pa.array([row.tick for row in rows])))
        columns = []
        for k, column in enumerate(table.columns):
            values = [row.values[k] for row in rows]
            if any(value is not None for value in values):
                columns.append(encode(column, values))
        self._sink.send_columns(table.entity, indexes, columns, strict=True)


def _thinned(rows: Sequence[Row], current: Row | None) -> tuple[list[Row], Row]:
    """The rows to send, given what a reader holds to be current; and what it will hold after them."""
    thin: list[Row] = []
    for row in rows:
        if current is None:
            thin.append(row)
        elif row.table.on_change and _repeats(row, current):
            continue
        else:
            thin.append(_without_repeats(row, current))
        current = row
    return thin, rows[-1] if current is None else current


def _repeats(row: Row, current: Row) -> bool:
    table = row.table
    if table.keepalive_ns is not None and row.stamp_ns - current.stamp_ns >= table.keepalive_ns:
        return False
    return all(map(same, row.values[: table.compared], current.values[: table.compared]))


def _without_repeats(row: Row, current: Row) -> Row:
    """`row` with None in every sparse column that says the same as before."""
    columns = row.table.columns
    if not any(column.sparse for column in columns):
        return row
    values = tuple(
        None if column.sparse and same(value, before) else value
        for column, value, before in zip(columns, row.values, current.values, strict=True)
    )
    return Row(row.table, row.stamp_ns, values, row.tick)
