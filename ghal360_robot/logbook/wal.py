"""The write-ahead log of a part: small rows wait seconds for a chunk worth its size, and must survive a kill here.

`part-003.wal` lies beside `part-003.rrd` and holds Arrow record batches, each with its length and checksum. It is
emptied whenever its rows have reached the part, and removed when the part ends properly. Row ids tell which of
its rows the part has already.
"""

from __future__ import annotations

import fcntl
import os
import struct
import zlib
from typing import TYPE_CHECKING

import pyarrow as pa  # type: ignore[import-untyped]

from ghal360_robot.logbook.encoding import from_bytes, to_bytes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

SUFFIX = ".wal"
HEADER = struct.Struct("<4sII")
"""Mark, length and CRC-32 of what follows."""
MARK = b"GWAL"

MAX_BATCH_BYTES = 64 << 20
"""A second of everything is less than a megabyte: a longer length is not one."""


class WriteAheadLog:
    """Append-only; every `append` reaches the operating system before it returns. Raises OSError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._file = path.open("wb", buffering=0)
        fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._length = 0

    def append(self, batches: Iterable[pa.RecordBatch]) -> None:
        data = b"".join(_framed(to_bytes(batch)) for batch in batches)
        if not data:
            return
        written = self._file.write(data)
        if written != len(data):
            os.ftruncate(self._file.fileno(), self._length)
            self._file.seek(self._length)
            raise OSError(f"only {written} of {len(data)} bytes were taken")
        self._length += len(data)

    def clear(self) -> None:
        self._file.seek(0)
        self._file.truncate(0)
        self._length = 0

    def close(self, *, remove: bool) -> None:
        self._file.close()
        if remove:
            self.path.unlink(missing_ok=True)


def is_being_written(descriptor: int) -> bool:
    """Whether a recorder has this log open; if not, it is the caller's until the descriptor is closed."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    return False


def read_wal(path: Path) -> Iterator[pa.RecordBatch]:
    """Every whole batch; a torn or damaged end is left out. Raises OSError where the file cannot be read."""
    with path.open("rb") as file:
        while len(header := file.read(HEADER.size)) == HEADER.size:
            mark, length, checksum = HEADER.unpack(header)
            if mark != MARK or length > MAX_BATCH_BYTES:
                return
            data = file.read(length)
            if len(data) < length or zlib.crc32(data) != checksum:
                return
            try:
                yield from_bytes(data)
            except (pa.ArrowException, OSError, ValueError):
                return


def _framed(data: bytes) -> bytes:
    return HEADER.pack(MARK, len(data), zlib.crc32(data)) + data
