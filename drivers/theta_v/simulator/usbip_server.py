"""The simulated camera as a USB/IP server: for our own client, for `usbip attach` and a real kernel.

One thread serves all connections. Isochronous requests are answered when their microframes have passed.
"""

from __future__ import annotations

import logging
import selectors
import socket
import threading
import time
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from drivers.theta_v.errors import ThetaGone, ThetaMalformed
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.usbip_schedule import LULL_NS
from drivers.theta_v.simulator.usbip_session import Session

MAX_CONNECTIONS = 16  # one host and a few that only list; the rest is turned away
IDLE_S = 0.05  # how late an unplugged cable or an event of the camera itself is noticed while nothing else happens
RECEIVE_BYTES = 64 << 10
OP_S = 10.0  # a connection that neither lists nor imports is closed

log = logging.getLogger(__name__)


@dataclass(eq=False, slots=True)
class _Connection:
    """One TCP connection and what is said over it."""

    stream: socket.socket
    peer: str
    session: Session
    since: float = field(default_factory=time.monotonic)
    closing: bool = False


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
                    elif isinstance(key.data, _Connection) and mask & selectors.EVENT_READ:
                        self._receive(key.data)
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
        if limit > LULL_NS / 1e9 or not any(c.session.streaming for c in self._connections):
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
            due_ns = connection.session.due_ns()
            if due_ns is not None:
                limit = min(limit, max(0.0, (due_ns - now_ns) / 1e9))
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
        connection = _Connection(stream, f"{peer[0]}:{peer[1]}", Session(self._camera))
        self._connections.append(connection)
        selector.register(stream, selectors.EVENT_READ, connection)

    def _receive(self, connection: _Connection) -> None:
        try:
            data = connection.stream.recv(RECEIVE_BYTES)
            connection.closing |= not data
            connection.session.receive(data)
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
        session = connection.session
        try:
            connection.closing |= session.lost
            connection.closing |= not session.attached and time.monotonic() - connection.since > OP_S
            if not connection.closing:
                session.complete(now_ns)
            if session.outbox:
                sent = connection.stream.send(session.outbox)
                del session.outbox[:sent]
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
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if session.outbox else 0)
        if selector.get_key(connection.stream).events != events:
            selector.modify(connection.stream, events, connection)

    def _drop(self, connection: _Connection) -> None:
        connection.session.close()
        try:
            if connection.session.outbox:
                connection.stream.send(connection.session.outbox)
        except OSError as error:
            log.debug("%s: %s", connection.peer, error)
        connection.stream.close()
