"""Commands of V3: id, big-endian words, CRC-16 (fact sheet section 11). `bytestream.pack_command` makes the bytes."""

from __future__ import annotations

import struct
from enum import IntEnum

from drivers.rmp110.codec.frames import Frame, float_to_word
from drivers.rmp110.codec.parameters import ModeRequest, Stored
from drivers.rmp110.codec.v3.words import CONFIG_WORDS

MOTION_ID, CONFIG_ID, ETHERNET_ID, GENERAL_ID = 0x1800, 0x1801, 0x1802, 0x1803


class General(IntEnum):
    """First word of a general purpose command."""

    NONE = 0
    AUDIO = 1
    MODE_REQUEST = 2
    FAULT_LOG = 3
    RESET_INTEGRATORS = 4
    RESET_PARAMETERS = 5
    CONTINUOUS_DATA = 6
    TORQUE_LIMIT = 7


def motion(v_mps: float, w_rps: float) -> Frame:
    """Forward and counter-clockwise; the sideways speed in the middle is for other machines."""
    return Frame(MOTION_ID, struct.pack(">3f", v_mps, 0.0, w_rps))


ZERO_MOTION = motion(0.0, 0.0)


def general(command: General, word: int = 0) -> Frame:
    """A general purpose command."""
    return Frame(GENERAL_ID, struct.pack(">2I", command, word))


def request_mode(mode: ModeRequest) -> Frame:
    """Ask for a mode, numbered as on CAN."""
    return general(General.MODE_REQUEST, mode)


def continuous_data(*, on: bool) -> Frame:
    """A status packet every 10 ms, or only on request."""
    return general(General.CONTINUOUS_DATA, int(on))


def torque_limit(share: float) -> Frame:
    """Limit the motors' torque to a share of 0..1."""
    return general(General.TORQUE_LIMIT, float_to_word(share))


def machine_config(stored: Stored) -> Frame:
    """All twelve machine parameters at once; `stored` has the layout of `v3.words.PARAMETERS`."""
    return Frame(CONFIG_ID, struct.pack(f">{CONFIG_WORDS}I", *stored.words[:CONFIG_WORDS]))
