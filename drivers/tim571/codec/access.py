"""Login levels and the hash that stands for a password (fact sheet section 3)."""

from __future__ import annotations

import hashlib
import struct
from enum import IntEnum
from functools import reduce
from operator import xor


class Level(IntEnum):
    """User levels of `SetAccessMode`."""

    RUN = 0
    MAINTENANCE = 2
    AUTHORISED_CLIENT = 3
    SERVICE = 4


PASSWORDS = {Level.MAINTENANCE: "main", Level.AUTHORISED_CLIENT: "client", Level.SERVICE: "servicelevel"}
"""The passwords a TiM571 is delivered with, printed in SICK's manuals."""


def password_hash(password: str) -> int:
    """MD5 of the password read as four little-endian uint32, XORed together."""
    digest = hashlib.md5(password.encode("ascii"), usedforsecurity=False).digest()
    words: tuple[int, ...] = struct.unpack("<4I", digest)
    return reduce(xor, words)
