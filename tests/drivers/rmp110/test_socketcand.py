"""CAN over TCP: the text, our client, our server, and python-can's own client on our server."""

from __future__ import annotations

import asyncio
import errno
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110 import CanTransport
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.simulator.socketcand_server import SocketcandServer
from drivers.rmp110.transport.error_frames import ErrorClass
from drivers.rmp110.transport.socketcand import SocketcandBus
from drivers.rmp110.transport.socketcand_text import (
    MAX_MESSAGE,
    TextSplitter,
    format_error,
    format_frame,
    format_send,
    parse_frame,
    parse_send,
)

messages = st.builds(
    lambda extended, number, data: can.Message(
        arbitration_id=number & (0x1FFFFFFF if extended else 0x7FF), is_extended_id=extended, data=data
    ),
    st.booleans(),
    st.integers(0, 0x1FFFFFFF),
    st.binary(max_size=8),
)


@given(st.lists(messages, max_size=5), st.data())
def test_frames_survive_the_text_in_any_fragmentation(sent: list[can.Message], data: st.DataObject) -> None:
    for form, parse in ((format_send, parse_send), (format_frame, parse_frame)):
        stream = b"".join(form(message) for message in sent)
        cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=6)))
        splitter = TextSplitter()
        texts = [
            text
            for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True)
            for text in splitter.feed(stream[begin:end])
        ]
        received = [parse(text) for text in texts]
        assert all(message is not None for message in received)
        assert [(m.arbitration_id, m.is_extended_id, m.data) for m in received if m] == [
            (m.arbitration_id, m.is_extended_id, m.data) for m in sent
        ]
        assert splitter.damaged == 0


@given(st.lists(st.one_of(st.binary(max_size=300), st.sampled_from([b"< frame 502 ", b"<", b">", b"< send "]))))
def test_hostile_text_is_bounded_and_never_raises(chunks: list[bytes]) -> None:
    splitter = TextSplitter()
    for chunk in chunks:
        for text in splitter.feed(chunk):
            parse_frame(text)
            parse_send(text)
        assert len(splitter._rest) <= MAX_MESSAGE


@pytest.mark.parametrize(
    "text",
    ["frame", "frame 502", "frame xyz 1.0 00", "frame 800 1.0 00", "frame 502 1.0 0g", "frame 502 1.0 " + "00" * 9, ""],
)
def test_what_is_no_frame_gives_none(text: str) -> None:
    assert parse_frame(text) is None


@pytest.mark.parametrize("can_id", [0x004, 0x040, 0x1FFFFFFF])
def test_error_frames_are_told_from_error_messages(can_id: int) -> None:
    message = parse_frame(format_error(can_id, 12.5).decode("ascii").strip("<> "))
    assert message is not None
    assert message.is_error_frame
    assert message.arbitration_id == can_id
    for text in ("error bad frame", "error 40", "error unknown command", "error bad 1.0.0"):
        assert parse_frame(text) is None


def test_frames_with_blanks_between_bytes_are_frames_too() -> None:
    message = parse_frame("frame 123 23.424242 11 22 33 44")
    assert message is not None
    assert bytes(message.data) == bytes.fromhex("11223344")


class Peer:
    """One accepted connection under the test's control."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        # Little room, so that what it does not read soon waits at the sender.
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        self.port = int(self.listener.getsockname()[1])
        self.connection: socket.socket | None = None
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def _accept(self) -> None:
        connection, _ = self.listener.accept()
        connection.sendall(b"< hi >")
        connection.recv(100)
        connection.sendall(b"< ok >")
        connection.recv(100)
        # On a busy bus the first frame arrives together with the answer.
        connection.sendall(b"< ok >< frame 502 1.000000 0102030405060708 >")
        self.connection = connection

    def accepted(self) -> socket.socket:
        self._thread.join(5)
        assert self.connection is not None
        return self.connection

    def close(self) -> None:
        self.listener.close()
        if self.connection:
            self.connection.close()


@pytest.fixture
def peer() -> Iterator[Peer]:
    peer = Peer()
    yield peer
    peer.close()


@pytest.fixture
def bus(peer: Peer) -> Iterator[SocketcandBus]:
    bus = SocketcandBus("can0", "127.0.0.1", peer.port)
    yield bus
    bus.shutdown()


def test_a_frame_that_comes_with_the_handshake_is_not_lost(bus: SocketcandBus) -> None:
    message = bus.recv(1)
    assert message is not None
    assert message.arbitration_id == 0x502


def test_a_closed_connection_is_an_error_at_once(bus: SocketcandBus, peer: Peer) -> None:
    assert bus.recv(1)
    peer.accepted().close()
    started = time.monotonic()
    with pytest.raises(can.CanOperationError, match="closed the connection"):
        bus.recv(5)
    assert time.monotonic() - started < 1


def test_silence_is_not_an_error_and_costs_nothing(bus: SocketcandBus) -> None:
    assert bus.recv(1)
    cpu = time.process_time()
    assert bus.recv(0.3) is None
    assert time.process_time() - cpu < 0.1


def test_a_peer_that_does_not_read_makes_send_fail_and_frames_stay_whole(bus: SocketcandBus, peer: Peer) -> None:
    connection = peer.accepted()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    message = can.Message(arbitration_id=0x500, data=bytes(range(8)), is_extended_id=False)
    sent = 0

    def flood() -> None:
        nonlocal sent
        for _ in range(200_000):
            bus.send(message)
            sent += 1

    with pytest.raises(can.CanOperationError) as raised:
        flood()
    assert raised.value.error_code == errno.ENOBUFS
    received: list[str] = []
    splitter = TextSplitter()
    while len(received) < sent:
        received += splitter.feed(connection.recv(65536))
        if bus._unsent:
            bus.send(message)
            sent += 1
    assert splitter.damaged == 0
    assert all(parse_send(text) is not None for text in received)


def test_an_error_frame_comes_through(bus: SocketcandBus, peer: Peer) -> None:
    assert bus.recv(1)
    peer.accepted().sendall(format_error(0x040, 1.0))
    message = bus.recv(1)
    assert message is not None
    assert (message.is_error_frame, message.arbitration_id) == (True, 0x040)


def test_a_server_that_drips_its_greeting_does_not_hold_us() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        done = threading.Event()

        def drip() -> None:
            connection, _ = listener.accept()
            with connection:
                while not done.wait(0.05):
                    try:
                        connection.sendall(b"<")
                    except OSError:
                        return

        thread = threading.Thread(target=drip)
        thread.start()
        started = time.monotonic()
        with pytest.raises(TimeoutError):
            SocketcandBus("can0", "127.0.0.1", listener.getsockname()[1], connect_timeout_s=0.3)
        assert time.monotonic() - started < 1.5
        done.set()
        thread.join(5)


def test_a_server_that_is_not_there_is_reported_quickly() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    started = time.monotonic()
    with pytest.raises(ConnectionRefusedError):
        SocketcandBus("can0", "127.0.0.1", port)
    assert time.monotonic() - started < 1


def test_what_a_silent_server_did_not_take_is_taken_back_at_the_end(bus: SocketcandBus, peer: Peer) -> None:
    connection = peer.accepted()
    command = can.Message(arbitration_id=0x500, data=bytes(range(8)), is_extended_id=False)
    deadline = time.monotonic() + 5
    while not bus._waiting_bytes() and time.monotonic() < deadline:
        # Acknowledgements make room a few times until the buffers of both ends are full.
        with pytest.raises(can.CanOperationError, match="buffer full"):
            repeat(lambda: bus.send(command))
        time.sleep(0.05)
    assert bus._waiting_bytes()
    bus.shutdown()
    with pytest.raises(ConnectionResetError):
        repeat(lambda: connection.recv(65536))


def repeat(action: Callable[[], object]) -> None:
    """Until it raises, or long enough."""
    for _ in range(1_000_000):
        action()


def test_what_was_said_last_still_arrives_after_an_ordinary_end(bus: SocketcandBus, peer: Peer) -> None:
    connection = peer.accepted()
    assert bus.recv(1.0) is not None
    bus.send(can.Message(arbitration_id=0x500, data=bytes(8), is_extended_id=False))
    bus.shutdown()
    heard = b""
    while data := connection.recv(65536):
        heard += data
    assert heard.endswith(b"< send 500 8 0 0 0 0 0 0 0 0 >")


async def collect(bus: can.BusABC, count: int, timeout_s: float = 5) -> list[can.Message]:
    """`count` frames, read in another thread."""

    def read() -> list[can.Message]:
        deadline = time.monotonic() + timeout_s
        found: list[can.Message] = []
        while len(found) < count and time.monotonic() < deadline:
            message = bus.recv(0.1)
            if message:
                found.append(message)
        return found

    return await asyncio.to_thread(read)


@pytest.mark.parametrize("client", ["ours", "python-can"])
async def test_the_server_carries_thousands_of_frames_in_order(client: str, until: Any) -> None:
    heard: list[Frame] = []
    server = SocketcandServer("can0")
    await server.open(lambda _, frame: heard.append(frame))
    if client == "ours":
        bus: can.BusABC = await asyncio.to_thread(SocketcandBus, "can0", "127.0.0.1", server.port)
    else:
        options = {"interface": "socketcand", "channel": "can0", "host": "127.0.0.1", "port": server.port}
        bus = await asyncio.to_thread(lambda: can.Bus(ignore_config=True, **options))  # type: ignore[arg-type]
    try:
        frames = [Frame(0x502 + k % 11, k.to_bytes(8, "big")) for k in range(3000)]
        reading = asyncio.create_task(collect(bus, len(frames)))
        for k in range(0, len(frames), 11):
            server.send(frames[k : k + 11])
            await asyncio.sleep(0)
        assert [bytes(m.data) for m in await reading] == [frame.data for frame in frames]
        await asyncio.to_thread(bus.send, can.Message(arbitration_id=0x501, data=bytes(8), is_extended_id=False))
        await until(lambda: heard)
        assert heard == [Frame(0x501, bytes(8))]
    finally:
        bus.shutdown()
        await server.close()


async def test_clients_hear_each_other_but_not_themselves() -> None:
    server = SocketcandServer("can0")
    await server.open(lambda _stamp, _frame: None)
    one, two = [await asyncio.to_thread(SocketcandBus, "can0", "127.0.0.1", server.port) for _ in range(2)]
    try:
        one.send(can.Message(arbitration_id=0x500, data=bytes(8), is_extended_id=False))
        assert [m.arbitration_id for m in await collect(two, 1)] == [0x500]
        assert await collect(one, 1, timeout_s=0.1) == []
    finally:
        one.shutdown()
        two.shutdown()
        await server.close()


async def test_a_remote_controller_s_bus_off_reaches_the_driver(until: Any) -> None:
    server = SocketcandServer("can0")
    await server.open(lambda _stamp, _frame: None)
    warnings: list[str] = []
    reasons: list[str] = []
    transport = CanTransport("socketcand", "can0", host="127.0.0.1", port=server.port, on_warning=warnings.append)
    try:
        await transport.open(lambda _stamp, _frame: None, reasons.append)
        server.report_error(ErrorClass.NO_ACK)
        await until(lambda: warnings)
        assert "nobody acknowledges" in warnings[0]
        server.report_error(ErrorClass.BUS_OFF)
        server.report_error(ErrorClass.BUS_OFF)
        await until(lambda: transport.stats.errors.bus_off == 2)
        assert len(reasons) == 1
        assert "bus-off" in reasons[0]
        assert transport.damaged == 0
    finally:
        await transport.close()
        await server.close()


async def test_the_server_refuses_an_unknown_bus_and_survives_rubbish() -> None:
    server = SocketcandServer("can0")
    await server.open(lambda _stamp, _frame: None)
    try:
        with pytest.raises(can.CanInitializationError, match="could not open bus"):
            await asyncio.to_thread(SocketcandBus, "can9", "127.0.0.1", server.port)
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(b"\xff\x00<<<< send 500 >\r\n< send 500 8 0 >< rawmode >" + b"<" * 10_000)
        await writer.drain()
        async with asyncio.timeout(2):
            assert await reader.readexactly(6) == b"< hi >"
            assert b"error" in await reader.read(100)
        writer.close()
        bus = await asyncio.to_thread(SocketcandBus, "can0", "127.0.0.1", server.port)
        bus.shutdown()
    finally:
        await server.close()
