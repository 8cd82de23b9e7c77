"""The host's end of the cable: control requests by the book, and the way to the other endpoints."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drivers.theta_v.errors import ThetaGone, ThetaStall
from drivers.theta_v.simulator import descriptors as d
from drivers.theta_v.simulator.descriptors import Composition
from drivers.theta_v.simulator.video import Burst, ProtocolStall

if TYPE_CHECKING:
    from drivers.theta_v.simulator.camera import SimulatedThetaV

DEVICE_TYPE, CONFIGURATION_TYPE, STRING_TYPE, QUALIFIER_TYPE = 1, 2, 3, 6
CT_AE_MODE, CT_AE_PRIORITY = 0x0200, 0x0300
ERROR_CODE = 0x0200


@dataclass(frozen=True, slots=True)
class Setup:
    """The eight bytes every control transfer begins with."""

    request_type: int
    request: int
    value: int
    index: int
    length: int

    @classmethod
    def decode(cls, raw: bytes) -> Setup:
        return cls(*struct.unpack("<BBHHH", raw))


class Port:
    """What a host does with a camera it was connected to. Every method raises ThetaGone once that has left."""

    def __init__(self, camera: SimulatedThetaV, generation: int) -> None:
        self._camera = camera
        self.generation = generation
        self._strings = d.strings(camera.serial)
        self._configured = 0
        self._alternates: dict[int, int] = {}
        self._last_error = 0
        self._ae = {CT_AE_MODE: b"\x02", CT_AE_PRIORITY: b"\x00"}

    @property
    def connected(self) -> bool:
        camera = self._camera
        return camera.present and camera.generation == self.generation

    def disconnect(self) -> None:
        """The host lets go; the camera stops streaming."""
        with self._camera.lock:
            if self.connected:
                self._camera.held = False
                self._camera.video.reset()
                self.generation = -1

    def control(self, raw_setup: bytes, data: bytes = b"") -> bytes:
        """One control transfer. Raises ThetaStall as the device would answer STALL."""
        setup = Setup.decode(raw_setup)
        with self._camera.lock:
            self._check()
            if not setup.request_type & 0x80 and len(data) != setup.length:
                raise ThetaStall("the data stage is not as long as announced")
            try:
                return self._route(setup, data)[: setup.length]
            except ProtocolStall as stall:
                self._last_error = stall.code
                raise

    def write(self, endpoint: int, data: bytes) -> None:
        """An OUT transfer on a bulk endpoint."""
        with self._camera.lock:
            self._check()
            if endpoint != d.PTP_OUT:
                raise ThetaStall(f"no OUT endpoint {endpoint:#04x}")
            self._camera.talked()
            self._camera.ptp.receive(data)

    def read(self, endpoint: int, length: int) -> bytes | None:
        """An IN transfer on a bulk or interrupt endpoint; None while the camera has nothing to say."""
        with self._camera.lock:
            self._check()
            if endpoint == d.PTP_IN:
                return self._camera.ptp.send(length)
            if endpoint == d.PTP_EVENTS:
                return self._camera.ptp.event(length)
            if self._camera.composition is Composition.LIVE:
                if endpoint == d.VIDEO_STATUS:
                    return None
                if endpoint == d.VIDEO and self._camera.bulk_video:
                    return self._camera.video.payload(length)
            raise ThetaStall(f"no IN endpoint {endpoint:#04x}")

    @property
    def idle(self) -> bool:
        """Whether the video's microframes are empty until the next picture is offered."""
        with self._camera.lock:
            return self._camera.video.idle

    def isochronous(self, endpoint: int, count: int, start_ns: int) -> Burst:
        """`count` microframes of an isochronous endpoint from `start_ns` on; the microphones are silent."""
        with self._camera.lock:
            self._check()
            live = self._camera.composition is Composition.LIVE
            if not live or endpoint not in ({d.AUDIO} if self._camera.bulk_video else {d.VIDEO, d.AUDIO}):
                raise ThetaStall(f"no isochronous endpoint {endpoint:#04x}")
            return self._camera.video.take(count, start_ns) if endpoint == d.VIDEO else Burst(count, [])

    def _check(self) -> None:
        if not self.connected:
            raise ThetaGone("the simulated camera left the bus")

    def _route(self, setup: Setup, data: bytes) -> bytes:
        kind, recipient = setup.request_type & 0x60, setup.request_type & 0x1F
        if kind == 0x00:
            return self._standard(setup, recipient)
        if kind != 0x20 or recipient != 1 or self._configured == 0:
            raise ProtocolStall(0, f"request type {setup.request_type:#04x}")
        interface, entity = setup.index & 0xFF, setup.index >> 8
        if interface == d.STILL_INTERFACE and entity == 0:
            return self._camera.ptp.class_request(setup.request, setup.length)
        if self._camera.composition is Composition.LIVE:
            if interface == d.VIDEO_INTERFACE and entity == 0:
                return self._camera.video.control(setup.request, setup.value, setup.length, data)
            if interface == d.CONTROL_INTERFACE:
                return self._video_control(setup, entity, data)
        raise ProtocolStall(0, f"class request to interface {interface}, entity {entity}")

    def _video_control(self, setup: Setup, entity: int, data: bytes) -> bytes:
        """The video control interface: why the last request failed, and the terminal's two controls."""
        if entity == 0 and setup.value == ERROR_CODE and setup.request == 0x81:
            return bytes([self._last_error])
        if entity != 1 or setup.value not in self._ae:
            raise ProtocolStall(6, f"unknown control {setup.value:#06x} of entity {entity}")
        match setup.request:
            case 0x01:
                self._ae[setup.value] = data
                return b""
            case 0x81 | 0x87:
                return self._ae[setup.value]
            case 0x84 if setup.value == CT_AE_MODE:
                return b"\x0f"
            case 0x85:
                return b"\x01\x00"
            case 0x86:
                return b"\x03"
            case _:
                raise ProtocolStall(7, f"unknown request {setup.request:#04x}")

    def _standard(self, setup: Setup, recipient: int) -> bytes:
        match (setup.request_type, setup.request):
            case (0x80, 0x06):
                return self._descriptor(setup.value >> 8, setup.value & 0xFF)
            case (0x80, 0x08):
                return bytes([self._configured])
            case (0x00, 0x09) if setup.value in (0, 1):
                self._configured = setup.value
                self._alternates.clear()
                self._camera.video.reset()
                return b""
            case (0x01, 0x0B):
                self._set_interface(setup.index, setup.value)
                return b""
            case (0x81, 0x0A) if self._configured:
                return bytes([self._alternates.get(setup.index, 0)])
            case (0x80 | 0x81 | 0x82, 0x00):
                return bytes(2)
            case (0x02, 0x01) if setup.value == 0:
                if setup.index in (d.PTP_IN, d.PTP_OUT):
                    self._camera.ptp.clear_halt()
                elif setup.index == d.VIDEO and self._camera.bulk_video:
                    self._camera.video.set_alternate(0)
                return b""
            case (0x00, 0x05) | (0x00, 0x01) | (0x00, 0x03):
                return b""  # SET_ADDRESS and device features: nothing a host could see
            case _:
                raise ProtocolStall(0, f"standard request {setup.request:#04x} to recipient {recipient}")

    def _descriptor(self, kind: int, index: int) -> bytes:
        camera = self._camera
        live = camera.composition is Composition.LIVE
        if kind == DEVICE_TYPE and index == 0:
            return camera.device_descriptor
        if kind == CONFIGURATION_TYPE and index == 0:
            return camera.configuration
        if kind == QUALIFIER_TYPE and index == 0:
            return d.LIVE_QUALIFIER if live else d.MTP_QUALIFIER
        if kind == STRING_TYPE and index in self._strings:
            return self._strings[index]
        raise ProtocolStall(0, f"no descriptor {kind:#04x}/{index}")

    def _set_interface(self, interface: int, alternate: int) -> None:
        live = self._camera.composition is Composition.LIVE
        highest = {0: 0, 1: 0, 2: 0 if self._camera.bulk_video else 1, 3: 0, 4: 1} if live else {0: 0}
        if not self._configured or alternate > highest.get(interface, -1):
            raise ProtocolStall(0, f"no alternate setting {alternate} of interface {interface}")
        self._alternates[interface] = alternate
        if interface == d.VIDEO_INTERFACE:
            self._camera.video.set_alternate(alternate)
