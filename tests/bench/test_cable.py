"""A cable that can be cut: nobody is told, nothing passes."""

from __future__ import annotations

import asyncio

from ghal360_robot.bench.cable import Cable


async def _echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(100):
        writer.write(data)
    writer.close()


async def test_bytes_pass_both_ways_until_the_cut_and_the_connection_stays_open() -> None:
    server = await asyncio.start_server(_echo, "127.0.0.1", 0)
    async with server, Cable(server.sockets[0].getsockname()[1]) as cable:
        reader, writer = await asyncio.open_connection("127.0.0.1", cable.port)
        writer.write(b"before")
        assert await asyncio.wait_for(reader.readexactly(6), 5) == b"before"
        cable.cut()
        writer.write(b"after")
        done, _ = await asyncio.wait({asyncio.create_task(reader.read(1))}, timeout=0.2)
        assert not done
    assert await asyncio.wait_for(reader.read(1), 5) == b""  # at the end the cable lets go
    writer.close()


async def test_an_end_that_hangs_up_is_passed_on() -> None:
    server = await asyncio.start_server(_echo, "127.0.0.1", 0)
    async with server, Cable(server.sockets[0].getsockname()[1]) as cable:
        reader, writer = await asyncio.open_connection("127.0.0.1", cable.port)
        writer.write_eof()
        assert await asyncio.wait_for(reader.read(1), 5) == b""
        writer.close()


async def test_nobody_at_the_far_end_closes_the_near_one() -> None:
    server = await asyncio.start_server(_echo, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    server.close()
    await server.wait_closed()
    async with Cable(port) as cable:
        reader, writer = await asyncio.open_connection("127.0.0.1", cable.port)
        assert await asyncio.wait_for(reader.read(1), 5) == b""
        writer.close()
