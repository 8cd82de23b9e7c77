"""A TCP connection as a cable: what goes in comes out, until it is cut without anybody being told."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Self

CHUNK_BYTES = 1 << 16


class Cable:
    """Carries every connection made to `port` on to `target_port`, both on loopback.

    After `cut` connections stay open and no byte passes, as with a plug pulled out of a switch.
    """

    def __init__(self, target_port: int) -> None:
        self.port = 0
        self._target_port = target_port
        self._whole = True
        self._server: asyncio.Server | None = None
        self._carrying: set[asyncio.Task[None]] = set()

    def cut(self) -> None:
        self._whole = False

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._connect, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *exception: object) -> None:
        if self._server is not None:
            self._server.close()
        carrying = list(self._carrying)
        for task in carrying:
            task.cancel()
        if carrying:
            await asyncio.wait(carrying)

    async def _connect(self, near: asyncio.StreamReader, near_out: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 - start_server makes one for every connection
        self._carrying.add(task)
        try:
            with contextlib.suppress(OSError, asyncio.CancelledError):
                far, far_out = await asyncio.open_connection("127.0.0.1", self._target_port)
                try:
                    async with asyncio.TaskGroup() as both:
                        both.create_task(self._carry(near, far_out))
                        both.create_task(self._carry(far, near_out))
                finally:
                    far_out.transport.abort()
        finally:
            near_out.transport.abort()
            self._carrying.discard(task)

    async def _carry(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        with contextlib.suppress(ConnectionError):
            while data := await source.read(CHUNK_BYTES):
                if self._whole:
                    sink.write(data)
                    await sink.drain()
        sink.close()
