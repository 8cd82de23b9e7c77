"""The simulated base's side of a bus."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import can

from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.simulator.faults import Message
from drivers.rmp110.transport.open_bus import open_bus
from drivers.rmp110.transport.reader import BusReader

log = logging.getLogger(__name__)


class SimulatorBus(Protocol[Message]):
    """Where the simulated base is plugged in."""

    async def open(self, on_message: Callable[[int, Message], None]) -> None:
        """Start; messages come with their stamp, in the event loop."""

    def send(self, messages: Sequence[Message]) -> None:
        """Messages of the base onto the wire, at once; what the wire does not take is lost."""

    def plug(self, plugged: bool) -> None:
        """Pull the cable, or put it back."""

    async def close(self) -> None:
        """Stop."""


class PythonCanBus:
    """Any python-can interface: virtual, udp_multicast, socketcan."""

    def __init__(self, interface: str, channel: str, options: dict[str, Any]) -> None:
        self._where = (interface, channel, options)
        self._plugged = True
        self._bus: can.BusABC | None = None
        self._reader: BusReader | None = None

    async def open(self, on_message: Callable[[int, Frame], None]) -> None:
        """Raises RmpInterfaceError."""
        self._bus = await asyncio.to_thread(open_bus, *self._where)

        def receive(stamp_ns: int, message: can.Message) -> None:
            plain = not (message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd)
            if plain and self._plugged:
                on_message(stamp_ns, Frame(message.arbitration_id, bytes(message.data)))

        self._reader = BusReader(self._bus, receive, lambda error: log.error("simulated base lost its bus: %s", error))
        self._reader.start()

    def send(self, messages: Sequence[Frame]) -> None:
        if self._bus is None or not self._plugged:
            return
        for frame in messages:
            try:
                self._bus.send(
                    can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False), timeout=0
                )
            except (can.CanError, OSError) as error:
                log.debug("frame 0x%X not sent: %s", frame.can_id, error)

    def plug(self, plugged: bool) -> None:
        self._plugged = plugged

    async def close(self) -> None:
        if self._reader:
            await self._reader.stop()
        if self._bus:
            self._bus.shutdown()
