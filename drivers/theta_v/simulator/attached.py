"""The simulated camera without a bus: a transport that talks to the model in its own process."""

from __future__ import annotations

import asyncio
import struct
import threading
import time

from drivers.theta_v.codec.descriptors import ISOCHRONOUS, Endpoint
from drivers.theta_v.codec.payload import Packet
from drivers.theta_v.errors import ThetaGone, ThetaNotFound, ThetaRefused, ThetaStall, ThetaTimeout, ThetaWrongDevice
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.port import Port
from drivers.theta_v.transport.base import (
    BULK_S,
    CLEAR_FEATURE,
    CONTROL_S,
    MICROFRAME_NS,
    SET_CONFIGURATION,
    SET_INTERFACE,
    GoneSink,
    Identity,
    PacketSink,
)
from drivers.theta_v.transport.microframes import Pauses
from drivers.theta_v.transport.opened import OpenedCamera

PACKETS_PER_BATCH = 32  # 4 ms, as the USB/IP client
EVENT_POLL_S = 0.02  # of what the camera says unasked, for which somebody waits all the time
POLL_S = 0.002  # how often a waiting transfer and the cable are looked at
MAX_BEHIND_NS = 1_000_000_000  # after a longer pause of the process the missed microframes are not made up


class AttachedTransport(OpenedCamera):
    """A `UsbTransport` to one `SimulatedThetaV`. See `UsbTransport` for the methods."""

    def __init__(self, camera: SimulatedThetaV) -> None:
        super().__init__()
        self._camera = camera
        self._port: Port | None = None
        self._on_gone: GoneSink | None = None
        self._watch: asyncio.Task[None] | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()

    @property
    def name(self) -> str:
        return "simulated camera"

    async def open(self, serial: str | None, on_gone: GoneSink) -> None:
        try:
            self._port = self._camera.connect()
        except ThetaNotFound:
            raise ThetaNotFound("no THETA on the bus; is it plugged in and switched on?") from None
        except ThetaStall:
            raise ThetaRefused("another program holds the camera; end it and try again") from None
        self._on_gone = on_gone
        try:
            who = await self.read_descriptors(self)
            self._check(who, serial)
            await self.control(0x00, SET_CONFIGURATION, self.configuration_value, 0)
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
            await self.stop_video()
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
        self.need_endpoint(endpoint)
        self._open_port().write(endpoint, data)

    async def bulk_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        return await self._read(endpoint, length, timeout_s, POLL_S)

    async def interrupt_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        return await self._read(endpoint, length, timeout_s, EVENT_POLL_S)

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
        await self.control(0x00, SET_CONFIGURATION, self.configuration_value, 0)

    async def start_video(self, endpoint: Endpoint, payload_bytes: int, on_packets: PacketSink) -> None:
        self.need_endpoint(endpoint.address)
        if self._thread is not None:
            raise RuntimeError("video is running already")
        self._stop.clear()
        isochronous = endpoint.kind == ISOCHRONOUS
        self._thread = threading.Thread(
            target=self._stream if isochronous else self._read_payloads,
            args=(
                self._open_port(),
                endpoint.address,
                endpoint.max_packet_bytes if isochronous else payload_bytes,
                on_packets,
            ),
            name="theta-attached",
            daemon=True,
        )
        self._thread.start()

    async def stop_video(self) -> None:
        thread, self._thread = self._thread, None
        self._stop.set()
        if thread is not None:
            await asyncio.to_thread(thread.join)

    async def _read(self, endpoint: int, length: int, timeout_s: float, poll_s: float) -> bytes:
        self.need_endpoint(endpoint)
        deadline = time.monotonic() + timeout_s
        while (data := self._open_port().read(endpoint, length)) is None:
            if time.monotonic() > deadline:
                raise ThetaTimeout(f"the camera did not answer on {endpoint:#04x} within {timeout_s:g} s")
            await asyncio.sleep(poll_s)
        return data

    def _check(self, who: Identity, serial: str | None) -> None:
        if serial not in (None, who.serial):
            raise ThetaWrongDevice(f"the camera on the bus is number {who.serial}, not {serial}")

    def _open_port(self) -> Port:
        if self._port is None:
            raise ThetaGone("the camera is not open")
        return self._port

    def _stream(self, port: Port, endpoint: int, packet_bytes: int, on_packets: PacketSink) -> None:
        start = time.monotonic_ns()
        pauses = Pauses()
        while not self._stop.is_set():
            end = start + PACKETS_PER_BATCH * MICROFRAME_NS
            wait_ns = end - time.monotonic_ns()
            if wait_ns > 0 and self._stop.wait(wait_ns / 1e9):
                return
            try:
                burst = port.isochronous(endpoint, PACKETS_PER_BATCH, start)
            except ThetaGone:
                return  # the watch on the cable tells the driver
            carried: list[Packet] = [(status, data[:packet_bytes]) for _, status, data in burst.packets]
            packets = pauses.marked([slot for slot, _, _ in burst.packets], carried, PACKETS_PER_BATCH)
            if packets:
                on_packets(time.monotonic_ns(), packets)
            start = end if wait_ns > -MAX_BEHIND_NS else time.monotonic_ns()

    def _read_payloads(self, port: Port, endpoint: int, payload_bytes: int, on_packets: PacketSink) -> None:
        while not self._stop.is_set():
            try:
                payload = port.read(endpoint, payload_bytes)
            except ThetaGone:
                return  # the watch on the cable tells the driver
            if payload is None:
                self._stop.wait(POLL_S)
            else:
                on_packets(time.monotonic_ns(), [(0, payload)])

    async def _watch_cable(self, port: Port) -> None:
        while port.connected:  # noqa: ASYNC110 the model's own threads do not know this loop
            await asyncio.sleep(POLL_S * 5)
        if self._on_gone is not None:
            self._on_gone("the camera left the bus: unplugged, switched off or changing its mode")
