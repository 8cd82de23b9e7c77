"""Finding and importing a device at a USB/IP server; afterwards the connection carries its transfers."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from drivers.theta_v.codec import usbip
from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaMalformed, ThetaNotFound, ThetaRefused, ThetaTimeout

CONNECT_S = 3.0  # a server on this machine or this network answers in milliseconds


@dataclass(frozen=True, slots=True)
class Server:
    host: str
    port: int

    @property
    def name(self) -> str:
        return f"USB/IP server {self.host}:{self.port}"

    async def devices(self) -> list[usbip.Device]:
        """What it exports. Raises ThetaError."""
        async with self._conversation("does not answer; is it a USB/IP server?") as stream:
            try:
                await asyncio.get_running_loop().sock_sendall(stream, usbip.operation(usbip.OP_REQ_DEVLIST))
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
            finally:
                stream.close()

    async def take(self, device: usbip.Device) -> tuple[socket.socket, usbip.Device]:
        """Import a device: the connection that now belongs to it, and its record. Raises ThetaError."""
        async with self._conversation("does not hand out the camera; restart it") as stream:
            busid = device.busid.encode().ljust(usbip.BUSID_BYTES, b"\0")
            await asyncio.get_running_loop().sock_sendall(stream, usbip.operation(usbip.OP_REQ_IMPORT) + busid)
            self._granted(usbip.decode_operation(await _exactly(stream, 8), usbip.OP_REP_IMPORT))
            return stream, usbip.Device.decode(await _exactly(stream, usbip.DEVICE.size))

    def _granted(self, status: int) -> None:
        if status in (usbip.ST_NODEV, usbip.ST_ERROR):
            raise ThetaNotFound(f"the camera just left the {self.name}; is it changing its mode?")
        if status != usbip.ST_OK:
            raise ThetaRefused("another program holds the camera; end it and try again")

    @asynccontextmanager
    async def _conversation(self, complaint: str) -> AsyncIterator[socket.socket]:
        """A connection, closed when anything goes wrong; what goes wrong becomes a ThetaError."""
        stream = await self._dial()
        try:
            async with asyncio.timeout(CONNECT_S):
                yield stream
        except BaseException as error:
            stream.close()
            if isinstance(error, ThetaError):
                raise
            if isinstance(error, TimeoutError):
                raise ThetaTimeout(f"the {self.name} {complaint}") from None
            if isinstance(error, ConnectionError):
                raise ThetaGone(f"the {self.name} hung up: {error}") from None
            raise

    async def _dial(self) -> socket.socket:
        loop = asyncio.get_running_loop()
        stream = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            stream.setblocking(False)
            stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            async with asyncio.timeout(CONNECT_S):
                found = await loop.getaddrinfo(self.host, self.port, family=socket.AF_INET)
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


async def _exactly(stream: socket.socket, count: int) -> bytes:
    loop = asyncio.get_running_loop()
    data = bytearray()
    while len(data) < count:
        piece = await loop.sock_recv(stream, count - len(data))
        if not piece:
            raise ConnectionResetError("it closed the connection")
        data += piece
    return bytes(data)
