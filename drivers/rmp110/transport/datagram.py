"""A V3 base on Ethernet: one packet per UDP datagram (fact sheet sections 10, 11)."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import threading
import time
from collections.abc import Callable

from drivers.rmp110.codec.bytestream import pack_command
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.v3.packets import POWER_DOWN, POWER_DOWN_PORT, POWERING_DOWN, parse_packet
from drivers.rmp110.codec.v3.whitelist import forbidden
from drivers.rmp110.errors import RmpForbiddenFrame, RmpInterfaceError, RmpLinkError, RmpSendDropped
from drivers.rmp110.transport.base import FrameSink, LossSink

log = logging.getLogger(__name__)

PORT = 8080
"""The base's; the vendor's driver binds the same one on the computer's side."""
DATAGRAM_BYTES = 2048
"""More than the longest packet: what is longer is cut, and no packet then."""
BURST = 128
"""Datagrams read at a time, more than a second's worth: the loop stays alive whatever floods the port."""
FULL = {errno.EAGAIN, errno.ENOBUFS}
NO_WAY = {errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN, errno.EADDRNOTAVAIL}


class DatagramTransport:
    """`host` is the base's IPv4 address. Nothing but V3 packets is ever sent: only for a base known to speak it."""

    def __init__(
        self,
        host: str,
        port: int = PORT,
        *,
        local_port: int | None = None,
        notice_port: int = POWER_DOWN_PORT,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Without `local_port` the base's own number is bound, on this very computer any free one."""
        self._where = f"{host}:{port}"
        self._address = (host, port)
        self._local_port = local_port
        self._notice_port = notice_port
        self._clock = clock
        self._sending = threading.Lock()
        self._peer: tuple[str, int] = ("", 0)
        self._socket: socket.socket | None = None
        self._notices: socket.socket | None = None
        self._lost: str | None = None
        self.damaged = 0
        """Datagrams that are no packet of a V3 base."""

    async def open(self, on_frame: FrameSink, on_lost: LossSink) -> None:
        """Raises RmpInterfaceError."""
        self._on_frame = on_frame
        self._on_lost = on_lost
        self._loop = loop = asyncio.get_running_loop()
        try:
            found = await loop.getaddrinfo(*self._address, family=socket.AF_INET, type=socket.SOCK_DGRAM)
            host, port = found[0][4][:2]
            self._peer = str(host), int(port)
            mine = self._local_port
            if mine is None:
                mine = 0 if self._peer[0].startswith("127.") else self._peer[1]
            self._socket = _bound(mine)
            self._socket.connect(self._peer)
        except OSError as error:
            await self.close()
            raise RmpInterfaceError(self._sentence(error)) from error
        loop.add_reader(self._socket, self._read, self._socket)
        self._listen_for_notices()

    def send(self, frame: Frame) -> None:
        """See `Transport.send`."""
        reason = forbidden(frame)
        if reason is not None:
            raise RmpForbiddenFrame(f"stopped right before the wire: {reason}")
        with self._sending:
            if self._socket is None or self._lost is not None:
                raise RmpLinkError(self._lost or f"the connection to {self._where} is not open")
            try:
                self._socket.send(pack_command(frame))
            except OSError as error:
                if error.errno in FULL:
                    raise RmpSendDropped(f"the network did not take a command to {self._where}: it is full") from error
                sentence = self._sentence(error)
                self._loop.call_soon_threadsafe(self._lose, sentence)
                raise RmpLinkError(sentence) from error

    async def close(self) -> None:
        """Never raises, may be called without `open`."""
        with self._sending:
            sockets = [one for one in (self._socket, self._notices) if one]
            self._socket = self._notices = None
        for one in sockets:
            asyncio.get_running_loop().remove_reader(one)
            one.close()

    def _listen_for_notices(self) -> None:
        try:
            self._notices = _bound(self._notice_port)
        except OSError as error:
            # Silence says the same half a minute later.
            log.info("power-down notices on UDP port %d are not heard: %s", self._notice_port, error.strerror)
            return
        self._loop.add_reader(self._notices, self._read_notice, self._notices)

    def _read(self, sock: socket.socket) -> None:
        for _ in range(BURST):
            try:
                data, sender = sock.recvfrom(DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except OSError as error:
                self._lose(self._sentence(error))
                return
            # What came between binding and connecting may be from anybody.
            frame = parse_packet(data) if sender == self._peer else None
            if frame is None:
                self.damaged += 1
            elif self._socket is not None:
                self._on_frame(self._clock(), frame)

    def _read_notice(self, sock: socket.socket) -> None:
        try:
            data, sender = sock.recvfrom(DATAGRAM_BYTES)
        except OSError as error:
            log.debug("no notice: %s", error)
            return
        if data == POWER_DOWN and sender[0] == self._peer[0]:
            self._on_frame(self._clock(), Frame(POWERING_DOWN, data))
        else:
            self.damaged += 1

    def _lose(self, sentence: str) -> None:
        if self._lost is None and self._socket is not None:
            self._lost = sentence
            self._on_lost(sentence)

    def _sentence(self, error: OSError) -> str:
        if error.errno == errno.ECONNREFUSED:
            return f"nobody answers at {self._where}: check the base's address, and that it is on"
        if error.errno in NO_WAY:
            return (
                f"no way to {self._where}: check the Ethernet cable, and that this computer has an address "
                "in the base's network"
            )
        if error.errno == errno.EADDRINUSE:
            return f"UDP port {self._local_port or self._address[1]} is in use: stop the other program first"
        if isinstance(error, socket.gaierror):
            return f"the base's address '{self._address[0]}' is unknown: give its IPv4 address"
        return f"the connection to {self._where} failed: {error.strerror or error}"


def _bound(port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setblocking(False)
        sock.bind(("", port))
    except OSError:
        sock.close()
        raise
    return sock
