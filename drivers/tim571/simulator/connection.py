"""One client of the simulated lidar."""

from __future__ import annotations

import asyncio
import time
from typing import Protocol

from drivers.tim571.codec.telegram import Receiver, Telegram
from drivers.tim571.simulator.behaviour import Client
from drivers.tim571.simulator.faults import Line, Piece

WAITING_REQUESTS = 64  # a client is expected to wait for each answer; what it sends beyond that is lost
TIMER_S = 0.002  # what the event loop's timers may be late by
OUTBOX_FRAMES = 32  # about 2 s of scans: a client slower than that loses scans, not the device its memory


class Host(Protocol):
    """What a connection belongs to."""

    def joined(self, connection: Connection) -> None:
        """It was opened."""

    def left(self, connection: Connection) -> None:
        """It has closed."""

    def delay_s(self, request: Telegram) -> float:
        """How long the device takes to answer that."""

    def heard(self, request: Telegram, connection: Connection) -> None:
        """Answer a request that came in the connection's dialect; anything else is ignored, as the device does."""


class Connection(asyncio.Protocol):
    """Understands what the client sends, or ignores it; sends over a line with faults."""

    def __init__(self, host: Host, client: Client, line: Line) -> None:
        self.client = client
        self.outbox: asyncio.Queue[tuple[float, list[Piece]]] = asyncio.Queue(OUTBOX_FRAMES)
        self._idle = True  # nothing waits before the next frame
        self.peer = "nobody"
        self._requests: asyncio.Queue[Telegram] = asyncio.Queue(WAITING_REQUESTS)
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
        host, port = transport.get_extra_info("peername")[:2]
        self.peer = f"{host}:{port}"
        self._tasks = (asyncio.create_task(self._send()), asyncio.create_task(self._serve()))
        self._host.joined(self)

    def connection_lost(self, exc: Exception | None) -> None:
        for task in self._tasks:
            task.cancel()
        self._host.left(self)

    def pause_writing(self) -> None:
        self._can_write.clear()

    def resume_writing(self) -> None:
        self._can_write.set()

    def data_received(self, data: bytes) -> None:
        for event in self._receiver.feed(data):
            if isinstance(event, Telegram) and not self._requests.full():
                self._requests.put_nowait(event)

    def send(self, frame: bytes) -> None:
        """Send a frame after those before it; a client that doesn't read loses it."""
        pieces = self._line.strike(frame)
        if self._idle and self._can_write.is_set() and all(piece.pause_s == 0 for piece in pieces):
            for piece in pieces:
                self._write(piece)
        elif not self.outbox.full():
            self._idle = False
            self.outbox.put_nowait((time.monotonic(), pieces))

    def abort(self) -> None:
        """Close without ceremony."""
        self._transport.abort()

    async def _serve(self) -> None:
        """Answer one request after the other, each in the time that a device takes."""
        while True:
            request = await self._requests.get()
            await asyncio.sleep(self._host.delay_s(request))
            if request.dialect is self.client.dialect:
                self._host.heard(request, self)
            if self._receiver.dialect is not self.client.dialect:
                self._receiver = Receiver(self.client.dialect)

    async def _send(self) -> None:
        while True:
            from_s, pieces = await self.outbox.get()
            for piece in pieces:
                await _sleep_until(from_s + piece.pause_s)
                await self._can_write.wait()
                self._write(piece)
                from_s = time.monotonic()
            self._idle = self.outbox.empty()

    def _write(self, piece: Piece) -> None:
        if not self._line.dead:
            self._transport.write(piece.data)


async def _sleep_until(then_s: float) -> None:
    """Exactly: the event loop's timers round up to a whole millisecond, more than the jitter of a real network."""
    if (seconds := then_s - time.monotonic()) > TIMER_S:
        await asyncio.sleep(seconds - TIMER_S)
    while time.monotonic() < then_s:  # noqa: ASYNC110 - there is nothing to wait for but time
        await asyncio.sleep(0)
