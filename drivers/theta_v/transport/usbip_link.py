"""The connection to a USB/IP server: one thread reads answers, asks for more video at once, and writes."""

from __future__ import annotations

import asyncio
import logging
import selectors
import socket
import threading
import time
from collections import deque
from collections.abc import Callable

from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaMalformed
from drivers.theta_v.transport.usbip_urbs import Urbs

MAX_ANSWER_BYTES = 1 << 20  # nothing this driver asks for is larger
RECEIVE_BYTES = 256 << 10

log = logging.getLogger(__name__)


class UsbIpLink:
    """From `start` to `close`. `on_lost` is called once, from the thread, when the connection ends by itself."""

    def __init__(self, stream: socket.socket, urbs: Urbs, server: str, on_lost: Callable[[str], None]) -> None:
        self._stream, self._urbs, self._server, self._on_lost = stream, urbs, server, on_lost
        self._outbox: deque[bytes] = deque()
        self._closing = False
        self._waker, self._wake = socket.socketpair()
        for end in (self._waker, self._wake):
            end.setblocking(False)
        self._thread = threading.Thread(target=self._run, name="theta-usbip", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def send(self, message: bytes) -> None:
        """Have `message` written; from any thread."""
        if message and not self._closing:
            self._outbox.append(message)
            self._poke()

    async def close(self) -> None:
        self._closing = True
        self._poke()
        try:
            await asyncio.to_thread(self._thread.join)  # it may be handing on packets: do not block the loop
        finally:
            self._stream.close()
            self._wake.close()

    def _poke(self) -> None:
        try:
            self._wake.send(b"\0")
        except BlockingIOError:
            return  # it is full of unread wake-ups already
        except OSError as error:
            log.debug("the connection's thread has ended: %s", error)

    def _run(self) -> None:
        """The connection's thread. Ends when asked to or when the connection does, and says why."""
        reason = ""
        try:
            with selectors.DefaultSelector() as selector, self._waker:
                selector.register(self._stream, selectors.EVENT_READ)
                selector.register(self._waker, selectors.EVENT_READ)
                self._serve(selector)
        except ThetaError as error:
            reason = str(error)
        except OSError as error:
            reason = f"the connection to the {self._server} broke: {error}"
        except Exception as error:  # nobody else would hear of it, and the stream would only fall silent
            log.exception("a mistake of this driver ended the video")
            reason = f"the driver failed: {error!r}"
        if not self._closing:
            self._on_lost(reason)

    def _serve(self, selector: selectors.BaseSelector) -> None:
        stream, urbs = self._stream, self._urbs
        buffer = bytearray(RECEIVE_BYTES)
        filled = 0
        unsent = b""
        waiting_to_write = False
        while not self._closing:
            ready = selector.select()
            now_ns = time.monotonic_ns()
            for key, _ in ready:
                if key.fileobj is self._waker:
                    self._waker.recv(4096)
            if filled == len(buffer):
                if len(buffer) > 2 * MAX_ANSWER_BYTES:
                    raise ThetaMalformed(f"the {self._server} sends an endless answer")
                buffer = buffer.ljust(2 * len(buffer), b"\0")
            try:
                count = stream.recv_into(memoryview(buffer)[filled:])
                if not count:
                    raise ThetaGone("the camera left the bus: unplugged, switched off or changing its mode")
                filled += count
                used, again = urbs.answers(memoryview(buffer)[:filled], now_ns)
                if again:
                    self._outbox.append(again)
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
