"""How bytes reach the lidar and come back; nothing here knows what they mean."""

from __future__ import annotations

from typing import Protocol


class Transport(Protocol):
    """One way to the lidar. It can be opened again after it was closed."""

    @property
    def name(self) -> str:
        """The other end in a person's words, such as `192.168.0.1:2112`."""

    async def open(self) -> None:
        """Connect; raises TimUnreachableError or TimTimeoutError with a sentence that helps."""

    async def read(self) -> tuple[int, bytes]:
        """The next bytes and their arrival (`time.monotonic_ns`); no bytes once the other end has closed.

        Raises TimUnreachableError if the connection broke.
        """

    async def write(self, data: bytes) -> None:
        """Send; raises TimUnreachableError if the connection broke."""

    async def close(self) -> None:
        """Disconnect; may be called at any time and more than once."""
