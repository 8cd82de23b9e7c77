"""The simulated camera without a bus: a transport that talks to the model in its own process."""

from __future__ import annotations

import asyncio
import struct
import threading
import time

from drivers.theta_v.codec.descriptors import Configuration, parse_configuration
from drivers.theta_v.codec.payload import Packet
from drivers.theta_v.errors import ThetaGone, ThetaNotFound, ThetaRefused, ThetaStall, ThetaTimeout, ThetaWrongDevice
from drivers.theta_v.simulator.camera import Port, SimulatedThetaV
from drivers.theta_v.transport.base import (
    BULK_S,
    CONTROL_S,
    MICROFRAME_NS,
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

PACKETS_PER_BATCH = 32  # 4 ms, as the USB/IP client
POLL_S = 0.002  # how often a waiting transfer and the cable are looked at
MAX_BEHIND_NS = 1_000_000_000  # after a longer pause of the process the missed microframes are not made up


class AttachedTransport:
    """A `UsbTransport` to one `SimulatedThetaV`. See `UsbTransport` for the methods."""

    def __init__(self, camera: SimulatedThetaV) -> None:
        self._camera = camera
        self._claims = Claims()
        self._port: Port | None = None
        self._on_gone: GoneSink | None = None
        self._watch: asyncio.Task[None] | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._device_descriptor = b""
        self._configuration = b""
        self._parsed = Configuration(0, ())
        self._identity: Identity | None = None

    @property
    def name(self) -> str:
        return "simulated camera"

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
        try:
            self._port = self._camera.connect()
        except ThetaNotFound:
            raise ThetaNotFound("no THETA on the bus; is it plugged in and switched on?") from None
        except ThetaStall:
            raise ThetaRefused("another program holds the camera; end it and try again") from None
        self._on_gone = on_gone
        try:
            self._device_descriptor = await read_device_descriptor(self)
            self._configuration = await read_configuration(self)
            self._parsed = parse_configuration(self._configuration)
            self._identity = await read_identity(self, self._device_descriptor)
            self._check_serial(self._identity.serial, serial)
            await self.control(0x00, SET_CONFIGURATION, self._parsed.value, 0)
        except BaseException:
            await self.close()
            raise
        self._watch = asyncio.create_task(self._watch_cable(self._port))

    async def close(self) -> None:
        self._on_gone = None
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        try:
            await self.stop_isochronous()
        finally:
            if self._port is not None:
                self._port.disconnect()
                self._port = None
            self._claims.clear()

    async def control(
        self,
        request_type: int,
        request: int,
        value: int,
        index: int,
        data_or_length: bytes | int = b"",
        timeout_s: float = CONTROL_S,
    ) -> bytes:
        data = b"" if isinstance(data_or_length, int) else data_or_length
        length = data_or_length if isinstance(data_or_length, int) else len(data)
        setup = struct.pack("<BBHHH", request_type, request, value, index, length)
        return self._open_port().control(setup, data)

    async def bulk_out(self, endpoint: int, data: bytes, timeout_s: float = BULK_S) -> None:
        self._need(endpoint)
        self._open_port().write(endpoint, data)

    async def bulk_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        self._need(endpoint)
        deadline = time.monotonic() + timeout_s
        while (data := self._open_port().read(endpoint, length)) is None:
            if time.monotonic() > deadline:
                raise ThetaTimeout(f"the camera did not answer on {endpoint:#04x} within {timeout_s:g} s")
            await asyncio.sleep(POLL_S)
        return data

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
        if self._thread is not None:
            raise RuntimeError("an isochronous stream is running already")
        self._stop.clear()
        self._thread = threading.Thread(
            target=self._stream,
            args=(self._open_port(), endpoint, packet_bytes, on_packets),
            name="theta-attached",
            daemon=True,
        )
        self._thread.start()

    async def stop_isochronous(self) -> None:
        thread, self._thread = self._thread, None
        self._stop.set()
        if thread is not None:
            await asyncio.to_thread(thread.join)

    def _check_serial(self, found: str, wanted: str | None) -> None:
        if wanted not in (None, found):
            raise ThetaWrongDevice(f"the camera on the bus is number {found}, not {wanted}")

    def _open_port(self) -> Port:
        if self._port is None:
            raise ThetaGone("the camera is not open")
        return self._port

    def _need(self, endpoint: int) -> None:
        for setting in self._parsed.settings:
            if any(e.address == endpoint for e in setting.endpoints):
                self._claims.need(setting.interface)
                return
        raise RuntimeError(f"the camera has no endpoint {endpoint:#04x}")

    def _stream(self, port: Port, endpoint: int, packet_bytes: int, on_packets: PacketSink) -> None:
        start = time.monotonic_ns()
        while not self._stop.is_set():
            end = start + PACKETS_PER_BATCH * MICROFRAME_NS
            wait_ns = end - time.monotonic_ns()
            if wait_ns > 0 and self._stop.wait(wait_ns / 1e9):
                return
            try:
                burst = port.isochronous(endpoint, PACKETS_PER_BATCH, start)
            except ThetaGone:
                return  # the watch on the cable tells the driver
            packets: list[Packet] = [(status, data[:packet_bytes]) for _, status, data in burst.packets]
            if packets:
                on_packets(time.monotonic_ns(), packets)
            start = end if wait_ns > -MAX_BEHIND_NS else time.monotonic_ns()

    async def _watch_cable(self, port: Port) -> None:
        while port.connected:  # noqa: ASYNC110 the model's own threads do not know this loop
            await asyncio.sleep(POLL_S * 5)
        if self._on_gone is not None:
            self._on_gone("the camera left the bus: unplugged, switched off or changing its mode")
