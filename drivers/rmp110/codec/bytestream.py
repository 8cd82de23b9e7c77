"""The same commands and feedback as byte packets with CRC-16, for USB and UDP (fact sheet section 10)."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from drivers.rmp110.codec.frames import Frame


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = (crc >> 1) ^ 0xA001 if crc & 1 else crc >> 1
        table.append(crc)
    return tuple(table)


_TABLE = _crc_table()


def crc16(data: bytes) -> int:
    """CRC-16/ARC: reflected 0x8005, start 0, no final xor; `123456789` gives 0xBB3D."""
    crc = 0
    for byte in data:
        crc = (crc >> 8) ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc


def pack_command(frame: Frame) -> bytes:
    """Id, words, CRC high byte first; twelve bytes for the 0x500 family."""
    body = struct.pack(">H", frame.can_id) + frame.data
    return body + struct.pack(">H", crc16(body))


def unpack_command(packet: bytes) -> Frame | None:
    """The frame of a command packet; None where length or CRC is wrong."""
    if len(packet) < 8 or len(packet) % 4 or not crc_fits(packet):
        return None
    return Frame(int.from_bytes(packet[:2], "big"), packet[2:-2])


def pack_feedback(words: Sequence[int], order: str = ">") -> bytes:
    """Feedback words in byte order `>` or `<`, two pad bytes and the CRC over everything before it."""
    body = struct.pack(f"{order}{len(words)}I", *words) + b"\x00\x00"
    return body + struct.pack(">H", crc16(body))


def crc_fits(packet: bytes) -> bool:
    """Whether the last two bytes are the CRC of all before them."""
    return crc16(packet[:-2]) == int.from_bytes(packet[-2:], "big")
