# ruff: noqa: N802 the names are usb1's
"""The part of `usb1` (python-libusb1) this driver uses, typed; loading libusb; its errors as ours.

`usb1` carries no types. These protocols are what the driver relies on, and what a fake of it must keep.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import libusb_package
import numpy as np
import usb1  # type: ignore[import-untyped]
from numpy.typing import NDArray

from drivers.theta_v.errors import (
    ThetaError,
    ThetaGone,
    ThetaNotFound,
    ThetaRefused,
    ThetaStall,
    ThetaTimeout,
)

COMPLETED: int = usb1.TRANSFER_COMPLETED
CANCELLED: int = usb1.TRANSFER_CANCELLED
STALLED: int = usb1.TRANSFER_STALL
NO_DEVICE: int = usb1.TRANSFER_NO_DEVICE
OVERFLOWED: int = usb1.TRANSFER_OVERFLOW
LEFT: int = usb1.HOTPLUG_EVENT_DEVICE_LEFT
ARRIVED: int = usb1.HOTPLUG_EVENT_DEVICE_ARRIVED

UsbError: type[Exception] = usb1.USBError
UsbNotFound: type[Exception] = usb1.USBErrorNotFound
UsbNoDevice: type[Exception] = usb1.USBErrorNoDevice
UsbNotSupported: type[Exception] = usb1.USBErrorNotSupported
UsbInterrupted: type[Exception] = usb1.USBErrorInterrupted
UsbAccess: type[Exception] = usb1.USBErrorAccess
UsbBusy: type[Exception] = usb1.USBErrorBusy
UsbPipe: type[Exception] = usb1.USBErrorPipe
UsbTimeout: type[Exception] = usb1.USBErrorTimeout

LEFT_THE_BUS = "the camera left the bus: unplugged, switched off or changing its mode"


class Transfer(Protocol):
    """One asynchronous transfer; its callback runs in the thread that handles events."""

    def setControl(
        self, request_type: int, request: int, value: int, index: int, buffer_or_len: bytes | int,
        callback: Callable[[Transfer], None],
    ) -> None: ...  # fmt: skip
    def setBulk(self, endpoint: int, buffer_or_len: bytes | int, callback: Callable[[Transfer], None]) -> None: ...
    def setInterrupt(self, endpoint: int, buffer_or_len: bytes | int, callback: Callable[[Transfer], None]) -> None: ...
    def setIsochronous(
        self, endpoint: int, buffer_or_len: bytes | int, callback: Callable[[Transfer], None]
    ) -> None: ...
    def submit(self) -> None: ...
    def cancel(self) -> None: ...
    def doom(self) -> None: ...
    def close(self) -> None: ...
    def isSubmitted(self) -> bool: ...
    def getStatus(self) -> int: ...
    def getActualLength(self) -> int: ...
    def getBuffer(self) -> memoryview | bytearray: ...
    def iterISO(self) -> Iterator[tuple[int, bytearray]]: ...


class Handle(Protocol):
    """An opened device. Everything here but `getTransfer` may block and belongs into a worker thread."""

    def getTransfer(self, iso_packets: int = 0) -> Transfer: ...
    def getConfiguration(self) -> int: ...
    def setConfiguration(self, configuration: int) -> None: ...
    def setAutoDetachKernelDriver(self, enable: bool) -> None: ...
    def claimInterface(self, interface: int) -> object: ...
    def releaseInterface(self, interface: int) -> None: ...
    def setInterfaceAltSetting(self, interface: int, alt_setting: int) -> None: ...
    def clearHalt(self, endpoint: int) -> None: ...
    def resetDevice(self) -> None: ...
    def close(self) -> None: ...


class Device(Protocol):
    def getVendorID(self) -> int: ...
    def getBusNumber(self) -> int: ...
    def getDeviceAddress(self) -> int: ...
    def open(self) -> Handle: ...


class Context(Protocol):
    """One libusb session: its list of devices is that of the moment it was opened."""

    def getDeviceIterator(self, skip_on_error: bool = False) -> Iterator[Device]: ...
    def handleEventsTimeout(self, tv: float = 0) -> None: ...
    def interruptEventHandler(self) -> None: ...
    def hotplugRegisterCallback(
        self, callback: Callable[[Any, Device, int], bool], events: int, flags: int, vendor_id: int
    ) -> int: ...
    def close(self) -> None: ...


def open_context() -> Context:
    """A new libusb session: the system's library, else the one that `libusb-package` brings along.

    Raises ThetaNotFound when there is neither, or the kernel shows no USB at all.
    """
    try:
        try:
            usb1.loadLibrary()
        except OSError:
            path = libusb_package.get_library_path()
            if path is None:
                raise ThetaNotFound("libusb is missing: apt install libusb-1.0-0") from None
            usb1.loadLibrary(ctypes.CDLL(str(path), use_errno=True))
        context: Context = usb1.USBContext().open()
    except (UsbError, OSError) as error:
        if isinstance(error, ThetaError):
            raise
        raise ThetaNotFound(f"libusb cannot look at this machine's USB: {error}") from error
    return context


IsoTable = NDArray[np.int32]
"""(packets, 3): room, actual length and status of each packet, as libusb keeps them."""


def iso_table(transfer: Transfer) -> IsoTable | None:
    """A view of libusb's own table of an isochronous transfer, or None where this `usb1` hides it.

    `usb1` hands it out through an iterator alone, which costs a microsecond for each of 8000 microframes a
    second, empty or not; through the view empty ones cost a tenth. Valid as long as the transfer lives.
    """
    pointer = getattr(transfer, "_USBTransfer__transfer", None)
    if not isinstance(pointer, usb1.libusb1.libusb_transfer_p):
        return None
    return np.frombuffer(usb1.libusb1.get_iso_packet_list(pointer), np.int32).reshape(-1, 3)


def translated(error: Exception, what: str) -> ThetaError:
    """What a `usb1` error means to the person at the robot; `what` names the request."""
    if isinstance(error, UsbNoDevice):
        return ThetaGone(LEFT_THE_BUS)
    if isinstance(error, UsbPipe):
        return ThetaStall(f"the camera refuses {what}")
    if isinstance(error, UsbTimeout):
        return ThetaTimeout(f"the camera did not answer {what}")
    if isinstance(error, UsbBusy):
        return ThetaRefused(f"another program holds the camera ({what}); end it and try again")
    if isinstance(error, UsbAccess):
        return ThetaRefused(
            "this user may not open the camera: install systemd/70-ghal360-theta.rules in /etc/udev/rules.d"
            " and plug the camera in again"
        )
    return ThetaGone(f"USB error at {what}: {error}")
