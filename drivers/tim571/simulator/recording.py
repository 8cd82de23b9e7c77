"""Recorded telegrams as a source of scans.

A `.rec` file holds records back to back, little endian: float64 host time in seconds, uint32 n, then n bytes, one
complete framed telegram.
"""

from __future__ import annotations

import struct
from pathlib import Path

from drivers.tim571.codec.dialect import MAGIC, Dialect
from drivers.tim571.codec.scandata import is_scan
from drivers.tim571.codec.telegram import Receiver, Telegram

_RECORD = struct.Struct("<dI")


def read_scans(path: Path) -> list[Telegram]:
    """The scan telegrams of a `.rec` file, in order; raises ValueError if it holds none or is cut short."""
    data = path.read_bytes()
    frames = []
    at = 0
    while at < len(data):
        if at + _RECORD.size > len(data):
            raise ValueError(f"{path} ends inside a record: it is no .rec file or was cut short")
        _, size = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        frames.append(data[at : at + size])
        at += size
    if not frames or at != len(data):
        raise ValueError(f"{path} ends inside a record: it is no .rec file or was cut short")
    dialect = Dialect.B if frames[0].startswith(MAGIC) else Dialect.A
    telegrams = Receiver(dialect).feed(b"".join(frames))
    scans = [event for event in telegrams if isinstance(event, Telegram) and is_scan(event)]
    if not scans:
        raise ValueError(f"{path} holds no scan telegram")
    return scans
