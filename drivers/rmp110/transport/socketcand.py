"""A CAN bus behind a socketcand server, as a python-can bus.

python-can brings a socketcand client too, but 4.6.1 takes a closed connection for silence (its reader then
spins and never reports), keeps a core busy for 10 s where the server is not there, expects handshake
answers in packets of their own, and blocks in `send`. This one does none of that.
"""

from __future__ import annotations

import errno
import fcntl
import select
import socket
import struct
import time
from collections import deque

import can

from drivers.rmp110.transport.socketcand_text import TextSplitter, format_send, parse_frame

CONNECT_TIMEOUT_S = 2.0
"""A server on the robot or in its network answers within milliseconds."""
SEND_BUFFER_BYTES = 4096
"""About a hundred frames: behind a server that no longer reads, motion must not pile up in the kernel."""
UNHEARD_MS = 2000
"""A server that acknowledges nothing for so long is gone, though nobody closed the connection."""
CHUNK_BYTES = 65536
SIOCOUTQNSD = 0x894B
"""Linux' question for the bytes of a TCP socket that were not sent yet; Python does not name it."""


class SocketcandBus(can.BusABC):
    """`channel` of the socketcand server at `host`:`port`.

    Raises OSError where the server cannot be reached, CanInitializationError where it refuses.
    """

    def __init__(
        self,
        channel: str,
        host: str,
        port: int,
        connect_timeout_s: float = CONNECT_TIMEOUT_S,
    ) -> None:
        self.channel_info = f"socketcand {channel} at {host}:{port}"
        self._splitter = TextSplitter()
        self._texts: deque[str] = deque()
        self._unsent = b""
        self._deadline = time.monotonic() + connect_timeout_s
        self._socket = socket.create_connection((host, port), connect_timeout_s)
        try:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNHEARD_MS)
            self._expect("hi")
            self._socket.sendall(f"< open {channel} >".encode("ascii"))
            self._expect("ok")
            self._socket.sendall(b"< rawmode >")
            self._expect("ok")
            self._socket.setblocking(False)
            self._readable = select.poll()
            self._readable.register(self._socket, select.POLLIN)
            super().__init__(channel=channel)
        except BaseException:
            self._socket.close()
            # The base class warns about buses that were never shut down; this one never opened.
            self._is_shutdown = True
            raise

    def _expect(self, answer: str) -> None:
        while not self._texts:
            # One deadline for the whole handshake: a server that drips bytes does not hold us.
            self._socket.settimeout(max(0.001, self._deadline - time.monotonic()))
            data = self._socket.recv(CHUNK_BYTES)
            if not data:
                raise can.CanInitializationError("the server closed the connection during the handshake")
            self._texts.extend(self._splitter.feed(data))
        text = self._texts.popleft()
        if text != answer:
            raise can.CanInitializationError(f"the server answered '{text}' instead of '{answer}'")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._texts and self._readable.poll(None if timeout is None else max(0.0, timeout) * 1000):
            try:
                data = self._socket.recv(CHUNK_BYTES)
            except OSError as error:
                raise can.CanOperationError(f"connection to the server lost: {error}", error.errno) from error
            if not data:
                raise can.CanOperationError("the server closed the connection", errno.ECONNRESET)
            self._texts.extend(self._splitter.feed(data))
        while self._texts:
            message = parse_frame(self._texts.popleft())
            if message is not None:
                return message, False
            self._splitter.damaged += 1
        return None, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hand one frame to the kernel, or raise CanOperationError with ENOBUFS; never waits."""
        if self._unsent:
            self._unsent = self._unsent[self._write(self._unsent) :]
            if self._unsent:
                raise can.CanOperationError("transmit buffer full", errno.ENOBUFS)
        text = format_send(msg)
        written = self._write(text)
        if written == 0:
            raise can.CanOperationError("transmit buffer full", errno.ENOBUFS)
        # Half a message would break the stream: the rest of this one frame goes first next time.
        self._unsent = text[written:]

    def _write(self, data: bytes) -> int:
        try:
            return self._socket.send(data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise can.CanOperationError(f"connection to the server lost: {error}", error.errno) from error

    def shutdown(self) -> None:
        super().shutdown()
        if self._waiting_bytes():
            # A server that cannot be reached now must not get old motion later: a reset takes back what waits.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._socket.close()

    def _waiting_bytes(self) -> int:
        """What the kernel has not even put on the wire; a zero that is on its way already may arrive."""
        if self._socket.fileno() < 0:
            return 0
        (count,) = struct.unpack("i", fcntl.ioctl(self._socket, SIOCOUTQNSD, bytes(4)))
        return int(count)

    @property
    def damaged(self) -> int:
        """Pieces of text that were no frame."""
        return self._splitter.damaged
