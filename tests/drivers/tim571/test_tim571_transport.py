"""The TCP transport: options, bounds and endings."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from drivers.tim571 import Tim571Simulator
from drivers.tim571.errors import TimTimeoutError, TimUnreachableError
from drivers.tim571.transport.tcp import INBOX_BYTES, TcpTransport


@asynccontextmanager
async def peer() -> AsyncIterator[tuple[TcpTransport, asyncio.StreamReader, asyncio.StreamWriter]]:
    """An open transport and the other end of it."""
    accepted: asyncio.Queue[Any] = asyncio.Queue()
    server = await asyncio.start_server(lambda *ends: accepted.put_nowait(ends), "127.0.0.1", 0)
    transport = TcpTransport("127.0.0.1", server.sockets[0].getsockname()[1])
    await transport.open()
    reader, writer = await accepted.get()
    try:
        yield transport, reader, writer
    finally:
        await transport.close()
        writer.transport.abort()
        server.close()
        await server.wait_closed()


async def test_small_requests_leave_at_once_and_a_dead_peer_is_noticed() -> None:
    async with peer() as (transport, reader, _):
        assert transport._inbox is not None
        link = transport._inbox._transport.get_extra_info("socket")
        assert link.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert link.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        await transport.write(b"hello")
        assert await reader.readexactly(5) == b"hello"


async def test_chunks_are_stamped_as_they_arrive_not_as_they_are_read() -> None:
    async with peer() as (transport, _, writer):
        before = time.monotonic_ns()
        writer.write(b"scan")
        await asyncio.sleep(0.05)
        late = time.monotonic_ns()
        stamp_ns, data = await transport.read()
    assert data == b"scan"
    assert before <= stamp_ns < late


async def test_an_unread_flood_fills_no_memory_and_loses_no_byte(until: Any) -> None:
    flood = bytes(range(256)) * (1 << 15)
    async with peer() as (transport, _, writer):
        writer.write(flood)
        assert transport._inbox is not None
        await until(lambda: transport._inbox._size > INBOX_BYTES)
        await asyncio.sleep(0.05)
        assert transport._inbox._size < 3 * INBOX_BYTES
        received = bytearray()
        while len(received) < len(flood):
            received += (await transport.read())[1]
    assert received == flood


async def test_the_end_of_the_other_side_is_an_empty_read_once_all_is_read() -> None:
    async with peer() as (transport, _, writer):
        writer.write(b"last words")
        writer.close()
        assert (await transport.read())[1] == b"last words"
        assert (await transport.read())[1] == b""


async def test_a_reset_is_an_error_with_a_sentence() -> None:
    async with peer() as (transport, _, writer):
        link = writer.get_extra_info("socket")
        link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
        writer.transport.abort()
        with pytest.raises(TimUnreachableError, match="dropped the connection"):
            await transport.read()
        with pytest.raises(TimUnreachableError, match="closed the connection"):
            await transport.write(b"too late")


async def test_it_can_be_closed_twice_and_opened_again() -> None:
    async with Tim571Simulator() as simulator:
        transport = TcpTransport(simulator.host, simulator.port)
        for _ in range(2):
            await transport.open()
            await transport.write(b"\x02sRN SCdevicestate\x03")
            assert (await transport.read())[1] == b"\x02sRA SCdevicestate 1\x03"
            await transport.close()
            await transport.close()
            with pytest.raises(TimUnreachableError, match="not connected"):
                await transport.read()


async def test_a_host_that_takes_no_connection_is_given_up_in_time() -> None:
    with socket.socket() as full:
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        host, port = full.getsockname()
        waiting = [socket.socket() for _ in range(4)]
        for one in waiting:
            one.setblocking(False)
            one.connect_ex((host, port))
        try:
            with pytest.raises(TimTimeoutError, match=r"did not take the connection within 0\.2 s"):
                await TcpTransport(host, port, connect_timeout_s=0.2).open()
        finally:
            for one in waiting:
                one.close()


def test_a_port_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="2111 and 2112"):
        TcpTransport("192.168.0.1", 70000)
