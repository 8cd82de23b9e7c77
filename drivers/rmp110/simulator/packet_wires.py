"""Where a V3 base is plugged in: Ethernet (UDP), or a serial device that is a pseudo-terminal."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import time
import tty
from collections.abc import Callable, Sequence
from pathlib import Path

from drivers.rmp110.codec.bytestream import crc_fits
from drivers.rmp110.codec.v3.packets import POWER_DOWN, POWER_DOWN_PORT
from drivers.rmp110.simulator.v3_model import COMMAND_BYTES

log = logging.getLogger(__name__)

CHUNK_BYTES = 4096
PARTIAL_S = 0.1
"""A command that is not whole by then was cut off; its rest does not belong to the next one."""


class UdpWire(asyncio.DatagramProtocol):
    """A datagram is a packet; replies go to whoever sent last. Port 0 takes a free one, which `port` holds then."""

    def __init__(self, host: str, port: int, notice_port: int = POWER_DOWN_PORT) -> None:
        self.host = host
        self.port = port
        self._notice_port = notice_port
        self._plugged = True
        self._peer: tuple[str, int] | None = None
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self, on_message: Callable[[int, bytes], None]) -> None:
        """Raises OSError where the port is taken."""
        self._on_message = on_message
        where = (self.host, self.port)
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=where)
        self.port = self._transport.get_extra_info("sockname")[1]

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        if self._plugged:
            self._peer = addr
            self._on_message(time.monotonic_ns(), data)

    def error_received(self, exc: Exception) -> None:
        log.debug("nobody takes what the base sends: %s", exc)

    def send(self, messages: Sequence[bytes]) -> None:
        if self._transport and self._peer and self._plugged:
            for packet in messages:
                self._transport.sendto(packet, self._peer)

    def give_notice(self) -> None:
        """Tell the computer that the power is about to go."""
        if self._transport and self._peer and self._plugged:
            self._transport.sendto(POWER_DOWN, (self._peer[0], self._notice_port))

    def plug(self, plugged: bool) -> None:
        self._plugged = plugged

    async def close(self) -> None:
        if self._transport:
            self._transport.close()
            self._transport = None


class PtyWire:
    """A serial device at `path`, which is a link to a pseudo-terminal; unplugged, the device is gone."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._ends: tuple[int, int] | None = None
        self._linked_to: str | None = None

    async def open(self, on_message: Callable[[int, bytes], None]) -> None:
        """Raises OSError where the link cannot be made."""
        self._on_message = on_message
        self._loop = asyncio.get_running_loop()
        self._plug_in()

    def send(self, messages: Sequence[bytes]) -> None:
        if self._ends is None:
            return
        for packet in messages:
            try:
                os.write(self._ends[0], packet)
            except OSError as error:
                # Nobody reads, as on a real port: the bytes are lost.
                log.debug("nobody takes what the base sends: %s", error)

    def plug(self, plugged: bool) -> None:
        if plugged and self._ends is None:
            self._plug_in()
        elif not plugged:
            self._pull()

    async def close(self) -> None:
        self._pull()

    def _plug_in(self) -> None:
        ours, theirs = os.openpty()
        self._ends = ours, theirs
        try:
            # Our end of theirs stays open: a device without a client is no closed device.
            tty.setraw(theirs)
            os.set_blocking(ours, False)
            self._linked_to = os.ttyname(theirs)
            self.path.symlink_to(self._linked_to)
        except OSError:
            self._linked_to = None
            self._pull()
            raise
        self._splitter = CommandSplitter()
        self._loop.add_reader(ours, self._read, ours)

    def _pull(self) -> None:
        if self._ends is None:
            return
        ends, self._ends = self._ends, None
        self._loop.remove_reader(ends[0])
        if self._linked_to is not None:
            with contextlib.suppress(FileNotFoundError):
                self.path.unlink()
        for end in ends:
            os.close(end)

    def _read(self, ours: int) -> None:
        try:
            data = os.read(ours, CHUNK_BYTES)
        except OSError as error:
            log.debug("serial device: %s", error)
            return
        now_ns = time.monotonic_ns()
        for packet in self._splitter.feed(now_ns, data):
            self._on_message(now_ns, packet)


class CommandSplitter:
    """Command packets from a stream of bytes: the id tells the length. `skipped` counts bytes of no packet.

    A packet with a wrong checksum is handed over as well, for the base to complain of, and looked into again.
    """

    def __init__(self) -> None:
        self._buffer = b""
        self._fed_ns = 0
        self.skipped = 0

    def feed(self, now_ns: int, data: bytes) -> list[bytes]:
        """Every packet that these bytes complete."""
        if self._buffer and now_ns - self._fed_ns > PARTIAL_S * 1e9:
            self.skipped += len(self._buffer)
            self._buffer = b""
        self._fed_ns = now_ns
        buffer, start = self._buffer + data, 0
        packets: list[bytes] = []
        while len(buffer) - start >= 2:
            length = COMMAND_BYTES.get(int.from_bytes(buffer[start : start + 2], "big"))
            if length is None:
                start += 1
                self.skipped += 1
                continue
            if len(buffer) - start < length:
                break
            packet = buffer[start : start + length]
            packets.append(packet)
            start += length if crc_fits(packet) else 2
        self._buffer = buffer[start:]
        return packets
