"""A USB/IP client in pure Python: the camera of another process or machine, without a kernel driver."""

from __future__ import annotations

import asyncio
import logging
import struct
import threading
import time

from drivers.theta_v.codec import usbip
from drivers.theta_v.codec.descriptors import ISOCHRONOUS, Endpoint
from drivers.theta_v.errors import (
    ThetaError,
    ThetaGone,
    ThetaMalformed,
    ThetaNotFound,
    ThetaTimeout,
    ThetaWrongDevice,
)
from drivers.theta_v.transport.base import (
    BULK_S,
    CLEAR_FEATURE,
    CONTROL_S,
    RICOH,
    SET_CONFIGURATION,
    SET_INTERFACE,
    GoneSink,
    PacketSink,
)
from drivers.theta_v.transport.opened import OpenedCamera
from drivers.theta_v.transport.usbip_discovery import Server
from drivers.theta_v.transport.usbip_link import UsbIpLink
from drivers.theta_v.transport.usbip_urbs import Urbs, Video

DEFAULT_PORT = 3240  # IANA: usbip

REAP_S = 2.0  # cancelled transfers come back within one round trip
PACKETS_PER_URB = 32  # 4 ms of microframes: what batching may add to the latency of a picture
URBS_IN_FLIGHT = 256  # one second: nothing here is limited to 16 MiB, and simulations share their machine

log = logging.getLogger(__name__)


class UsbIpTransport(OpenedCamera):
    """A `UsbTransport` to a USB/IP server at `host:port`. See `UsbTransport` for the methods."""

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        *,
        packets_per_urb: int = PACKETS_PER_URB,
        urbs: int = URBS_IN_FLIGHT,
    ) -> None:
        super().__init__()
        if not 1 <= packets_per_urb <= usbip.MAX_PACKETS or urbs < 1:
            raise ValueError("a transfer has 1 to 1024 packets, and at least one must be in flight")
        self._server = Server(host, port)
        self._packets_per_urb, self._in_flight = packets_per_urb, urbs
        self._on_gone: GoneSink | None = None
        self._link: UsbIpLink | None = None
        self._urbs = Urbs(0, self.name)
        self._lock = threading.Lock()
        self._gone = ""

    @property
    def name(self) -> str:
        return self._server.name

    async def open(self, serial: str | None, on_gone: GoneSink) -> None:
        devices = [d for d in await self._server.devices() if d.vendor_id == RICOH]
        if not devices:
            raise ThetaNotFound(f"no THETA on the {self.name}; is it plugged in and switched on?")
        others: list[str] = []
        for device in devices:
            await self._attach(device, on_gone)
            try:
                who = await self.read_descriptors(self)
                if who.is_theta and serial in (None, who.serial):
                    await self.control(0x00, SET_CONFIGURATION, self.configuration_value, 0)
                    return
                others.append(f"{who.product or 'an unnamed device'} {who.serial}".strip())
            except BaseException:
                await self.close()
                raise
            await self.close()
        wanted = f"a THETA with serial number {serial}" if serial else "a THETA"
        raise ThetaWrongDevice(f"the {self.name} has {', '.join(others)}, but not {wanted}")

    async def close(self) -> None:
        self._on_gone = None
        link, self._link = self._link, None
        try:
            if link is not None:
                await link.close()
        finally:
            self._claims.clear()
            self._lose("the connection was closed")

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
        self.need_endpoint(endpoint)
        await self._transfer(endpoint, False, data, len(data), timeout_s, f"endpoint {endpoint:#04x}")

    async def bulk_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        self.need_endpoint(endpoint)
        return await self._transfer(endpoint, True, b"", length, timeout_s, f"endpoint {endpoint:#04x}")

    async def interrupt_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        return await self.bulk_in(endpoint, length, timeout_s)

    async def set_interface(self, interface: int, alternate: int) -> None:
        self.need(interface)
        await self.control(0x01, SET_INTERFACE, alternate, interface)

    async def claim(self, interface: int) -> None:
        self._claims.add(interface)

    async def release(self, interface: int) -> None:
        self._claims.discard(interface)

    async def clear_halt(self, endpoint: int) -> None:
        await self.control(0x02, CLEAR_FEATURE, 0, endpoint)

    async def reset(self) -> None:
        """USB/IP has no word for a port reset; a kernel that resets its port configures the device anew."""
        await self.control(0x00, SET_CONFIGURATION, self.configuration_value, 0)

    async def start_video(self, endpoint: Endpoint, payload_bytes: int, on_packets: PacketSink) -> None:
        self.need_endpoint(endpoint.address)
        if endpoint.kind == ISOCHRONOUS:
            video = Video(endpoint.address, endpoint.max_packet_bytes, self._packets_per_urb, on_packets)
        else:
            # Whole packets, or a payload longer than announced would end the transfer as an error.
            whole = max(endpoint.max_packet_bytes, 1)
            length = -(-max(payload_bytes, whole) // whole) * whole
            if length > usbip.MAX_TRANSFER_BYTES:
                raise ThetaMalformed(f"the camera announces video payloads of {payload_bytes} bytes")
            video = Video(endpoint.address, length, 0, on_packets)
        self._open_link().send(self._urbs.start_video(video, self._in_flight))

    async def stop_video(self) -> None:
        victims, messages = self._urbs.stop_video()
        link = self._link
        if not messages or link is None:
            return
        link.send(messages)
        deadline = time.monotonic() + REAP_S
        while not self._urbs.reaped(victims):
            if time.monotonic() > deadline:
                raise ThetaTimeout(f"the {self.name} does not give transfers back; restart it")
            await asyncio.sleep(0.002)

    async def _attach(self, device: usbip.Device, on_gone: GoneSink) -> None:
        stream, device = await self._server.take(device)
        self._on_gone, self._gone = on_gone, ""
        self._urbs = Urbs(device.devid, self.name)
        self._link = UsbIpLink(stream, self._urbs, self.name, self._lose)
        self._link.start()

    def _open_link(self) -> UsbIpLink:
        if self._gone or self._link is None:
            raise ThetaGone(self._gone or "the camera is not open")
        return self._link

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
        loop = asyncio.get_running_loop()
        future: asyncio.Future[bytes] = loop.create_future()

        def settle(outcome: bytes | ThetaError) -> None:
            if future.done():
                return
            if isinstance(outcome, bytes):
                future.set_result(outcome)
            else:
                future.set_exception(outcome)

        def ended(outcome: bytes | ThetaError) -> None:
            try:
                loop.call_soon_threadsafe(settle, outcome)
            except RuntimeError:
                log.debug("an answer of the camera came after the event loop had ended")

        with self._lock:  # or the request could miss the moment in which all of them fail
            link = self._open_link()
            sequence, message = self._urbs.ask(endpoint, inward, data, length, setup, what, ended)
        link.send(message)
        try:
            async with asyncio.timeout(timeout_s):
                return await future
        except TimeoutError:
            raise ThetaTimeout(f"the camera did not answer {what} within {timeout_s:g} s") from None
        finally:
            if not future.done() or future.cancelled():
                link.send(self._urbs.give_up(sequence))

    def _lose(self, reason: str) -> None:
        with self._lock:
            first, self._gone = not self._gone, self._gone or reason
        self._urbs.fail_all(reason)
        if first and self._on_gone is not None:
            self._on_gone(reason)
