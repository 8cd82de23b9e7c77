"""The simulated camera behind pyusb, for programs that speak control and PTP through it.

    usb.core.find(idVendor=0x05CA, backend=PyUsbBackend(camera))

No video: pyusb submits one isochronous transfer at a time and tells neither lengths nor status of its packets
(fact sheet section 5.1), so nothing real would come of it either. A bulk endpoint's video can be read.
"""

from __future__ import annotations

import struct
import time
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, TypeVar

import usb.backend  # type: ignore[import-untyped]
import usb.core  # type: ignore[import-untyped]

from drivers.theta_v.codec import usbip
from drivers.theta_v.codec.descriptors import descriptors
from drivers.theta_v.errors import ThetaGone, ThetaNotFound, ThetaStall
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.port import Port
from drivers.theta_v.transport.base import CLEAR_FEATURE, SET_CONFIGURATION, SET_INTERFACE

ENOENT, EBUSY = 2, 16
POLL_S = 0.001  # how often a waiting transfer is looked at
HIGH_SPEED = 3  # as libusb numbers them

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class _Plugged:
    """The camera as it was found on the bus; another one after each replug."""

    generation: int


@dataclass(eq=False, slots=True)
class _Opened:
    port: Port
    claims: set[int] = field(default_factory=set)


class PyUsbBackend(usb.backend.IBackend):  # type: ignore[misc]
    """One camera on a bus of its own. Errors are pyusb's, with the kernel's error numbers; timeouts in ms.

    As strict as libusb: an endpoint is used by whoever claimed its interface, and one program at a time has
    the camera.
    """

    def __init__(self, camera: SimulatedThetaV) -> None:
        super().__init__()
        self._camera = camera

    def enumerate_devices(self) -> Iterator[_Plugged]:
        if self._camera.present:
            yield _Plugged(self._camera.generation)

    def get_parent(self, dev: _Plugged) -> None:
        """A root port's device has none."""

    def get_device_descriptor(self, dev: _Plugged) -> SimpleNamespace:
        fields = zip(
            DEVICE_NAMES.split(), struct.unpack("<BBHBBBBHHHBBBB", self._camera.device_descriptor), strict=True
        )
        place = {"address": 2 + dev.generation, "bus": 1, "port_number": 1, "port_numbers": (1,), "speed": HIGH_SPEED}
        return SimpleNamespace(**dict(fields), **place)

    def get_configuration_descriptor(self, dev: _Plugged, config: int) -> SimpleNamespace:
        """Raises IndexError past the end, here and below: so pyusb finds out how many there are."""
        return [self._described()][config]

    def get_interface_descriptor(self, dev: _Plugged, intf: int, alt: int, config: int) -> SimpleNamespace:
        """`intf` and `alt` are places in the order of the descriptors."""
        settings: dict[int, list[SimpleNamespace]] = {}
        for setting in self.get_configuration_descriptor(dev, config).settings:
            settings.setdefault(setting.bInterfaceNumber, []).append(setting)
        return list(settings.values())[intf][alt]

    def get_endpoint_descriptor(self, dev: _Plugged, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        found: SimpleNamespace = self.get_interface_descriptor(dev, intf, alt, config).endpoints[ep]
        return found

    def open_device(self, dev: _Plugged) -> _Opened:
        if dev.generation != self._camera.generation:
            raise _error("No such device (it may have been disconnected)", usbip.ENODEV)
        try:
            port = self._camera.connect()
        except ThetaNotFound:
            raise _error("No such device (it may have been disconnected)", usbip.ENODEV) from None
        except ThetaStall:
            raise _error("Resource busy", EBUSY) from None
        opened = _Opened(port)
        self._control(opened, 0x00, SET_CONFIGURATION, 1, 0)
        return opened

    def close_device(self, dev_handle: _Opened) -> None:
        dev_handle.port.disconnect()

    def set_configuration(self, dev_handle: _Opened, config_value: int) -> None:
        self._control(dev_handle, 0x00, SET_CONFIGURATION, config_value, 0)

    def get_configuration(self, dev_handle: _Opened) -> int:
        return self._tried(lambda: dev_handle.port.control(struct.pack("<BBHHH", 0x80, 0x08, 0, 0, 1)))[0]

    def set_interface_altsetting(self, dev_handle: _Opened, intf: int, altsetting: int) -> None:
        self._need(dev_handle, intf)
        self._control(dev_handle, 0x01, SET_INTERFACE, altsetting, intf)

    def claim_interface(self, dev_handle: _Opened, intf: int) -> None:
        if all(s.bInterfaceNumber != intf for s in self._described().settings):
            raise _error("Entity not found", ENOENT)
        dev_handle.claims.add(intf)

    def release_interface(self, dev_handle: _Opened, intf: int) -> None:
        self._need(dev_handle, intf)
        dev_handle.claims.discard(intf)

    def bulk_write(self, dev_handle: _Opened, ep: int, intf: int, data: array[int], timeout: int) -> int:
        self._need(dev_handle, intf)
        self._tried(lambda: dev_handle.port.write(ep, data.tobytes()))
        return len(data)

    def bulk_read(self, dev_handle: _Opened, ep: int, intf: int, buff: array[int], timeout: int) -> int:
        """A timeout of 0 waits for ever, as libusb does."""
        self._need(dev_handle, intf)
        until = time.monotonic() + timeout / 1000 if timeout else float("inf")
        while (answer := self._tried(lambda: dev_handle.port.read(ep, len(buff)))) is None:
            if time.monotonic() > until:
                raise usb.core.USBTimeoutError("Operation timed out", -7, 110)
            time.sleep(POLL_S)
        buff[: len(answer)] = array("B", answer)
        return len(answer)

    def intr_read(self, dev_handle: _Opened, ep: int, intf: int, buff: array[int], timeout: int) -> int:
        return self.bulk_read(dev_handle, ep, intf, buff, timeout)

    def ctrl_transfer(
        self, dev_handle: _Opened, bm_request_type: int, request: int, value: int, index: int, data: array[int],
        timeout: int,
    ) -> int:  # fmt: skip
        setup = struct.pack("<BBHHH", bm_request_type, request, value, index, len(data))
        if not bm_request_type & 0x80:
            self._tried(lambda: dev_handle.port.control(setup, data.tobytes()))
            return len(data)
        answer = self._tried(lambda: dev_handle.port.control(setup))
        data[: len(answer)] = array("B", answer)
        return len(answer)

    def clear_halt(self, dev_handle: _Opened, ep: int) -> None:
        self._control(dev_handle, 0x02, CLEAR_FEATURE, 0, ep)

    def reset_device(self, dev_handle: _Opened) -> None:
        self._control(dev_handle, 0x00, SET_CONFIGURATION, 1, 0)

    def is_kernel_driver_active(self, dev_handle: _Opened, intf: int) -> bool:
        return False

    def _control(self, opened: _Opened, *fields: int) -> None:
        self._tried(lambda: opened.port.control(struct.pack("<BBHHH", *fields, 0)))

    def _need(self, opened: _Opened, interface: int) -> None:
        if interface not in opened.claims:
            raise _error("Entity not found", ENOENT)

    def _tried(self, work: Callable[[], T]) -> T:
        try:
            return work()
        except ThetaStall as error:
            raise usb.core.USBError(f"Pipe error: {error}", -9, usbip.EPIPE) from None
        except ThetaGone:
            raise _error("No such device (it may have been disconnected)", usbip.ENODEV) from None

    def _described(self) -> SimpleNamespace:
        """The one configuration; class descriptors belong to what stands before them, as in libusb."""
        configuration = last = SimpleNamespace()
        for raw in descriptors(self._camera.configuration):
            match raw[1]:
                case 0x02:
                    configuration = last = _fields(CONFIGURATION_LAYOUT, raw, settings=[])
                case 0x04:
                    last = _fields(INTERFACE_LAYOUT, raw, endpoints=[])
                    configuration.settings.append(last)
                case 0x05:
                    last = _fields(ENDPOINT_LAYOUT, raw, bRefresh=0, bSynchAddress=0)
                    configuration.settings[-1].endpoints.append(last)
                case _:
                    last.extra_descriptors += list(raw)
        return configuration


DEVICE_NAMES = (
    "bLength bDescriptorType bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 idVendor"
    " idProduct bcdDevice iManufacturer iProduct iSerialNumber bNumConfigurations"
)
CONFIGURATION_LAYOUT = (
    "<BBHBBBBB",
    ("bLength bDescriptorType wTotalLength bNumInterfaces bConfigurationValue iConfiguration bmAttributes bMaxPower"),
)
INTERFACE_LAYOUT = (
    "<BBBBBBBBB",
    (
        "bLength bDescriptorType bInterfaceNumber bAlternateSetting bNumEndpoints bInterfaceClass bInterfaceSubClass"
        " bInterfaceProtocol iInterface"
    ),
)
ENDPOINT_LAYOUT = "<BBBBHB", "bLength bDescriptorType bEndpointAddress bmAttributes wMaxPacketSize bInterval"


def _fields(layout: tuple[str, str], raw: bytes, **more: Any) -> SimpleNamespace:
    values = struct.unpack_from(layout[0], raw)
    return SimpleNamespace(**dict(zip(layout[1].split(), values, strict=True)), extra_descriptors=[], **more)


def _error(text: str, number: int) -> Exception:
    error: Exception = usb.core.USBError(text, None, number)
    return error
