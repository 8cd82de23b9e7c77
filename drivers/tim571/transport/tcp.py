"""The lidar over Ethernet."""

from __future__ import annotations

import asyncio
import socket
import time
from collections import deque

from drivers.tim571.errors import TimTimeoutError, TimUnreachableError

DEFAULT_HOST = "192.168.0.1"
"""As delivered."""
DEFAULT_PORT = 2112
"""The port named "measurement data"; 2111 speaks the same."""

CONNECT_TIMEOUT_S = 3.0  # one lost SYN is sent again after 1 s, a second one after 3 s
CLOSE_TIMEOUT_S = 0.2  # the last request may still be on its way out
INBOX_BYTES = 1 << 18  # about 5 s of scans; beyond that the reader is stuck and TCP may push back
_KEEPALIVE = {  # a dead peer is noticed below us after about 8 s even if nobody is waiting for scans
    "TCP_KEEPIDLE": 5,
    "TCP_KEEPINTVL": 1,
    "TCP_KEEPCNT": 3,
}


class TcpTransport:
    """A TCP connection to a TiM571. Bytes are stamped as the event loop hands them over."""

    def __init__(
        self, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT, connect_timeout_s: float = CONNECT_TIMEOUT_S
    ) -> None:
        if not 0 < port < 1 << 16:
            raise ValueError(f"{port} is no TCP port; a TiM571 serves 2111 and 2112")
        self._host = host
        self._port = port
        self._connect_timeout_s = connect_timeout_s
        self._inbox: _Inbox | None = None

    @property
    def name(self) -> str:
        return f"{self._host}:{self._port}"

    async def open(self) -> None:
        await self.close()
        try:
            async with asyncio.timeout(self._connect_timeout_s):
                _, self._inbox = await asyncio.get_running_loop().create_connection(
                    lambda: _Inbox(self.name), self._host, self._port
                )
        except TimeoutError as error:
            raise TimTimeoutError(
                f"TiM571 at {self.name} did not take the connection within {self._connect_timeout_s:g} s: check"
                " its 24 V supply, the cable and its IP address; after power-on it needs up to 30 s."
            ) from error
        except ConnectionRefusedError as error:
            raise TimUnreachableError(
                f"TiM571 at {self.name} refuses the connection: the address answers but nothing listens on that"
                " port; a TiM571 serves ports 2111 and 2112, and needs up to 30 s after power-on."
            ) from error
        except (socket.gaierror, UnicodeError) as error:
            raise TimUnreachableError(
                f"TiM571 at {self.name} cannot be found: {self._host} is not a known host name; give its IP"
                f" address ({DEFAULT_HOST} as delivered)."
            ) from error
        except OSError as error:
            raise TimUnreachableError(
                f"TiM571 at {self.name} cannot be reached ({error.strerror or error}): check its 24 V supply, the"
                " cable, and that this computer has an address in the lidar's network."
            ) from error

    async def read(self) -> tuple[int, bytes]:
        return await self._connected().take()

    async def write(self, data: bytes) -> None:
        self._connected().send(data)

    async def close(self) -> None:
        inbox, self._inbox = self._inbox, None
        if inbox is not None:
            await inbox.close()

    def _connected(self) -> _Inbox:
        if self._inbox is None:
            raise TimUnreachableError(f"TiM571 at {self.name} is not connected.")
        return self._inbox


class _Inbox(asyncio.Protocol):
    """Stamped chunks waiting for the reader, bounded by TCP's own back-pressure."""

    def __init__(self, peer: str) -> None:
        self._peer = peer
        self._chunks: deque[tuple[int, bytes]] = deque()
        self._size = 0
        self._ended = False
        self._broken: Exception | None = None
        self._news = asyncio.Event()
        self._lost = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)  # noqa: S101 - create_connection makes no other kind
        self._transport = transport
        link: socket.socket = transport.get_extra_info("socket")
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEPALIVE.items():
            if hasattr(socket, option):
                link.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    def data_received(self, data: bytes) -> None:
        self._chunks.append((time.monotonic_ns(), data))
        self._size += len(data)
        if self._size > INBOX_BYTES:
            self._transport.pause_reading()
        self._news.set()

    def eof_received(self) -> bool:
        self._ended = True
        self._news.set()
        return False

    def connection_lost(self, exc: Exception | None) -> None:
        self._ended = True
        self._broken = exc
        self._news.set()
        self._lost.set()

    async def take(self) -> tuple[int, bytes]:
        while not self._chunks:
            if self._broken is not None:
                raise TimUnreachableError(
                    f"TiM571 at {self._peer} dropped the connection ({self._broken})."
                ) from self._broken
            if self._ended:
                return time.monotonic_ns(), b""
            self._news.clear()
            await self._news.wait()
        stamp_ns, data = self._chunks.popleft()
        self._size -= len(data)
        if self._size <= INBOX_BYTES and not self._transport.is_closing():
            self._transport.resume_reading()
        return stamp_ns, data

    def send(self, data: bytes) -> None:
        if self._transport.is_closing():
            raise TimUnreachableError(f"TiM571 at {self._peer} has closed the connection.")
        self._transport.write(data)

    async def close(self) -> None:
        self._transport.close()
        try:
            async with asyncio.timeout(CLOSE_TIMEOUT_S):
                await self._lost.wait()
        except TimeoutError:
            self._transport.abort()
            await self._lost.wait()
