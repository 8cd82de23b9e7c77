"""Settings of one base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from drivers.rmp110.codec.parameters import RMP110_STORED
from drivers.rmp110.codec.vocabulary import VOCABULARIES, Vocabulary
from drivers.rmp110.codec.whitelist import forbidden

EXPECTED: Mapping[str, float] = MappingProxyType(dict(RMP110_STORED))
PROTOCOLS = ("can", "v3")
"""`v3` is for a base that is known to have that firmware: it is said to ruin an older one (fact sheet section 2)."""
DIALECTS = ("auto", "b1", "b2", "b3")
"""`auto` tells B2 from B3. B1 has to be named: the question that tells the others may latch a fault in it."""


@dataclass(frozen=True, slots=True)
class Rmp110Config:
    """What the driver may do with the base, and what it expects to find stored in it.

    `expected` holds stored parameters by name (see `codec.parameters`). With `write_parameters` those that
    differ are written; without, a difference that changes how the base moves makes the driver refuse motion.
    """

    max_v_mps: float = 0.5
    max_w_rps: float = 1.0
    track_m: float = 0.481224
    """Distance between the driven wheels: odometry, and the yaw rate where the base stored another one."""
    expected: Mapping[str, float] = field(default_factory=lambda: EXPECTED)
    write_parameters: bool = False
    write_feedback_set: bool = True
    """Write the compact feedback set where another one is stored; without, the stored one is used."""
    poll_hz: float = 50.0
    """Feedback rate while nothing moves; 20 to 50."""
    backoff_s: tuple[float, float] = (1.0, 5.0)
    """First and longest pause before another attempt to connect: a second after bus-off (fact sheet 13.8),
    and no hurry after a kill switch, where silence is normal."""
    protocol: str = "can"
    """One of `PROTOCOLS`; has to fit the transport."""
    dialect: str = "auto"
    """One of `DIALECTS`, where the protocol is `can`."""
    read_fault_log: bool = False
    """Read the base's fault log at every connection; takes about half a second."""
    observe_only: bool = False
    """Neither request a mode nor move, not even to leave the base in STANDBY at the end."""

    def __post_init__(self) -> None:
        if not 20.0 <= self.poll_hz <= 50.0:
            raise ValueError(f"poll_hz is {self.poll_hz}; the base is polled with 20 to 50 Hz")
        if not (0 < self.max_v_mps <= 8.047 and 0 < self.max_w_rps <= 4.5 and 0.2 < self.track_m < 1.5):
            raise ValueError("max_v_mps, max_w_rps or track_m is outside of what an RMP 110 can be")
        if self.protocol not in PROTOCOLS or self.dialect not in DIALECTS:
            raise ValueError(f"protocol is one of {', '.join(PROTOCOLS)}, dialect one of {', '.join(DIALECTS)}")
        for name, value in self.expected.items():
            _check(name, value)


def _check(name: str, value: float) -> None:
    """Raise where no base can store this, or none should."""
    books = [book for book in VOCABULARIES.values() if any(p.name == name for p in book.parameters)]
    if not books:
        raise ValueError(f"unknown stored parameters: {name}")
    if not any(_writable(book, name, value) for book in books):
        raise ValueError(f"expected {name} = {value}: a base cannot store that, or this driver never writes it")


def _writable(book: Vocabulary, name: str, value: float) -> bool:
    try:
        return forbidden(book.store(name, value), book.dialect) is None
    except (OverflowError, ValueError):
        return False
