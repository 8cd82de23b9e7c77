"""What the device needs from a bus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from drivers.rmp110.codec.frames import Frame

FrameSink = Callable[[int, Frame], None]
"""Called in the event loop with the stamp of reception (`time.monotonic_ns`) and a standard data frame."""
LossSink = Callable[[str], None]
"""Called once in the event loop, with the reason, when the bus is no longer usable."""
Guard = Callable[[Frame], str | None]
"""Why a frame must not reach the wire, or None (see `codec.whitelist`)."""
WarningSink = Callable[[str], None]
"""Called in the event loop with a sentence when the bus still works and is in trouble."""


@dataclass(slots=True)
class BusErrors:
    """Error frames of the CAN controller, by what they said; one frame may count several times."""

    frames: int = 0
    warning: int = 0
    """More than 96 errors counted in one direction."""
    passive: int = 0
    """More than 127: the controller no longer objects to damaged frames."""
    bus_off: int = 0
    """More than 255 transmit errors: the controller left the bus."""
    restarted: int = 0
    no_ack: int = 0
    overflow: int = 0


@dataclass(frozen=True, slots=True)
class TransportStats:
    """What went over one transport since it was opened."""

    received: int = 0
    sent: int = 0
    dropped: int = 0
    """Frames that the bus did not take; they are gone."""
    damaged: int = 0
    """Received things that no RMP sends."""
    overflowed: int = 0
    """Received frames lost because the event loop did not keep up; also part of `damaged`."""
    errors: BusErrors = field(default_factory=BusErrors)


@runtime_checkable
class Guarded(Protocol):
    """A transport that carries more than one dialect: whoever knows which one says what may leave."""

    guard: Guard


class Transport(Protocol):
    """One connection to one bus; opened once, closed once, then thrown away."""

    async def open(self, on_frame: FrameSink, on_lost: LossSink) -> None:
        """Open the bus and start handing over frames. Raises RmpInterfaceError with one clear sentence."""

    def send(self, frame: Frame) -> None:
        """Hand one frame to the bus now, or not at all. May be called from any thread.

        What the bus takes it may hold back, where nobody acknowledges, until somebody does: a kernel queues some
        ten frames. Whoever sends motion sees to it that the last one in such a queue is zero (`device.pilot`).
        Raises RmpForbiddenFrame (never sent), RmpSendDropped (the bus is full), RmpUnacknowledged (the bus says
        that nobody hears; only for motion), RmpLinkError (bus gone).
        """

    async def close(self) -> None:
        """Stop and release the bus; never raises, may be called without `open`."""

    @property
    def damaged(self) -> int:
        """Frames received that no RMP sends: extended, remote, FD, unreadable; and those lost for want of room."""
