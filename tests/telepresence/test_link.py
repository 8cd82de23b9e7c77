from __future__ import annotations

import asyncio
import socket
import time
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest

from drivers.theta_v.codec.access_units import AccessUnit
from ghal360_robot.telepresence import link

if TYPE_CHECKING:
    from ghal360_robot.telepresence.frames import Frame


def unit(sequence: int, *, key: bool = False, size: int = 1000, decodable: bool = True) -> AccessUnit:
    data = bytes([sequence % 256]) * size
    return AccessUnit(data, data, 10**9 + sequence, 10**9, sequence, key, 1920, 960, decodable=decodable)


async def frames(sock: socket.socket, count: int) -> list[Frame]:
    reader, writer = await asyncio.open_connection(sock=sock, limit=1 << 22)
    got = []
    async with asyncio.timeout(5):
        while len(got) < count and (frame := await link.receive_frame(reader)) is not None:
            got.append(frame)
    writer.close()
    return got


async def test_access_units_arrive_as_they_were_sent() -> None:
    ours, theirs = socket.socketpair()
    tap = link.VideoTap(ours)
    tap.offer(unit(1, key=True, size=300_000))
    tap.offer(unit(2))
    tap.offer(unit(3, decodable=False))
    tap.offer(unit(4))
    got = await frames(theirs, 3)
    tap.close()
    assert [(frame.sequence, frame.key, len(frame.data)) for frame in got] == [
        (1, True, 300_000),
        (2, False, 1000),
        (4, False, 1000),
    ]
    assert (got[0].stamp_ns, got[0].width, got[0].height) == (10**9 + 1, 1920, 960)


async def test_a_process_that_does_not_fetch_costs_whole_groups_and_no_time() -> None:
    ours, theirs = socket.socketpair()
    tap = link.VideoTap(ours)
    began = time.monotonic()
    for sequence in range(100):
        tap.offer(unit(sequence, key=sequence % 10 == 0, size=300_000))
    assert time.monotonic() - began < 0.5
    assert tap.dropped > 80
    receiving = asyncio.create_task(frames(theirs, 12))
    async with asyncio.timeout(5):
        while tap._waiting:
            await asyncio.sleep(0.01)
    tap.offer(unit(200))
    tap.offer(unit(201, key=True))
    tap.offer(unit(202))
    await asyncio.sleep(0.1)
    tap.close()
    sequences = [frame.sequence for frame in await receiving]
    assert sequences[-2:] == [201, 202]
    for before, after in pairwise(sequences):
        assert after == before + 1 or after % 10 == 0 or after == 201


def test_closing_ends_a_thread_that_waits_to_send() -> None:
    ours, theirs = socket.socketpair()
    tap = link.VideoTap(ours)
    tap.offer(unit(1, key=True, size=8 << 20))
    time.sleep(0.05)
    tap.close()
    tap._thread.join(5)
    assert not tap._thread.is_alive()
    theirs.close()


@pytest.mark.parametrize("length", [link.MAX_UNIT_BYTES + 1, 2**32 - 1])
async def test_a_link_out_of_step_is_an_error(length: int) -> None:
    ours, theirs = socket.socketpair()
    reader, writer = await asyncio.open_connection(sock=theirs)
    ours.sendall(link.UNIT.pack(0, 0, 0, 0, 0, length))
    with pytest.raises(ValueError, match="out of step"):
        await link.receive_frame(reader)
    ours.close()
    writer.close()


async def test_lines_go_both_ways_and_end_with_the_socket() -> None:
    ours, theirs = socket.socketpair()
    reader, writer = await asyncio.open_connection(sock=ours)
    other_reader, other = await asyncio.open_connection(sock=theirs)
    assert link.send(writer, "a", {"b": [1, None, "ü"]})
    assert await link.receive(other_reader) == ("a", {"b": [1, None, "ü"]})
    other.write(b'{"half":')
    other.close()
    assert await link.receive(reader) is None
    writer.close()


@pytest.mark.parametrize("line", [b"{", b"[1]", b"{}", b'{"a": 1, "b": 2}', b"[" * 100_000, b"\xff"])
async def test_a_line_that_makes_no_sense_ends_the_link(line: bytes) -> None:
    ours, theirs = socket.socketpair()
    reader, writer = await asyncio.open_connection(sock=ours, limit=link.MAX_LINE_BYTES)
    theirs.setblocking(False)
    sending = asyncio.create_task(asyncio.get_running_loop().sock_sendall(theirs, line + b"\n"))
    assert await link.receive(reader) is None
    await sending
    writer.close()
    theirs.close()


async def test_who_is_told_nothing_does_not_make_us_remember_everything() -> None:
    ours, theirs = socket.socketpair()
    _, writer = await asyncio.open_connection(sock=ours)
    told = [link.send(writer, "state", "x" * 10_000) for _ in range(500)]
    assert not told[-1]
    assert writer.transport.get_write_buffer_size() < link.MAX_BACKLOG_BYTES + 20_000
    writer.transport.abort()
    theirs.close()
