"""A machine's USB in this process: what `usb1`, libusb and the kernel do with one simulated camera.

As strict as they are: lists of devices are as old as their session, interfaces belong to one handle, the
memory for transfers is limited, callbacks run in the thread that handles events, nothing is submitted twice
or closed while it flies. What a real one would merely punish with a crash or a stall goes to `offences`.
"""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import usb1

from drivers.theta_v.codec.descriptors import parse_configuration
from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaNotFound, ThetaStall
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.port import Port

MICROFRAME_NS = 125_000
POLL_S = 0.001


class Machine:
    """`loop_thread`, once known, may never call what blocks."""

    def __init__(self, camera: SimulatedThetaV, *, memory_bytes: int = 16 << 20) -> None:
        self.camera = camera
        self.memory_bytes = memory_bytes
        self.offences: list[str] = []
        self.refusals: dict[str, type[Exception]] = {}
        """Errors to raise, by the name of the method that raises them."""
        self.calls: list[str] = []
        self.loses_unheard = False
        """Whether what the camera sends while no transfer is in flight is lost, as it is on a real bus."""
        self.loop_thread = threading.get_ident()
        self.lock = threading.RLock()
        self.owners: dict[int, FakeHandle] = {}
        self.contexts = 0
        self._port: Port | None = None
        self._address = 1

    def context(self) -> FakeContext:
        self.blocking("open_context")
        self.contexts += 1
        return FakeContext(self)

    def plugged(self) -> Port | None:
        """The camera as the kernel enumerated it, or None."""
        with self.lock:
            if self._port is None or not self._port.connected:
                self._port = None
                self.owners.clear()
                try:
                    self._port = self.camera.connect()
                    self._port.control(struct.pack("<BBHHH", 0, 9, 1, 0, 0))
                except ThetaNotFound:
                    return None
                self._address += 1
            return self._port

    @property
    def address(self) -> int:
        return self._address

    def blocking(self, what: str) -> None:
        self.calls.append(what)
        if threading.get_ident() == self.loop_thread:
            self.offences.append(f"{what} on the event loop's thread")
        if what in self.refusals:
            raise self.refusals[what]


class FakeContext:
    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        port = machine.plugged()
        self._devices = [FakeDevice(machine, self, port, machine.address)] if port is not None else []
        self.handles: list[FakeHandle] = []
        self._interrupted = threading.Event()
        self._hotplug: Callable[[Any, FakeDevice, int], bool] | None = None
        self.closed = False

    def getDeviceIterator(self, skip_on_error: bool = False) -> Iterator[FakeDevice]:
        return iter(self._devices)

    def hotplugRegisterCallback(
        self, callback: Callable[[Any, Any, int], bool], events: int, flags: int, vendor_id: int
    ) -> int:
        if "hotplug" in self._machine.refusals:
            raise self._machine.refusals["hotplug"]
        self._hotplug = callback
        return 1

    def handleEventsTimeout(self, tv: float = 0) -> None:
        deadline = time.monotonic() + tv
        while not self._interrupted.is_set() and time.monotonic() < deadline:
            ended = False
            while any(handle.complete() for handle in list(self.handles)):
                ended = True  # libusb hands over whatever has ended before it returns
            if ended:
                return
            left = [d for d in self._devices if not d.port.connected]
            if left and self._hotplug is not None:
                self._devices = []
                self._hotplug(self, left[0], usb1.HOTPLUG_EVENT_DEVICE_LEFT)
                return
            time.sleep(POLL_S)
        self._interrupted.clear()

    def interruptEventHandler(self) -> None:
        self._interrupted.set()

    def close(self) -> None:
        self._machine.blocking("close_context")
        if self.handles or self.closed:
            self._machine.offences.append("a session closed with open handles, or twice")
        self.closed = True
        self._machine.contexts -= 1


@dataclass
class FakeDevice:
    machine: Machine
    context: FakeContext
    port: Port
    address: int

    def getVendorID(self) -> int:
        return 0x05CA

    def getBusNumber(self) -> int:
        return 1

    def getDeviceAddress(self) -> int:
        return self.address

    def open(self) -> FakeHandle:
        self.machine.blocking("open")
        if not self.port.connected:
            raise usb1.USBErrorNoDevice
        handle = FakeHandle(self)
        self.context.handles.append(handle)
        return handle


class FakeHandle:
    def __init__(self, device: FakeDevice) -> None:
        self.device, self.machine, self.port = device, device.machine, device.port
        self.flying: list[FakeTransfer] = []
        self.transfers = 0
        """Allocated and not freed."""
        self.landing = 0
        """Ended ones whose callback runs at this moment, in the thread that handles events."""
        self.auto_detach = False
        self.busy_until_ns = 0

    def getTransfer(self, iso_packets: int = 0) -> FakeTransfer:
        self.transfers += 1
        return FakeTransfer(self, iso_packets)

    def getConfiguration(self) -> int:
        return 1

    def setConfiguration(self, configuration: int) -> None:
        raise AssertionError("the kernel has configured the device")

    def setAutoDetachKernelDriver(self, enable: bool) -> None:
        self.machine.blocking("auto_detach")
        self.auto_detach = enable

    def claimInterface(self, interface: int) -> None:
        self.machine.blocking("claim")
        self._check()
        if not self.auto_detach or self.machine.owners.get(interface, self) is not self:
            raise usb1.USBErrorBusy
        self.machine.owners[interface] = self

    def releaseInterface(self, interface: int) -> None:
        self.machine.blocking("release")
        self._check()
        if self.machine.owners.get(interface) is not self:
            raise usb1.USBErrorNotFound
        self._drop(interface)

    def setInterfaceAltSetting(self, interface: int, alt_setting: int) -> None:
        self.machine.blocking("set_alternate")
        self._check()
        if self.machine.owners.get(interface) is not self:
            raise usb1.USBErrorNotFound
        self._ask(0x01, 0x0B, alt_setting, interface)

    def clearHalt(self, endpoint: int) -> None:
        self.machine.blocking("clear_halt")
        self._check()
        self._ask(0x02, 0x01, 0, endpoint)

    def resetDevice(self) -> None:
        self.machine.blocking("reset")
        if not self.port.connected:
            raise usb1.USBErrorNotFound
        self._ask(0x00, 0x09, 1, 0)

    def close(self) -> None:
        self.machine.blocking("close")
        for transfer in list(self.flying):
            transfer.status = usb1.TRANSFER_CANCELLED
        while self.flying or self.landing:
            if not self.complete():
                time.sleep(POLL_S)
        for interface in [i for i, owner in self.machine.owners.items() if owner is self]:
            self._drop(interface)
        if self.transfers:
            self.machine.offences.append(f"{self.transfers} transfers were never freed")
        self.device.context.handles.remove(self)

    def complete(self) -> bool:
        """Whether something came down; its callback ran in here."""
        for transfer in list(self.flying):
            if transfer.ended():
                self.landing += 1
                self.flying.remove(transfer)
                transfer.land()
                self.landing -= 1
                return True
        return False

    def owns(self, endpoint: int) -> bool:
        settings = parse_configuration(self.machine.camera.configuration).settings
        interface = next((s.interface for s in settings for e in s.endpoints if e.address == endpoint), None)
        return interface is not None and self.machine.owners.get(interface) is self

    def _drop(self, interface: int) -> None:
        """Letting go of an interface, the kernel returns it to alternate setting 0."""
        del self.machine.owners[interface]
        if self.port.connected:
            self._ask(0x01, 0x0B, 0, interface)

    def _ask(self, *fields: int) -> None:
        try:
            self.port.control(struct.pack("<BBHHH", *fields, 0))
        except ThetaStall:
            raise usb1.USBErrorPipe from None
        except ThetaGone:
            raise usb1.USBErrorNoDevice from None

    def _check(self) -> None:
        if not self.port.connected:
            raise usb1.USBErrorNoDevice


@dataclass(eq=False)
class FakeTransfer:
    handle: FakeHandle
    iso_packets: int
    kind: str = ""
    endpoint: int = 0
    setup: bytes = b""
    data: bytes = b""
    length: int = 0
    callback: Callable[[Any], None] | None = None
    status: int | None = None
    begin_ns: int = 0
    received: bytearray = field(default_factory=bytearray)
    packets: list[tuple[int, bytearray]] = field(default_factory=list)
    doomed: bool = False
    closed: bool = False

    def setControl(
        self, request_type: int, request: int, value: int, index: int, buffer_or_len: bytes | int,
        callback: Callable[[Any], None],
    ) -> None:  # fmt: skip
        self._set("control", request_type & 0x80, buffer_or_len, callback)
        self.setup = struct.pack("<BBHHH", request_type, request, value, index, self.length)

    def setBulk(self, endpoint: int, buffer_or_len: bytes | int, callback: Callable[[Any], None]) -> None:
        self._set("bulk", endpoint, buffer_or_len, callback)

    def setInterrupt(self, endpoint: int, buffer_or_len: bytes | int, callback: Callable[[Any], None]) -> None:
        self._set("interrupt", endpoint, buffer_or_len, callback)

    def setIsochronous(self, endpoint: int, buffer_or_len: bytes | int, callback: Callable[[Any], None]) -> None:
        self._set("isochronous", endpoint, buffer_or_len, callback)
        if not self.iso_packets or self.length % self.iso_packets:
            raise ValueError("the buffer cannot be divided among the packets")

    def submit(self) -> None:
        handle = self.handle
        with handle.machine.lock:
            if self in handle.flying or self.doomed or not self.kind:
                raise ValueError("submitted already, doomed, or not prepared")
            if not handle.port.connected:
                raise usb1.USBErrorNoDevice
            if self.kind != "control" and not handle.owns(self.endpoint):
                raise usb1.USBErrorIO
            used = sum(t.length for t in handle.flying)
            if used + self.length > handle.machine.memory_bytes:
                raise usb1.USBErrorIO  # so libusb reports the kernel's ENOMEM for isochronous transfers
            self.status, self.received, self.packets = None, bytearray(), []
            if self.kind == "isochronous":
                now_ns = time.monotonic_ns()
                unheard = (now_ns - handle.busy_until_ns) // MICROFRAME_NS
                if handle.machine.loses_unheard and handle.busy_until_ns and unheard > 0:
                    handle.port.isochronous(self.endpoint, unheard, handle.busy_until_ns)
                self.begin_ns = max(handle.busy_until_ns, now_ns)
                handle.busy_until_ns = self.begin_ns + self.iso_packets * MICROFRAME_NS
            handle.flying.append(self)

    def cancel(self) -> None:
        if self not in self.handle.flying:
            raise usb1.USBErrorNotFound
        self.status = usb1.TRANSFER_CANCELLED

    def doom(self) -> None:
        self.doomed = True

    def close(self) -> None:
        if self in self.handle.flying:
            raise ValueError("cannot close a submitted transfer")
        self.doomed, self.callback, self.kind = True, None, ""
        self.handle.transfers -= not self.closed
        self.closed = True

    def isSubmitted(self) -> bool:
        return self in self.handle.flying

    def getStatus(self) -> int:
        assert self.status is not None, "asked before it ended"
        return self.status

    def getActualLength(self) -> int:
        return len(self.received)

    def getBuffer(self) -> bytearray:
        return self.received.ljust(self.length, b"\0")

    def iterISO(self) -> Iterator[tuple[int, bytearray]]:
        return iter(self.packets)

    def ended(self) -> bool:
        """Let the camera answer; True once it did, or will not."""
        if self.status is not None:
            return True
        try:
            self.status = self._exchange()
        except ThetaGone:
            self.status = usb1.TRANSFER_NO_DEVICE
        except ThetaStall:
            self.status = usb1.TRANSFER_STALL
        except ThetaError:
            self.status = usb1.TRANSFER_ERROR
        return self.status is not None

    def land(self) -> None:
        if self.callback is not None:
            self.callback(self)
        if self.doomed:
            self.close()

    def _exchange(self) -> int | None:
        port = self.handle.port
        if self.kind == "control":
            self.received = bytearray(port.control(self.setup, self.data))
        elif self.kind == "isochronous":
            end_ns = self.begin_ns + self.iso_packets * MICROFRAME_NS
            if time.monotonic_ns() < end_ns:
                return None if port.connected else usb1.TRANSFER_NO_DEVICE
            self.packets = [(0, bytearray()) for _ in range(self.iso_packets)]
            room = self.length // self.iso_packets
            for slot, status, data in port.isochronous(self.endpoint, self.iso_packets, self.begin_ns).packets:
                self.packets[slot] = (usb1.TRANSFER_ERROR if status else 0, bytearray(data[:room]))
        elif self.endpoint & 0x80:
            answer = port.read(self.endpoint, self.length)
            if answer is None:
                return None
            self.received = bytearray(answer)
        else:
            port.write(self.endpoint, self.data)
        completed: int = usb1.TRANSFER_COMPLETED
        return completed

    def _set(self, kind: str, endpoint: int, what: bytes | int, callback: Callable[[Any], None]) -> None:
        if self in self.handle.flying:
            raise ValueError("cannot alter a submitted transfer")
        self.kind, self.endpoint, self.callback = kind, endpoint, callback
        self.data = b"" if isinstance(what, int) else bytes(what)
        self.length = what if isinstance(what, int) else len(what)
