"""What goes wrong with the simulated camera: seeded, so that a failure seen once can be seen again."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np

from drivers.theta_v.codec.payload import EOF, ERR

EXDEV = -18  # the kernel's status of a microframe in which nothing could be exchanged


class Cure(IntEnum):
    """What it takes to end a stall; whatever is stronger helps too."""

    RESTART = 1
    """Alternate setting 0 and 1."""
    NEGOTIATE = 2
    """A new commit."""
    RESET = 3
    """A bus reset."""
    TOGGLE = 4
    """Another mode, and back."""


@dataclass(frozen=True, slots=True)
class Stall:
    """At `at_s` seconds after the first picture the encoder stops, and only `cure` helps."""

    at_s: float
    cure: Cure = Cure.RESTART


@dataclass(frozen=True, slots=True)
class Unplug:
    """`at_s` seconds after switching on the cable is pulled, and put back `for_s` seconds later."""

    at_s: float
    for_s: float


@dataclass(frozen=True, slots=True)
class PowerCycle:
    """As Unplug, but the camera comes back in MTP mode and asleep to the first session."""

    at_s: float
    for_s: float


@dataclass(frozen=True, slots=True)
class Overheat:
    """At `at_s` the board says it gets hot, `warned_s` later that it is too hot; it is off then for `for_s`."""

    at_s: float
    warned_s: float
    for_s: float


class FirstSession(Enum):
    """How a sleeping camera fails the first session (fact sheet 3.4: seen, but not how)."""

    REFUSES = "refuses"
    SILENT = "silent"
    STALLS = "stalls"


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Rates are probabilities: of a packet for the first five, of a picture for the other two."""

    seed: int = 0
    lost_packets: float = 0.0
    """The microframe fails, and the host is told so."""
    vanished_packets: float = 0.0
    """The packet is gone and nobody is told; its microframe stays empty."""
    skipped_packets: float = 0.0
    """The camera itself leaves the packet out: nothing on the bus shows it."""
    corrupt_packets: float = 0.0
    """One byte behind the header differs."""
    error_packets: float = 0.0
    """The camera sets its error bit."""
    missing_ends: float = 0.0
    """The end-of-frame bit is not set."""
    lost_pictures: float = 0.0
    """All packets of a picture vanish."""
    events: tuple[Stall | Unplug | PowerCycle | Overheat, ...] = ()
    first_session: FirstSession = FirstSession.REFUSES

    @property
    def has_rates(self) -> bool:
        return any(
            (
                self.lost_packets,
                self.vanished_packets,
                self.skipped_packets,
                self.corrupt_packets,
                self.error_packets,
                self.missing_ends,
                self.lost_pictures,
            )
        )


def spoil(packets: list[bytes], plan: FaultPlan, rng: np.random.Generator) -> list[tuple[int, bytes] | None]:
    """What the bus makes of one picture's packets: status and bytes, or None where nothing arrives."""
    if rng.random() < plan.lost_pictures:
        return []
    if rng.random() < plan.missing_ends:
        packets = [*packets[:-1], _flag(packets[-1], clear=EOF)]
    lost, vanished, corrupt, error, skipped = rng.random((5, len(packets)))
    spoiled: list[tuple[int, bytes] | None] = []
    for i, packet in enumerate(packets):
        if lost[i] < plan.lost_packets:
            spoiled.append((EXDEV, b""))
        elif vanished[i] < plan.vanished_packets:
            spoiled.append(None)
        elif skipped[i] >= plan.skipped_packets:
            changed = packet
            if corrupt[i] < plan.corrupt_packets and len(packet) > packet[0]:
                at = int(rng.integers(packet[0], len(packet)))
                changed = packet[:at] + bytes([packet[at] ^ 0x55]) + packet[at + 1 :]
            if error[i] < plan.error_packets:
                changed = _flag(changed, put=ERR)
            spoiled.append((0, changed))
    return spoiled


def _flag(packet: bytes, put: int = 0, clear: int = 0) -> bytes:
    return packet[:1] + bytes([(packet[1] | put) & ~clear]) + packet[2:]
