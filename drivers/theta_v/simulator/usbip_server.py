"""The simulated camera as a USB/IP server: for our own client, for `usbip attach` and a real kernel.

One thread serves all connections. Isochronous requests are answered when their microframes have passed,
each endpoint on a schedule of its own; a whole request costs one lookup however empty it is.
"""

from __future__ import annotations

import logging
import selectors
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

import numpy as np

from drivers.theta_v.codec import usbip
from drivers.theta_v.codec.descriptors import ISOCHRONOUS, parse_configuration
from drivers.theta_v.errors import ThetaGone, ThetaMalformed, ThetaNotFound, ThetaStall
from drivers.theta_v.simulator.camera import Port, SimulatedThetaV
from drivers.theta_v.transport.base import MICROFRAME_NS

BUSID = "1-1"
MAX_CONNECTIONS = 16  # one host and a few that only list; the rest is turned away
MAX_PENDING = 4096  # requests in flight of one host; the kernel keeps a few dozen
MAX_UNSENT_BYTES = 8 << 20  # a host that does not read gets no more video until it does
MAX_BEHIND_NS = 1_000_000_000  # after a longer pause of the process the missed microframes are not made up
LULL_NS = 16_000_000  # empty requests are answered in groups: a wake-up costs more than a request
IDLE_S = 0.05  # how late an unplugged cable or an event of the camera itself is noticed while nothing else happens
RECEIVE_BYTES = 64 << 10
OP_S = 10.0  # a connection that neither lists nor imports is closed

log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Schedule:
    """Isochronous requests of one endpoint, in order, and when the next one's microframes begin."""

    waiting: deque[tuple[usbip.Submit, bytes]] = field(default_factory=deque)
    start_ns: int = 0
    accepted: tuple[int, bytes] = (0, b"")
    """Length and descriptors of the last good request: a host sends the same again and again."""

    def accepts(self, length: int, descriptors: bytes) -> bool:
        """Whether all packets lie within the transfer."""
        if (length, descriptors) == self.accepted:
            return True
        table = usbip.iso_table(descriptors)
        if int((table[:, 0].astype(np.int64) + table[:, 1]).max()) > length:
            return False
        self.accepted = (length, descriptors)
        return True

    def slack_ns(self) -> int:
        """How much later empty requests may be answered without the host running dry."""
        packets = len(self.waiting) * self.waiting[0][0].packets if self.waiting else 0
        return min(LULL_NS, packets * MICROFRAME_NS // 2)

    def due_ns(self) -> int | None:
        return self.start_ns + self.waiting[0][0].packets * MICROFRAME_NS if self.waiting else None


class _Connection:
    """One TCP connection: an operation or two, and after an import the requests of one host."""

    def __init__(self, stream: socket.socket, peer: str) -> None:
        self.stream = stream
        self.peer = peer
        self.port: Port | None = None
        self.inbox = bytearray()
        self.outbox = bytearray()
        self.since = time.monotonic()
        self.closing = False
        self.schedules: dict[int, _Schedule] = {}
        self.reads: dict[int, deque[usbip.Submit]] = {}
        self.iso_endpoints: frozenset[int] = frozenset()

    @property
    def pending(self) -> int:
        return sum(len(s.waiting) for s in self.schedules.values()) + sum(map(len, self.reads.values()))


class UsbIpServer:
    """Serves one camera on `host:port` (port 0: any free one, see `port`) from `start()` to `close()`."""

    def __init__(self, camera: SimulatedThetaV, host: str = "127.0.0.1", port: int = 0) -> None:
        self._camera = camera
        self._address = (host, port)
        self._listener: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._wake: socket.socket | None = None
        self._closing = False
        self._connections: list[_Connection] = []

    @property
    def host(self) -> str:
        return self._address[0]

    @property
    def port(self) -> int:
        """The port it listens on. Raises RuntimeError before `start`."""
        if self._listener is None:
            raise RuntimeError("the server is not running")
        return int(self._listener.getsockname()[1])

    def start(self) -> None:
        """Listen and serve from a thread. Raises OSError when the address is taken."""
        self._listener = socket.create_server(self._address)
        self._listener.setblocking(False)
        ours, self._wake = socket.socketpair()
        self._wake.setblocking(False)
        self._camera.listen(self._poke)
        self._closing = False
        self._thread = threading.Thread(target=self._run, args=(ours,), name="theta-usbip-server", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closing = True
        self._camera.unlisten(self._poke)
        self._poke()
        if self._thread is not None:
            self._thread.join()
        for end in (self._listener, self._wake):
            if end is not None:
                end.close()
        self._listener = self._wake = self._thread = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _poke(self) -> None:
        wake = self._wake
        try:
            if wake is not None:
                wake.send(b"\0")
        except BlockingIOError:
            return  # it is full of unread wake-ups already
        except OSError as error:
            log.debug("a picture came while the server closed: %s", error)

    def _run(self, wake: socket.socket) -> None:
        listener = self._listener
        if listener is None:
            return
        with selectors.DefaultSelector() as selector, wake:
            selector.register(listener, selectors.EVENT_READ)
            selector.register(wake, selectors.EVENT_READ)
            while not self._closing:
                for key, mask in selector.select(self._rest()):
                    if key.fileobj is listener:
                        self._accept(listener, selector)
                    elif key.fileobj is wake:
                        wake.recv(4096)
                    elif isinstance(key.data, _Connection):
                        self._ready(key.data, mask)
                now_ns = time.monotonic_ns()
                for connection in list(self._connections):
                    self._work(connection, now_ns, selector)
            for connection in self._connections:
                self._drop(connection)
            self._connections.clear()

    def _rest(self) -> float:
        """Sleep while video is on schedule; else say how long to wait for messages.

        A host asks for more video after each answer. To be woken by that as well would double the work, and
        nothing it says is more urgent than a transfer's worth of microframes.
        """
        limit = self._timeout()
        if limit > LULL_NS / 1e9 or not any(s.waiting for c in self._connections for s in c.schedules.values()):
            return limit
        time.sleep(limit)
        return 0.0

    def _timeout(self) -> float:
        """Until the next isochronous request is due, or the cable and waiting transfers want a look.

        What a transfer waits for comes of a message, behind which they are looked at anyway, or has time.
        """
        limit = IDLE_S
        now_ns = time.monotonic_ns()
        for connection in self._connections:
            if len(connection.outbox) < MAX_UNSENT_BYTES:
                idle = connection.port is not None and connection.port.idle
                for schedule in connection.schedules.values():
                    due = schedule.due_ns()
                    if due is not None:
                        due += schedule.slack_ns() if idle else 0
                        limit = min(limit, max(0.0, (due - now_ns) / 1e9))
        return limit

    def _accept(self, listener: socket.socket, selector: selectors.BaseSelector) -> None:
        try:
            stream, peer = listener.accept()
        except OSError as error:
            log.debug("a connection ended before it began: %s", error)
            return
        if len(self._connections) >= MAX_CONNECTIONS:
            stream.close()
            return
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection = _Connection(stream, f"{peer[0]}:{peer[1]}")
        self._connections.append(connection)
        selector.register(stream, selectors.EVENT_READ, connection)

    def _ready(self, connection: _Connection, mask: int) -> None:
        if not mask & selectors.EVENT_READ:
            return
        try:
            data = connection.stream.recv(RECEIVE_BYTES)
            connection.inbox += data
            connection.closing |= not data
            while not connection.closing and self._message(connection):
                pass
        except BlockingIOError:
            return
        except OSError as error:
            log.debug("%s: %s", connection.peer, error)
            connection.closing = True
        except ThetaGone:
            connection.closing = True
        except ThetaMalformed as error:
            log.warning("%s does not speak USB/IP: %s", connection.peer, error)
            connection.closing = True

    def _work(self, connection: _Connection, now_ns: int, selector: selectors.BaseSelector) -> None:
        """Complete what is due, write what fits, and see whether the connection still makes sense."""
        try:
            if connection.port is not None:
                connection.closing |= not connection.port.connected
                self._complete_isochronous(connection, now_ns)
                self._complete_reads(connection)
            elif time.monotonic() - connection.since > OP_S:
                connection.closing = True
            if connection.outbox:
                sent = connection.stream.send(connection.outbox)
                del connection.outbox[:sent]
        except BlockingIOError:
            pass  # the rest goes when the socket takes more
        except (OSError, ThetaGone) as error:
            log.debug("%s: %s", connection.peer, error)
            connection.closing = True
        if connection.closing:
            selector.unregister(connection.stream)
            self._drop(connection)
            self._connections.remove(connection)
            return
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if connection.outbox else 0)
        if selector.get_key(connection.stream).events != events:
            selector.modify(connection.stream, events, connection)

    def _drop(self, connection: _Connection) -> None:
        if connection.port is not None:
            connection.port.disconnect()
            connection.port = None
        try:
            if connection.outbox:
                connection.stream.send(connection.outbox)
        except OSError as error:
            log.debug("%s: %s", connection.peer, error)
        connection.stream.close()

    def _message(self, connection: _Connection) -> bool:
        """Deal with one whole message at the front of the inbox; False when there is none."""
        inbox = connection.inbox
        if connection.port is None:
            return self._operation(connection)
        if len(inbox) < usbip.HEADER_BYTES:
            return False
        kind = int.from_bytes(inbox[:4], "big")
        if kind == usbip.CMD_UNLINK:
            _, sequence, _, _, _, victim = usbip.UNLINK.unpack_from(inbox)
            del inbox[: usbip.HEADER_BYTES]
            self._unlink(connection, sequence, victim)
            return True
        if kind != usbip.CMD_SUBMIT:
            raise ThetaMalformed(f"message of type {kind:#010x}")
        submit = usbip.Submit.decode(bytes(inbox[: usbip.HEADER_BYTES]))
        isochronous = submit.endpoint in connection.iso_endpoints
        body = 0 if submit.inward else submit.length
        end = usbip.HEADER_BYTES + body + (16 * submit.packets if isochronous else 0)
        if len(inbox) < end:
            return False
        payload = bytes(inbox[usbip.HEADER_BYTES : end])
        del inbox[:end]
        if connection.pending >= MAX_PENDING:
            raise ThetaMalformed("more requests in flight than any host makes")
        if isochronous:
            self._schedule(connection, submit, payload)
        else:
            self._transfer(connection, connection.port, submit, payload)
        return True

    def _operation(self, connection: _Connection) -> bool:
        inbox = connection.inbox
        if len(inbox) < usbip.OP_BYTES:
            return False
        version, code, _ = usbip.OP.unpack_from(inbox)
        if version >> 8 != usbip.VERSION >> 8:
            raise ThetaMalformed(f"protocol version {version:#06x}")
        if code == usbip.OP_REQ_DEVLIST:
            del inbox[: usbip.OP_BYTES]
            connection.outbox += usbip.operation(usbip.OP_REP_DEVLIST) + self._devices()
            return True
        if code != usbip.OP_REQ_IMPORT:
            raise ThetaMalformed(f"operation {code:#06x}")
        size = usbip.OP_BYTES + usbip.BUSID_BYTES
        if len(inbox) < size:
            return False
        busid = bytes(inbox[usbip.OP_BYTES : size]).split(b"\0")[0]
        del inbox[:size]
        connection.outbox += self._import(connection, busid)
        return connection.port is not None

    def _devices(self) -> bytes:
        if not self._camera.present:
            return bytes(4)
        interfaces = {s.interface: s.triple for s in reversed(parse_configuration(self._camera.configuration).settings)}
        triples = b"".join(bytes([*interfaces[i], 0]) for i in sorted(interfaces))
        return (1).to_bytes(4, "big") + self._device().encode() + triples

    def _device(self) -> usbip.Device:
        raw, configuration = self._camera.device_descriptor, self._camera.configuration
        vendor, product, release = (int.from_bytes(raw[i : i + 2], "little") for i in (8, 10, 12))
        return usbip.Device(
            f"/sys/devices/simulated/{BUSID}", BUSID, 1, 2, usbip.SPEED_HIGH, vendor, product, release,
            (raw[4], raw[5], raw[6]), configuration[5], raw[17], configuration[4],
        )  # fmt: skip

    def _import(self, connection: _Connection, busid: bytes) -> bytes:
        if busid != BUSID.encode():
            return usbip.operation(usbip.OP_REP_IMPORT, usbip.ST_NODEV)
        try:
            device = self._device().encode()
            connection.port = self._camera.connect()
        except ThetaNotFound:
            return usbip.operation(usbip.OP_REP_IMPORT, usbip.ST_NODEV)
        except ThetaStall:
            return usbip.operation(usbip.OP_REP_IMPORT, usbip.ST_BUSY)
        settings = parse_configuration(self._camera.configuration).settings
        connection.iso_endpoints = frozenset(
            e.address & 0x0F for s in settings for e in s.endpoints if e.kind == ISOCHRONOUS
        )
        return usbip.operation(usbip.OP_REP_IMPORT) + device

    def _transfer(self, connection: _Connection, port: Port, submit: usbip.Submit, data: bytes) -> None:
        """A control, bulk or interrupt request: answered now, or an IN one kept until there is something."""
        answer = b""
        status = 0
        try:
            if submit.endpoint == 0:
                answer = port.control(submit.setup, data)
            elif submit.inward:
                queue = connection.reads.setdefault(submit.endpoint, deque())
                queue.append(submit)
                return
            else:
                port.write(submit.endpoint, data)
        except ThetaStall:
            status = -usbip.EPIPE
        if status == 0 and submit.endpoint == 0 and len(answer) > submit.length:
            status = -usbip.EOVERFLOW
        if status or not submit.inward:
            moved, answer = (0 if status else submit.length), b""
        else:
            moved = len(answer)
        connection.outbox += usbip.Return(submit.sequence, status, moved).encode() + answer

    def _complete_reads(self, connection: _Connection) -> None:
        port = connection.port
        for endpoint, queue in connection.reads.items():
            while queue and port is not None:
                submit = queue[0]
                try:
                    data = port.read(0x80 | endpoint, submit.length)
                    status = 0
                except ThetaStall:
                    data, status = b"", -usbip.EPIPE
                if data is None:
                    break
                queue.popleft()
                connection.outbox += usbip.Return(submit.sequence, status, len(data)).encode() + data

    def _schedule(self, connection: _Connection, submit: usbip.Submit, descriptors: bytes) -> None:
        schedule = connection.schedules.setdefault(submit.endpoint, _Schedule())
        if not submit.inward or not submit.packets or not schedule.accepts(submit.length, descriptors):
            connection.outbox += usbip.Return(submit.sequence, -usbip.EINVAL, 0, 0).encode()
            return
        if not schedule.waiting:
            schedule.start_ns = max(schedule.start_ns, time.monotonic_ns())
        schedule.waiting.append((submit, descriptors))

    def _complete_isochronous(self, connection: _Connection, now_ns: int) -> None:
        port = connection.port
        for endpoint, schedule in connection.schedules.items():
            if schedule.waiting and now_ns - schedule.start_ns > MAX_BEHIND_NS:
                schedule.start_ns = now_ns
            while port is not None and len(connection.outbox) < MAX_UNSENT_BYTES:
                due = schedule.due_ns()
                if due is None or due > now_ns:
                    break
                submit, descriptors = schedule.waiting.popleft()
                burst = port.isochronous(0x80 | endpoint, submit.packets, schedule.start_ns)
                schedule.start_ns = due
                connection.outbox += _answer(submit, descriptors, burst.packets)

    def _unlink(self, connection: _Connection, sequence: int, victim: int) -> None:
        """Cancel a request that still waits; one that was answered already stays answered."""
        status = 0
        for schedule in connection.schedules.values():
            found = [entry for entry in schedule.waiting if entry[0].sequence == victim]
            if found:
                schedule.waiting.remove(found[0])
                status = -usbip.ECONNRESET
        for queue in connection.reads.values():
            for submit in [s for s in queue if s.sequence == victim]:
                queue.remove(submit)
                status = -usbip.ECONNRESET
        connection.outbox += usbip.unlinked(sequence, status)


def _answer(submit: usbip.Submit, descriptors: bytes, packets: list[tuple[int, int, bytes]]) -> bytes:
    """RET_SUBMIT with the packets packed one behind the other, as the kernel's stub sends them."""
    table = np.frombuffer(descriptors, ">u4").reshape(-1, 4).copy()
    table[:, 2:] = 0
    pieces = [data for _, _, data in packets]
    errors = 0
    if packets:
        slots = [slot for slot, _, _ in packets]
        statuses = [status for _, status, _ in packets]
        for i, room in enumerate(table[slots, 1].tolist()):
            # A packet longer than the host made room for is cut and said to overflow, as a host controller does.
            if len(pieces[i]) > room:
                pieces[i], statuses[i] = pieces[i][:room], -usbip.EOVERFLOW
        table[slots, 2] = [len(piece) for piece in pieces]
        table[slots, 3] = [status & 0xFFFFFFFF for status in statuses]
        errors = sum(status != 0 for status in statuses)
    body = b"".join(pieces)
    head = usbip.Return(submit.sequence, 0, len(body), submit.packets, errors, submit.start_frame)
    return b"".join((head.encode(), body, table.tobytes()))
