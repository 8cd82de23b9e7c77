"""USB/IP on the wire: the server as a kernel meets it, the client against a server that lies."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.theta_v.codec import usbip
from drivers.theta_v.codec.descriptors import ISOCHRONOUS, Endpoint
from drivers.theta_v.codec.payload import Packet
from drivers.theta_v.codec.probe import Probe
from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaMalformed
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.descriptors import LIVE_CONFIGURATION, LIVE_DEVICE
from drivers.theta_v.simulator.usbip_server import UsbIpServer
from drivers.theta_v.transport.usbip import UsbIpTransport
from tests.drivers.theta_v.pictures import Feeder, stream, until

PICTURES = stream(3, 192, 96)
SETUP = struct.Struct("<BBHHH")


class Kernel:
    """What vhci_hcd does with a socket, one call at a time."""

    def __init__(self, server: UsbIpServer) -> None:
        self.socket = socket.create_connection((server.host, server.port), timeout=5)
        self.sequence = 0

    def read(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            piece = self.socket.recv(count - len(data))
            assert piece, "the server hung up"
            data += piece
        return data

    def attach(self, busid: bytes = b"1-1") -> int:
        self.socket.sendall(usbip.operation(usbip.OP_REQ_IMPORT) + busid.ljust(32, b"\0"))
        status = usbip.decode_operation(self.read(8), usbip.OP_REP_IMPORT)
        if status == 0:
            self.device = usbip.Device.decode(self.read(usbip.DEVICE.size))
        return status

    def submit(self, endpoint: int, inward: bool, length: int, packets: int = 0, setup: bytes = bytes(8),
               data: bytes = b"") -> int:  # fmt: skip
        self.sequence += 1
        self.socket.sendall(
            usbip.Submit(self.sequence, 1 << 16 | 2, inward, endpoint, length, packets, 1, setup).encode() + data
        )
        return self.sequence

    def answer(self) -> usbip.Return:
        return usbip.Return.decode(self.read(48))

    def control(self, request_type: int, request: int, value: int, index: int, what: bytes | int = 0) -> bytes | int:
        """Bytes that came in, or the status of a request that went wrong or out."""
        length = what if isinstance(what, int) else len(what)
        setup = SETUP.pack(request_type, request, value, index, length)
        inward = bool(request_type & 0x80)
        self.submit(0, inward, length, setup=setup, data=b"" if isinstance(what, int) else what)
        answer = self.answer()
        data = self.read(answer.length) if inward else b""
        return data if inward and answer.status == 0 else answer.status

    def start_video(self) -> None:
        assert self.control(0x00, 9, 1, 0) == 0
        block = Probe(hint=1, format_index=1, frame_index=2, interval_100ns=333_667).encode(48)
        assert self.control(0x21, 0x01, 0x0100, 2, block) == 0
        assert self.control(0x21, 0x01, 0x0200, 2, block) == 0
        assert self.control(0x01, 0x0B, 1, 2) == 0


@pytest.fixture
def camera() -> SimulatedThetaV:
    return SimulatedThetaV()


@pytest.fixture
def server(camera: SimulatedThetaV) -> Iterator[UsbIpServer]:
    with UsbIpServer(camera) as running:
        yield running


@pytest.fixture
def kernel(server: UsbIpServer) -> Iterator[Kernel]:
    client = Kernel(server)
    yield client
    client.socket.close()


def test_the_list_shows_one_camera_with_five_interfaces(kernel: Kernel) -> None:
    kernel.socket.sendall(usbip.operation(usbip.OP_REQ_DEVLIST))
    assert kernel.read(12) == bytes.fromhex("0111 0005 00000000 00000001")
    device = usbip.Device.decode(kernel.read(usbip.DEVICE.size))
    assert (device.vendor_id, device.product_id, device.busid, device.speed) == (0x05CA, 0x2712, "1-1", 3)
    assert device.interfaces == 5
    assert kernel.read(20)[::4] == bytes([0x06, 0x0E, 0x0E, 0x01, 0x01])


def test_an_unknown_bus_id_and_a_second_host_are_refused(server: UsbIpServer, kernel: Kernel) -> None:
    assert kernel.attach(b"9-9") == usbip.ST_NODEV
    assert kernel.attach() == 0
    second = Kernel(server)
    assert second.attach() == usbip.ST_BUSY
    second.socket.close()


def test_enumeration_as_a_kernel_does_it(kernel: Kernel) -> None:
    assert kernel.attach() == 0
    assert kernel.control(0x80, 6, 0x0100, 0, 64) == LIVE_DEVICE
    assert kernel.control(0x80, 6, 0x0200, 0, 9) == LIVE_CONFIGURATION[:9]
    assert kernel.control(0x80, 6, 0x0200, 0, 432) == LIVE_CONFIGURATION
    assert kernel.control(0x80, 6, 0x0302, 0x0409, 255) == b"\x1c\x03" + "RICOH THETA V".encode("utf-16-le")
    assert kernel.control(0x80, 6, 0x03EE, 0, 255) == -32
    assert kernel.control(0x00, 9, 2, 0) == -32
    assert kernel.control(0x00, 9, 1, 0) == 0
    assert kernel.control(0x80, 8, 0, 0, 1) == b"\x01"
    assert kernel.control(0x01, 0x0B, 2, 2) == -32, "there is no alternate setting 2"
    assert kernel.control(0xA1, 0x85, 0x0100, 2, 2) == b"\x30\x00"
    assert kernel.control(0xA1, 0x81, 0x0300, 2, 48) == -32
    assert kernel.control(0xA1, 0x81, 0x0200, 1, 1) == b"\x06", "the reason of the last stall: unknown control"


def test_nothing_streams_before_commit_and_alternate_setting_one(camera: SimulatedThetaV, kernel: Kernel) -> None:
    assert kernel.attach() == 0
    assert not camera.offer(PICTURES[0])
    assert kernel.control(0x00, 9, 1, 0) == 0
    assert kernel.control(0x01, 0x0B, 1, 2) == 0
    assert not camera.offer(PICTURES[0])
    assert kernel.control(0x01, 0x0B, 0, 2) == 0
    kernel.start_video()
    assert camera.offer(PICTURES[0])
    block = Probe(format_index=1, frame_index=1, interval_100ns=333_667).encode(48)
    assert kernel.control(0x21, 0x01, 0x0100, 2, block) == -32, "no negotiation while streaming"


def test_isochronous_requests_are_packed_paced_and_described(camera: SimulatedThetaV, kernel: Kernel) -> None:
    assert kernel.attach() == 0
    kernel.start_video()
    camera.offer(PICTURES[0])
    started = time.monotonic()
    for _ in range(10):
        kernel.submit(4, True, 32 * 3072, 32, data=usbip.iso_request(32, 3072))
    payload = b""
    for _ in range(10):
        answer = kernel.answer()
        data = kernel.read(answer.length)
        table = usbip.iso_table(kernel.read(16 * 32))
        assert (answer.packets, answer.status) == (32, 0)
        assert int(table[:, 2].sum()) == answer.length
        assert table[:, 0].tolist() == [i * 3072 for i in range(32)], "offsets are those of the request"
        ends = np.cumsum(table[:, 2])
        for end, size in zip(ends.tolist(), table[:, 2].tolist(), strict=True):
            packet = data[end - size : end]
            payload += packet[2:]
            assert not packet or packet[0] == 2
    assert payload == PICTURES[0]
    assert time.monotonic() - started >= 0.035, "320 microframes take 40 ms"


def test_a_cancelled_request_comes_back_as_cancelled_and_an_answered_one_does_not(kernel: Kernel) -> None:
    assert kernel.attach() == 0
    assert kernel.control(0x00, 9, 1, 0) == 0
    victim = kernel.submit(2, True, 28)
    kernel.socket.sendall(usbip.unlink(77, 1 << 16 | 2, victim))
    assert struct.unpack(">IIIIIi24x", kernel.read(48))[::5] == (usbip.RET_UNLINK, -104)
    kernel.socket.sendall(usbip.unlink(78, 1 << 16 | 2, victim))
    assert struct.unpack(">IIIIIi24x", kernel.read(48)) == (usbip.RET_UNLINK, 78, 0, 0, 0, 0)


def test_an_unplugged_camera_ends_the_connection(camera: SimulatedThetaV, kernel: Kernel) -> None:
    assert kernel.attach() == 0
    camera.unplug()
    assert kernel.socket.recv(1) == b""


@given(st.binary(min_size=1, max_size=200), st.booleans())
@settings(deadline=None)
def test_garbage_never_stops_the_server(raw: bytes, attached: bool) -> None:
    with UsbIpServer(SimulatedThetaV()) as server:
        hostile = Kernel(server)
        if attached:
            assert hostile.attach() == 0
        hostile.socket.sendall(raw)
        hostile.socket.shutdown(socket.SHUT_WR)
        while hostile.socket.recv(4096):
            pass
        hostile.socket.close()
        kind = Kernel(server)
        assert kind.attach() == 0
        kind.socket.close()


class Liar:
    """A server that imports politely and then answers whatever it was told to."""

    def __init__(self, answers: bytes) -> None:
        self._answers = answers
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Liar:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self._thread.join()

    def _run(self) -> None:
        device = usbip.Device("/x", "1-1", 1, 2, 3, 0x05CA, 0x2712, 0x100, (0xEF, 2, 1), 1, 1, 0)
        for _ in range(2):
            stream, _peer = self._listener.accept()
            with stream:
                if stream.recv(8)[2:4] == b"\x80\x05":
                    stream.sendall(usbip.operation(5) + (1).to_bytes(4, "big") + device.encode())
                else:
                    stream.recv(32)
                    stream.sendall(usbip.operation(3) + device.encode() + self._answers)
                    stream.shutdown(socket.SHUT_WR)
                    while stream.recv(4096):
                        pass


@pytest.mark.parametrize(
    "answers",
    [
        b"",
        bytes(48),
        b"\xff" * 480,
        usbip.Return(99, 0, 0).encode(),
        usbip.Return(1, 0, 1 << 20).encode(),
        usbip.Return(1, 0, 18, packets=3).encode() + bytes(100),
        usbip.Return(1, 0, 18).encode() + bytes(18),
        usbip.Return(1, 0, 18).encode() + LIVE_DEVICE + usbip.Return(2, 0, 9).encode() + bytes(9),
        usbip.unlinked(5, 0),
    ],
)
async def test_a_lying_server_is_an_error_in_words(answers: bytes) -> None:
    with Liar(answers) as server:
        transport = UsbIpTransport("127.0.0.1", server.port)
        with pytest.raises(ThetaError):
            async with asyncio.timeout(8):
                await transport.open(None, lambda _: None)
        await transport.close()


async def test_a_mistake_in_the_sink_ends_the_stream_in_words(camera: SimulatedThetaV, server: UsbIpServer) -> None:
    gone: list[str] = []

    def sink(_stamp_ns: int, _packets: list[Packet]) -> None:
        raise KeyError("mistake")

    transport = UsbIpTransport(server.host, server.port)
    await transport.open(None, gone.append)
    await transport.claim(2)
    block = Probe(format_index=1, frame_index=2, interval_100ns=333_667).encode(48)
    for control in (0x0100, 0x0200):
        await transport.control(0x21, 0x01, control, 2, block)
    await transport.set_interface(2, 1)
    await transport.start_video(Endpoint(0x84, ISOCHRONOUS, 3072, 1), 3072, sink)
    with Feeder(camera, PICTURES):
        await until(lambda: bool(gone))
    assert "mistake" in gone[0]
    with pytest.raises(ThetaGone, match="mistake"):
        await transport.control(0x80, 6, 0x0100, 0, 18)
    await transport.close()


@given(st.binary(min_size=48, max_size=48))
@settings(deadline=None)
def test_garbage_headers_raise_only_the_codecs_own_error(raw: bytes) -> None:
    for decode in (usbip.Submit.decode, usbip.Return.decode):
        with contextlib.suppress(ThetaMalformed):
            decode(raw)
