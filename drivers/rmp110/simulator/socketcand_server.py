"""A socketcand server that carries one simulated bus: any socketcand client on this machine can join it.

Speaks the raw mode (https://github.com/linux-can/socketcand, doc/protocol.md). Clients hear the base and
each other, but not themselves, as on a real bus.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Sequence

import can

from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.transport.socketcand_text import TextSplitter, format_error, format_frame, parse_send

log = logging.getLogger(__name__)

MAX_CLIENTS = 16
MAX_UNREAD_BYTES = 1 << 18
"""Some ten seconds of feedback; a client that far behind has stopped reading and is dropped."""


class _Client:
    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self.writer = writer
        self.opened = False
        self.raw = False

    def say(self, text: bytes) -> None:
        if self.writer.transport.get_write_buffer_size() > MAX_UNREAD_BYTES:
            self.writer.transport.abort()
        elif not self.writer.is_closing():
            self.writer.write(text)


class SocketcandServer:
    """`channel` at `host`:`port`; port 0 takes a free one, which `port` holds after `open`."""

    def __init__(self, channel: str, host: str = "127.0.0.1", port: int = 0) -> None:
        self.channel = channel
        self.host = host
        self.port = port
        self._clients: set[_Client] = set()
        self._nobody = asyncio.Event()
        self._nobody.set()
        self._plugged = True
        self._server: asyncio.Server | None = None

    async def open(self, on_message: Callable[[int, Frame], None]) -> None:
        """Raises OSError where the port is taken."""
        self._on_message = on_message
        self._server = await asyncio.start_server(self._serve, self.host, self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    def send(self, messages: Sequence[Frame]) -> None:
        self._broadcast(_can_messages(messages), None)

    def report_error(self, classes: int) -> None:
        """Tell every client what the bus' controller says: an error frame with these class bits."""
        for client in list(self._clients):
            if client.raw:
                client.say(format_error(classes, time.time()))

    def plug(self, plugged: bool) -> None:
        self._plugged = plugged
        if not plugged:
            for client in list(self._clients):
                client.writer.transport.abort()

    async def close(self) -> None:
        if self._server is None:
            return
        self._server.close()
        for client in list(self._clients):
            client.writer.transport.abort()
        await self._server.wait_closed()
        await self._nobody.wait()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = _Client(writer)
        if not self._plugged or len(self._clients) >= MAX_CLIENTS:
            writer.transport.abort()
            return
        self._clients.add(client)
        self._nobody.clear()
        splitter = TextSplitter()
        client.say(b"< hi >")
        try:
            while data := await reader.read(4096):
                for text in splitter.feed(data):
                    self._obey(client, text)
        except ConnectionError as error:
            log.debug("client gone: %s", error)
        finally:
            self._clients.discard(client)
            if not self._clients:
                self._nobody.set()
            writer.close()

    def _obey(self, client: _Client, text: str) -> None:
        match text.split():
            case ["open", channel]:
                client.opened = channel == self.channel
                client.say(b"< ok >" if client.opened else b"< error could not open bus >")
            case ["rawmode"] if client.opened:
                client.raw = True
                client.say(b"< ok >")
            case ["echo"]:
                client.say(b"< echo >")
            case ["send", *_] if client.raw:
                self._take(client, text)
            case _:
                client.say(b"< error unknown command >")

    def _take(self, sender: _Client, text: str) -> None:
        message = parse_send(text)
        if message is None:
            sender.say(b"< error malformed frame >")
            return
        message.timestamp = time.time()
        self._broadcast([message], sender)
        if not message.is_extended_id and self._plugged:
            self._on_message(time.monotonic_ns(), Frame(message.arbitration_id, bytes(message.data)))

    def _broadcast(self, messages: Sequence[can.Message], sender: _Client | None) -> None:
        text = b"".join(format_frame(message) for message in messages)
        for client in list(self._clients):
            if client.raw and client is not sender:
                client.say(text)


def _can_messages(frames: Sequence[Frame]) -> list[can.Message]:
    now = time.time()
    return [
        can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False, timestamp=now)
        for frame in frames
    ]
