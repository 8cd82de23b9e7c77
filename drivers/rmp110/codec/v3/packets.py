"""What a V3 base sends: status packets, the fault log, and a notice before the power goes (fact sheet section 11).

Commands are big-endian. Replies are most likely little-endian: nobody wrote it down, so the machine id, which
is in every status packet, has to tell.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from drivers.rmp110.codec.bytestream import crc_fits, pack_feedback
from drivers.rmp110.codec.fault_log import FAULT_LOG_WORDS
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import OperationalState
from drivers.rmp110.codec.v3.words import LAYOUT, MACHINE_ID_AT, PARAMETERS, STATE_AT, STORED_AT

STATUS_WORDS = len(LAYOUT.words)
STATUS_BYTES = 4 * STATUS_WORDS + 4
"""532: the words, two pad bytes, CRC-16."""
FAULT_LOG_BYTES = 4 * FAULT_LOG_WORDS + 4
"""1248."""
POWER_DOWN_PORT = 6234
POWER_DOWN = bytes.fromhex("8756BAEB")
"""UDP datagram of a base that is about to switch off; power drops some 30 s later."""

STATUS, FAULT_LOG, POWERING_DOWN = 0x18F0, 0x18F1, 0x18F2
"""Packets from the base carry no id; these are ours, so that frames of both directions look alike."""
_BY_LENGTH = {STATUS_BYTES: STATUS, FAULT_LOG_BYTES: FAULT_LOG}

RMP110 = 8
MACHINES = {1: "RMP 440", 2: "RMP 220", 5: "RMP 210", 6: "RMP OMNI", RMP110: "RMP 110"}
"""Low five bits of the machine id."""
MACHINE_MASK = 0x1F


def parse_packet(packet: bytes) -> Frame | None:
    """One whole packet as a frame of `STATUS` or `FAULT_LOG`; None where length or CRC is wrong."""
    kind = _BY_LENGTH.get(len(packet))
    if kind is None or not crc_fits(packet):
        return None
    return Frame(kind, packet[:-4])


def pack_status(words: Sequence[int], order: str = "<") -> bytes:
    """The 532 bytes of a status packet."""
    return pack_feedback(words, order)


def pack_fault_log(words: Sequence[int], order: str = "<") -> bytes:
    """The 1248 bytes of a fault log."""
    return pack_feedback(words, order)


def unpack_words(data: bytes, order: str) -> tuple[int, ...]:
    """The words of a frame's data in byte order `<` or `>`."""
    return struct.unpack(f"{order}{len(data) // 4}I", data[: len(data) // 4 * 4])


def byte_order(data: bytes) -> str | None:
    """`<` or `>`, by which machine id and state of a status packet make sense; None where neither does."""
    for order in "<>":
        words = unpack_words(data, order)
        if words[MACHINE_ID_AT] & MACHINE_MASK in MACHINES and words[STATE_AT] <= OperationalState.POWERDOWN:
            return order
    return None


def machine(words: Sequence[int]) -> int:
    """The platform that a status packet's words name; 8 is an RMP 110."""
    return words[MACHINE_ID_AT] & MACHINE_MASK


def stored_words(words: Sequence[int]) -> tuple[int, ...]:
    """The stored parameters of a status packet, in the order of `v3.words.PARAMETERS`."""
    return tuple(words[STORED_AT : STORED_AT + len(PARAMETERS)])
