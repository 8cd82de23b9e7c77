"""Rows waiting to be written, table by table, and what a reader need not be told again."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import TYPE_CHECKING

import pyarrow as pa  # type: ignore[import-untyped]

from ghal360_robot.logbook import entities
from ghal360_robot.logbook.encoding import Encoder
from ghal360_robot.logbook.table import Row, Table, same

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from ghal360_robot.logbook.clock import Anchor

# Everything that a value of the wrong kind can make Arrow, NumPy or Rerun raise.
BAD_ROW = (pa.ArrowException, ValueError, TypeError, OverflowError, AttributeError, RuntimeError, LookupError)


class Batches:
    """Collects rows per table and gives each table's rows as record batches with their own times and row ids.

    Nothing here touches Rerun's sticky clock: a row has exactly the times it was given.
    """

    def __init__(self, anchor: Anchor, first_row: int = 0) -> None:
        self._encoder = Encoder(anchor, first_row)
        self._rows: dict[Table, list[Row]] = {table: [] for table in entities.ORDER}
        self._given: dict[Table, Row] = {}
        """What a reader of the file holds to be current."""
        self.failures: Counter[str] = Counter()
        """Rows that could not be encoded, by entity, since the last `take_failures`."""
        self.failed = 0
        self.given = 0
        self.last_failure = ""

    def add(self, row: Row) -> None:
        self._rows.setdefault(row.table, []).append(row)

    def begin_anew(self) -> None:
        """Somebody begins to read here: the next row of every table is given in full."""
        self._given.clear()

    def take(self, *, pictures: bool = True) -> Iterator[tuple[Table, pa.RecordBatch]]:
        """Everything that waits, or everything but pictures.

        `loop/inputs` comes last, so that a tick found in a file is whole.

        A batch of pictures never goes on beyond the next key picture: what is dropped is dropped by groups.
        """
        waiting = sorted(self._rows, key=lambda table: table is entities.LOOP_INPUTS)
        for table in waiting:
            rows = self._rows[table]
            if not rows or (table is entities.THETA_VIDEO and not pictures):
                continue
            self._rows[table] = []
            for group in _groups(rows):
                for batch in self._encode(table, group):
                    yield table, batch

    def fail(self, entity: str, error: BaseException, rows: int = 1) -> None:
        self.failed += rows
        self.failures[entity] += rows
        self.last_failure = f"{type(error).__name__}: {error}"

    def take_failures(self) -> Counter[str]:
        failures, self.failures = self.failures, Counter()
        return failures

    def _encode(self, table: Table, rows: Sequence[Row]) -> Iterator[pa.RecordBatch]:
        """One batch, or halves of it until the bad row is found. What repeats is left out.

        A row leans only on rows that really were given.
        """
        try:
            thin, current = _thinned(rows, self._given.get(table))
            if not thin:
                return
            batch = self._encoder.encode(table, thin)
        except BAD_ROW as error:
            if len(rows) == 1:
                self.fail(table.entity, error)
                return
            middle = len(rows) // 2
            yield from self._encode(table, rows[:middle])
            yield from self._encode(table, rows[middle:])
        else:
            self._given[table] = current
            self.given += len(thin)
            yield batch


def is_key(row: Row) -> bool:
    """Whether a row of video begins a group of pictures."""
    return row.table is entities.THETA_VIDEO and row.values[entities.KEYFRAME] is not None


def _groups(rows: list[Row]) -> Iterator[list[Row]]:
    starts = [0, *(k for k, row in enumerate(rows) if k and is_key(row)), len(rows)]
    for begin, end in itertools.pairwise(starts):
        yield rows[begin:end]


def _thinned(rows: Sequence[Row], current: Row | None) -> tuple[list[Row], Row]:
    """The rows to give, given what a reader holds to be current; and what it will hold after them."""
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
