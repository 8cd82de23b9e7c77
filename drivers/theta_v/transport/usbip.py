"""A USB/IP client in pure Python: the camera of another process or machine, without a kernel driver.

One thread owns the connection: it reads answers, resubmits isochronous requests before it hands their
packets on, and writes what the event loop asks for.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import selectors
import socket
import struct
import threading
import time
from collections import deque
from dataclasses import dataclass

import numpy as np

from drivers.theta_v.codec import usbip
from drivers.theta_v.codec.descriptors import Configuration, parse_configuration
from drivers.theta_v.codec.payload import Packet
from drivers.theta_v.errors import (
    ThetaError,
    ThetaGone,
    ThetaMalformed,
    ThetaNotFound,
    ThetaRefused,
    ThetaStall,
    ThetaTimeout,
    ThetaWrongDevice,
)
from drivers.theta_v.transport.base import (
    BULK_S,
    CONTROL_S,
    RICOH,
    SET_CONFIGURATION,
    SET_INTERFACE,
    Claims,
    GoneSink,
    Identity,
    PacketSink,
    read_configuration,
    read_device_descriptor,
    read_identity,
)

DEFAULT_PORT = 3240  # IANA: usbip

CONNECT_S = 3.0  # a server on this machine or this network answers in milliseconds
REAP_S = 2.0  # cancelled transfers come back within one round trip
PACKETS_PER_URB = 32  # 4 ms of microframes: what batching may add to the latency of a picture
URBS_IN_FLIGHT = 32  # 128 ms: survives a pause of the interpreter (fact sheet 5.2)
MAX_URB_ERRORS = 32  # in a row: the endpoint is dead, do not resubmit for ever
MAX_ANSWER_BYTES = 1 << 20  # nothing this driver asks for is larger
RECEIVE_BYTES = 256 << 10

log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Pending:
    """One request on its way. Without a future it is isochronous, or nobody waits for it any more."""

    inward: bool
    length: int
    packets: int
    future: asyncio.Future[bytes] | None
    what: str


class UsbIpTransport:
    """A `UsbTransport` to a USB/IP server at `host:port`. See `UsbTransport` for the methods."""

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        *,
        packets_per_urb: int = PACKETS_PER_URB,
        urbs: int = URBS_IN_FLIGHT,
    ) -> None:
        if not 1 <= packets_per_urb <= usbip.MAX_PACKETS or urbs < 1:
            raise ValueError("a transfer has 1 to 1024 packets, and at least one must be in flight")
        self._host, self._port = host, port
        self._packets_per_urb, self._urbs = packets_per_urb, urbs
        self._claims = Claims()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._on_gone: GoneSink | None = None
        self._socket: socket.socket | None = None
        self._wake: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._devid = 0
        self._sequence = itertools.count(1)
        self._lock = threading.Lock()
        self._pending: dict[int, _Pending] = {}
        self._unlinking: dict[int, int] = {}
        self._outbox: deque[bytes] = deque()
        self._gone: str | None = None
        self._closing = False
        self._iso = _Isochronous()
        self._device_descriptor = b""
        self._configuration = b""
        self._parsed = Configuration(0, ())
        self._identity: Identity | None = None

    @property
    def name(self) -> str:
        return f"USB/IP server {self._host}:{self._port}"

    @property
    def identity(self) -> Identity:
        if self._identity is None:
            raise ThetaGone("the camera is not open")
        return self._identity

    @property
    def device_descriptor(self) -> bytes:
        return self._device_descriptor

    @property
    def configuration(self) -> bytes:
        return self._configuration

    async def open(self, serial: str | None, on_gone: GoneSink) -> None:
        devices = [d for d in await self._list() if d.vendor_id == RICOH]
        if not devices:
            raise ThetaNotFound(f"no THETA on the {self.name}; is it plugged in and switched on?")
        others: list[str] = []
        for device in devices:
            await self._attach(device, on_gone)
            try:
                await self._read_descriptors()
                who = self.identity
                if who.is_theta and serial in (None, who.serial):
                    await self.control(0x00, SET_CONFIGURATION, self._parsed.value, 0)
                    return
                others.append(f"{who.product or 'an unnamed device'} {who.serial}".strip())
            except BaseException:
                await self.close()
                raise
            await self.close()
        wanted = f"a THETA with serial number {serial}" if serial else "a THETA"
        raise ThetaWrongDevice(f"the {self.name} has {', '.join(others)}, but not {wanted}")

    async def close(self) -> None:
        thread, self._thread = self._thread, None
        self._on_gone = None
        self._closing = True
        self._iso.sink = None
        if self._wake is not None:
            self._poke()
        try:
            if thread is not None:
                await asyncio.to_thread(thread.join)  # it may be handing on packets: do not block the loop
        finally:
            for end in (self._socket, self._wake):
                if end is not None:
                    end.close()
            self._socket = self._wake = None
            self._claims.clear()
            self._fail_all("the connection was closed")

    async def control(
        self,
        request_type: int,
        request: int,
        value: int,
        index: int,
        data_or_length: bytes | int = b"",
        timeout_s: float = CONTROL_S,
    ) -> bytes:
        inward = bool(request_type & 0x80)
        data = b"" if isinstance(data_or_length, int) else data_or_length
        length = data_or_length if isinstance(data_or_length, int) else len(data)
        if inward != isinstance(data_or_length, int) and length:
            raise ValueError("the direction of the request and of its data differ")
        setup = struct.pack("<BBHHH", request_type, request, value, index, length)
        return await self._transfer(0, inward, data, length, timeout_s, f"request {request:#04x}", setup)

    async def bulk_out(self, endpoint: int, data: bytes, timeout_s: float = BULK_S) -> None:
        self._need(endpoint)
        await self._transfer(endpoint, False, data, len(data), timeout_s, f"endpoint {endpoint:#04x}")

    async def bulk_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        self._need(endpoint)
        return await self._transfer(endpoint, True, b"", length, timeout_s, f"endpoint {endpoint:#04x}")

    async def interrupt_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        return await self.bulk_in(endpoint, length, timeout_s)

    async def set_interface(self, interface: int, alternate: int) -> None:
        self._claims.need(interface)
        await self.control(0x01, SET_INTERFACE, alternate, interface)

    async def claim(self, interface: int) -> None:
        self._claims.add(interface)

    async def release(self, interface: int) -> None:
        self._claims.drop(interface)

    async def start_isochronous(self, endpoint: int, packet_bytes: int, on_packets: PacketSink) -> None:
        self._need(endpoint)
        if self._iso.sink is not None:
            raise RuntimeError("an isochronous stream is running already")
        self._iso = _Isochronous(endpoint & 0x0F, packet_bytes, self._packets_per_urb, on_packets)
        with self._lock:
            messages = [self._iso_submit(self._iso) for _ in range(self._urbs)]
        self._send(b"".join(messages))

    async def stop_isochronous(self) -> None:
        with self._lock:
            self._iso.sink = None
            victims = [seq for seq, p in self._pending.items() if p.packets]
            messages = [self._unlink(victim) for victim in victims]
        if not messages or self._gone is not None:
            return
        self._send(b"".join(messages))
        deadline = time.monotonic() + REAP_S
        while not self._reaped(victims):
            if time.monotonic() > deadline:
                raise ThetaTimeout(f"the {self.name} does not give transfers back; restart it")
            await asyncio.sleep(0.002)

    def _reaped(self, victims: list[int]) -> bool:
        with self._lock:
            return self._gone is not None or not any(v in self._pending for v in victims)

    async def _list(self) -> list[usbip.Device]:
        stream = await self._dial()
        try:
            async with asyncio.timeout(CONNECT_S):
                loop = asyncio.get_running_loop()
                await loop.sock_sendall(stream, usbip.operation(usbip.OP_REQ_DEVLIST))
                head = await _exactly(stream, usbip.OP_BYTES + 4)
                usbip.decode_operation(head[:8], usbip.OP_REP_DEVLIST)
                count = int.from_bytes(head[8:], "big")
                if count > usbip.MAX_DEVICES:
                    raise ThetaMalformed(f"the {self.name} claims {count} devices")
                devices: list[usbip.Device] = []
                for _ in range(count):
                    device = usbip.Device.decode(await _exactly(stream, usbip.DEVICE.size))
                    await _exactly(stream, 4 * device.interfaces)
                    devices.append(device)
                return devices
        except TimeoutError:
            raise ThetaTimeout(f"the {self.name} does not answer; is it a USB/IP server?") from None
        except ConnectionError as error:
            raise ThetaGone(f"the {self.name} hung up: {error}") from None
        finally:
            stream.close()

    async def _dial(self) -> socket.socket:
        loop = asyncio.get_running_loop()
        stream = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            stream.setblocking(False)
            stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            async with asyncio.timeout(CONNECT_S):
                found = await loop.getaddrinfo(self._host, self._port, family=socket.AF_INET)
                await loop.sock_connect(stream, found[0][4])
        except ConnectionRefusedError:
            stream.close()
            raise ThetaNotFound(f"no {self.name}; start it, or check the address") from None
        except (OSError, UnicodeError) as error:  # a name that is none is a UnicodeError
            stream.close()
            raise ThetaNotFound(f"cannot reach the {self.name}: {error or 'no answer'}") from None
        except BaseException:
            stream.close()
            raise
        return stream

    async def _attach(self, device: usbip.Device, on_gone: GoneSink) -> None:
        stream = await self._dial()
        try:
            async with asyncio.timeout(CONNECT_S):
                loop = asyncio.get_running_loop()
                busid = device.busid.encode().ljust(usbip.BUSID_BYTES, b"\0")
                await loop.sock_sendall(stream, usbip.operation(usbip.OP_REQ_IMPORT) + busid)
                self._granted(usbip.decode_operation(await _exactly(stream, 8), usbip.OP_REP_IMPORT))
                device = usbip.Device.decode(await _exactly(stream, usbip.DEVICE.size))
        except ThetaError:
            stream.close()
            raise
        except TimeoutError:
            stream.close()
            raise ThetaTimeout(f"the {self.name} does not hand out the camera; restart it") from None
        except ConnectionError as error:
            stream.close()
            raise ThetaGone(f"the {self.name} hung up: {error}") from None
        except BaseException:
            stream.close()
            raise
        self._loop = asyncio.get_running_loop()
        self._on_gone, self._gone, self._closing = on_gone, None, False
        self._devid = device.devid
        self._iso = _Isochronous()
        self._outbox.clear()
        self._socket = stream
        ours, self._wake = socket.socketpair()
        for end in (ours, self._wake):
            end.setblocking(False)
        self._thread = threading.Thread(target=self._run, args=(stream, ours), name="theta-usbip", daemon=True)
        self._thread.start()

    def _granted(self, status: int) -> None:
        if status in (usbip.ST_NODEV, usbip.ST_ERROR):
            raise ThetaNotFound(f"the camera just left the {self.name}; is it changing its mode?")
        if status != usbip.ST_OK:
            raise ThetaRefused("another program holds the camera; end it and try again")

    async def _read_descriptors(self) -> None:
        self._device_descriptor = await read_device_descriptor(self)
        self._configuration = await read_configuration(self)
        self._parsed = parse_configuration(self._configuration)
        self._identity = await read_identity(self, self._device_descriptor)

    def _need(self, endpoint: int) -> None:
        for setting in self._parsed.settings:
            if any(e.address == endpoint for e in setting.endpoints):
                self._claims.need(setting.interface)
                return
        raise RuntimeError(f"the camera has no endpoint {endpoint:#04x}")

    async def _transfer(
        self,
        endpoint: int,
        inward: bool,
        data: bytes,
        length: int,
        timeout_s: float,
        what: str,
        setup: bytes = bytes(8),
    ) -> bytes:
        future: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        with self._lock:
            if self._gone is not None or self._socket is None:
                raise ThetaGone(self._gone or "the camera is not open")
            sequence = next(self._sequence)
            self._pending[sequence] = _Pending(inward, length, 0, future, what)
        submit = usbip.Submit(sequence, self._devid, inward, endpoint & 0x0F, length, 0, setup=setup)
        self._send(submit.encode() + data)
        try:
            async with asyncio.timeout(timeout_s):
                return await future
        except TimeoutError:
            raise ThetaTimeout(f"the camera did not answer {what} within {timeout_s:g} s") from None
        finally:
            if not future.done() or future.cancelled():
                with self._lock:
                    waiting = self._pending.get(sequence)
                    message = self._unlink(sequence) if waiting is not None else b""
                self._send(message)

    def _unlink(self, victim: int) -> bytes:
        sequence = next(self._sequence)
        self._unlinking[sequence] = victim
        self._pending[victim].future = None
        return usbip.unlink(sequence, self._devid, victim)

    def _iso_submit(self, iso: _Isochronous) -> bytes:
        sequence = next(self._sequence)
        self._pending[sequence] = _Pending(True, iso.length, iso.packets, None, "video")
        head = usbip.Submit(sequence, self._devid, True, iso.endpoint, iso.length, iso.packets, interval=1)
        return head.encode() + iso.request

    def _send(self, message: bytes) -> None:
        if message and self._gone is None:
            self._outbox.append(message)
            self._poke()

    def _poke(self) -> None:
        try:
            if self._wake is not None:
                self._wake.send(b"\0")
        except BlockingIOError:
            return  # it is full of unread wake-ups already
        except OSError as error:
            log.debug("the connection's thread has ended: %s", error)

    def _run(self, stream: socket.socket, wake: socket.socket) -> None:
        """The connection's thread. Ends when asked to or when the connection does, and says why."""
        reason = ""
        try:
            with selectors.DefaultSelector() as selector, wake:
                selector.register(stream, selectors.EVENT_READ)
                selector.register(wake, selectors.EVENT_READ)
                self._serve(stream, wake, selector)
        except ThetaError as error:
            reason = str(error)
        except OSError as error:
            reason = f"the connection to the {self.name} broke: {error}"
        if not self._closing:
            self._fail_all(reason)

    def _serve(self, stream: socket.socket, wake: socket.socket, selector: selectors.BaseSelector) -> None:
        buffer = bytearray(RECEIVE_BYTES)
        filled = 0
        unsent = b""
        waiting_to_write = False
        while not self._closing:
            ready = selector.select()
            now_ns = time.monotonic_ns()
            for key, _ in ready:
                if key.fileobj is wake:
                    wake.recv(4096)
            if filled == len(buffer):
                if len(buffer) > 2 * MAX_ANSWER_BYTES:
                    raise ThetaMalformed(f"the {self.name} sends an endless answer")
                buffer = buffer.ljust(2 * len(buffer), b"\0")
            try:
                count = stream.recv_into(memoryview(buffer)[filled:])
                if not count:
                    raise ThetaGone("the camera left the bus: unplugged, switched off or changing its mode")
                filled += count
                used = self._answers(memoryview(buffer)[:filled], now_ns)
                if used:
                    buffer[: filled - used] = buffer[used:filled]
                    filled -= used
            except BlockingIOError:
                pass  # woken to write
            while unsent or self._outbox:
                unsent = unsent or self._outbox.popleft()
                try:
                    unsent = unsent[stream.send(unsent) :]
                except BlockingIOError:
                    break
            if waiting_to_write != bool(unsent):
                waiting_to_write = bool(unsent)
                events = selectors.EVENT_READ | (selectors.EVENT_WRITE if unsent else 0)
                selector.modify(stream, events)

    def _answers(self, data: memoryview, now_ns: int) -> int:
        """Deal with all whole answers in `data`; return how many bytes they took."""
        at = 0
        packets: list[Packet] = []
        while len(data) - at >= usbip.HEADER_BYTES:
            kind = int.from_bytes(data[at : at + 4], "big")
            if kind == usbip.RET_UNLINK:
                self._unlinked(bytes(data[at : at + usbip.HEADER_BYTES]))
                at += usbip.HEADER_BYTES
                continue
            if kind != usbip.RET_SUBMIT:
                raise ThetaMalformed(f"the {self.name} sends something that is not USB/IP")
            answer = usbip.Return.decode(bytes(data[at : at + usbip.HEADER_BYTES]))
            waiting = self._pending.get(answer.sequence)
            if waiting is None:
                raise ThetaMalformed(f"the {self.name} answers a question nobody asked")
            if answer.length > waiting.length or answer.packets != waiting.packets:
                raise ThetaMalformed(f"the {self.name} answers {answer.length} bytes to {waiting.what}")
            body = answer.length if waiting.inward else 0
            end = at + usbip.HEADER_BYTES + body + 16 * answer.packets
            if end > len(data):
                break
            with self._lock:
                del self._pending[answer.sequence]
            payload = data[at + usbip.HEADER_BYTES : end]
            if waiting.packets:
                packets += self._isochronous(answer, payload, body)
            else:
                self._settle(waiting, answer.status, bytes(payload))
            at = end
        sink = self._iso.sink
        if packets and sink is not None:
            sink(now_ns, packets)
        return at

    def _isochronous(self, answer: usbip.Return, payload: memoryview, body: int) -> list[Packet]:
        iso = self._iso
        if answer.status == -usbip.ENODEV:
            raise ThetaGone("the camera left the bus: unplugged, switched off or changing its mode")
        iso.errors = iso.errors + 1 if answer.status else 0
        if iso.errors > MAX_URB_ERRORS:
            raise ThetaGone("the camera's video endpoint is dead; unplug and replug the camera")
        with self._lock:
            if iso.sink is not None:
                self._outbox.append(self._iso_submit(iso))
        table = np.frombuffer(payload[body:], ">u4").reshape(-1, 4)
        if not body and not table[:, 3].any():
            return []
        lengths = table[:, 2]
        if int(lengths.sum()) != body or int(lengths.max()) > iso.packet_bytes:
            raise ThetaMalformed(f"the {self.name} sends packets that do not add up")
        found = np.flatnonzero(lengths | table[:, 3])
        packets: list[Packet] = []
        at = 0
        for size, status in table[found, 2:4].astype(np.int32).tolist():
            packets.append((status, payload[at : at + size]))
            at += size
        return packets

    def _settle(self, waiting: _Pending, status: int, data: bytes) -> None:
        error: ThetaError | None = None
        if status == -usbip.EPIPE:
            error = ThetaStall(f"the camera refuses {waiting.what}")
        elif status == -usbip.ENODEV:
            error = ThetaGone("the camera left the bus")
        elif status:
            error = ThetaGone(f"USB error {-status} during {waiting.what}")
        self._resolve(waiting.future, error or data)

    def _resolve(self, future: asyncio.Future[bytes] | None, outcome: bytes | ThetaError) -> None:
        def settle() -> None:
            if future is None or future.done():
                return
            if isinstance(outcome, bytes):
                future.set_result(outcome)
            else:
                future.set_exception(outcome)

        if future is None or self._loop is None:
            return
        try:
            self._loop.call_soon_threadsafe(settle)
        except RuntimeError:
            log.debug("an answer of the camera came after the event loop had ended")

    def _unlinked(self, raw: bytes) -> None:
        sequence, status = struct.unpack_from(">I12xi", raw, 4)
        victim = self._unlinking.pop(sequence, None)
        if victim is None:
            raise ThetaMalformed(f"the {self.name} cancels something nobody asked to cancel")
        if status:
            with self._lock:
                self._pending.pop(victim, None)

    def _fail_all(self, reason: str) -> None:
        with self._lock:
            first = self._gone is None
            self._gone = self._gone or reason
            waiting = [p.future for p in self._pending.values()]
            self._pending.clear()
            self._unlinking.clear()
        for future in waiting:
            self._resolve(future, ThetaGone(reason))
        if first and self._on_gone is not None:
            self._on_gone(reason)


class _Isochronous:
    """The running video stream: what is resubmitted, and to whom its packets go."""

    def __init__(
        self, endpoint: int = 0, packet_bytes: int = 0, packets: int = 0, sink: PacketSink | None = None
    ) -> None:
        self.endpoint = endpoint
        self.packet_bytes = packet_bytes
        self.packets = packets
        self.length = packets * packet_bytes
        self.request = usbip.iso_request(packets, packet_bytes)
        self.sink = sink
        self.errors = 0


async def _exactly(stream: socket.socket, count: int) -> bytes:
    loop = asyncio.get_running_loop()
    data = bytearray()
    while len(data) < count:
        piece = await loop.sock_recv(stream, count - len(data))
        if not piece:
            raise ConnectionResetError("it closed the connection")
        data += piece
    return bytes(data)
