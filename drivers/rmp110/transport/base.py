"""What the device needs from a bus."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from drivers.rmp110.codec.frames import Frame

FrameSink = Callable[[int, Frame], None]
"""Called in the event loop with the stamp of reception (`time.monotonic_ns`) and a standard data frame."""
LossSink = Callable[[str], None]
"""Called once in the event loop, with the reason, when the bus is no longer usable."""


class Transport(Protocol):
    """One connection to one bus; opened once, closed once, then thrown away."""

    async def open(self, on_frame: FrameSink, on_lost: LossSink) -> None:
        """Open the bus and start handing over frames. Raises RmpInterfaceError with one clear sentence."""

    def send(self, frame: Frame) -> None:
        """Put one frame on the wire now, or not at all: nothing is queued.

        Raises RmpForbiddenFrame (never sent), RmpSendDropped (the bus is full), RmpLinkError (bus gone).
        """

    async def close(self) -> None:
        """Stop and release the bus; never raises, may be called without `open`."""

    @property
    def damaged(self) -> int:
        """Frames received that no RMP sends: extended, remote, FD, unreadable; and those lost for want of room."""
