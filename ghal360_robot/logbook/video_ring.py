"""Pictures that are not being written, kept for the case that they should have been.

It is the pre-trigger ring of bookmarks, and what holds pictures while no disk takes bytes. What it lets go, it lets
go by whole groups, the oldest first: a picture without its predecessors shows nothing.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]

PRE_TRIGGER_S = 30.0
"""What led to an event is rarely longer ago."""

MAX_BYTES = 192 << 20
"""Half a minute of 2K at its highest published rate (42 Mbit/s), and then some."""


@dataclass(frozen=True, slots=True)
class _Piece:
    batch: pa.RecordBatch
    key: bool
    """A group of pictures begins with it."""
    at_s: float


class VideoRing:
    """Batches of access units, none of which goes on beyond a key picture."""

    def __init__(self, max_s: float = PRE_TRIGGER_S, max_bytes: int = MAX_BYTES) -> None:
        self._max_s = max_s
        self._max_bytes = max_bytes
        self._pieces: deque[_Piece] = deque()
        self.bytes = 0
        self.let_go = 0
        """Access units that left the ring unwritten."""

    def __len__(self) -> int:
        return len(self._pieces)

    def add(self, batch: pa.RecordBatch, *, key: bool, now_s: float, owed: bool = False) -> None:
        """Take a batch in; what is `owed` leans on pictures that were written, and is let go for want of room only."""
        if not self._pieces and not key and not owed:
            self.let_go += batch.num_rows
            return
        self._pieces.append(_Piece(batch, key, now_s))
        self.bytes += batch.nbytes
        while self._pieces and (self.bytes > self._max_bytes or (not owed and self._is_old(now_s))):
            self._drop_group()

    def take(self) -> list[pa.RecordBatch]:
        """Everything in it, oldest first; the ring is empty then."""
        batches = [piece.batch for piece in self._pieces]
        self._pieces.clear()
        self.bytes = 0
        return batches

    def _is_old(self, now_s: float) -> bool:
        """Whether the group after the oldest one covers the span already."""
        second = next((piece for piece in list(self._pieces)[1:] if piece.key), None)
        return second is not None and now_s - second.at_s >= self._max_s

    def _drop_group(self) -> None:
        while self._pieces:
            piece = self._pieces.popleft()
            self.bytes -= piece.batch.nbytes
            self.let_go += piece.batch.num_rows
            if self._pieces and self._pieces[0].key:
                return
