"""One client of the simulated lidar."""

from __future__ import annotations

import asyncio
from typing import Protocol

from drivers.tim571.codec.telegram import Receiver, Telegram
from drivers.tim571.simulator.behaviour import Client
from drivers.tim571.simulator.faults import Line

OUTBOX_FRAMES = 32  # about 2 s of scans: a client slower than that loses scans, not the device its memory


class Host(Protocol):
    """What a connection belongs to."""

    def joined(self, connection: Connection) -> None:
        """It was opened."""

    def left(self, connection: Connection) -> None:
        """It has closed."""

    def heard(self, request: Telegram, connection: Connection) -> None:
        """It understood a request in its dialect; anything else it ignores, as the device does."""


class Connection(asyncio.Protocol):
    """Understands what the client sends, or ignores it; sends over a line with faults."""

    def __init__(self, host: Host, client: Client, line: Line) -> None:
        self.client = client
        self.outbox: asyncio.Queue[bytes] = asyncio.Queue(OUTBOX_FRAMES)
        self._host = host
        self._line = line
        self._receiver = Receiver(client.dialect)
        self._can_write = asyncio.Event()
        self._can_write.set()

    @property
    def unsent(self) -> int:
        """Bytes that the client has not made room for."""
        return self._transport.get_write_buffer_size()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - create_server makes no other kind
        self._transport = transport
        self._sender = asyncio.create_task(self._send())
        self._host.joined(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._sender.cancel()
        self._host.left(self)

    def pause_writing(self) -> None:
        self._can_write.clear()

    def resume_writing(self) -> None:
        self._can_write.set()

    def data_received(self, data: bytes) -> None:
        for event in self._receiver.feed(data):
            if isinstance(event, Telegram):
                self._host.heard(event, self)
        if self._receiver.dialect is not self.client.dialect:
            self._receiver = Receiver(self.client.dialect)

    def send(self, frame: bytes) -> None:
        """Queue a frame; a client that doesn't read loses it."""
        if not self.outbox.full():
            self.outbox.put_nowait(frame)

    def abort(self) -> None:
        """Close without ceremony."""
        self._transport.abort()

    async def _send(self) -> None:
        while True:
            frame = await self.outbox.get()
            for piece in self._line.strike(frame):
                if piece.pause_s:
                    await asyncio.sleep(piece.pause_s)
                await self._can_write.wait()
                if not self._line.dead:
                    self._transport.write(piece.data)
