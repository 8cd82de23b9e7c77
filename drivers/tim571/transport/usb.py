"""The lidar over its USB port: the same telegrams over two bulk endpoints (fact sheet section 7).

A TiM571 needs its 24 V supply for this as well, and speaks CoLa-A as delivered.
"""

from __future__ import annotations

import asyncio
import errno
import threading
import time
from collections import deque
from collections.abc import Callable, Coroutine
from importlib import import_module
from typing import Any, Protocol

from drivers.tim571.errors import TimUnreachableError

VENDOR_ID = 0x19A2
PRODUCT_ID = 0x5001
ENDPOINT_OUT = 0x02
ENDPOINT_IN = 0x81

READ_BYTES = 1 << 16
READ_TIMEOUT_S = 0.2  # how long closing may take; scans come every 67 ms
WRITE_TIMEOUT_S = 1.0  # a request is one packet, and a device that takes none is gone
CLOSE_TIMEOUT_S = 2.0  # a read, its time-out and a halt to clear
INBOX_BYTES = 1 << 18  # about 5 s of scans; beyond that the reader is stuck and the oldest are of no use
MOST_HALTS = 3  # in a row; a halt that comes back every time needs the device opened anew
ERRNO_TIMEOUT, ERRNO_PIPE = errno.ETIMEDOUT, errno.EPIPE


class Pipe(Protocol):
    """Two bulk endpoints of an open device; used from one thread at a time for each direction."""

    def read(self, size: int, timeout_s: float) -> bytes:
        """The next transfer; empty if none came in time. Raises OSError if the device is gone."""

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send; raises OSError if the device takes nothing."""

    def close(self) -> None:
        """Release the device."""


class UsbTransport:
    """A TiM571 on USB; `serial` chooses among several. Transfers are stamped as they complete, in a thread."""

    def __init__(self, serial: str | None = None, open_pipe: Callable[[str | None], Pipe] | None = None) -> None:
        self._serial = serial
        self._open_pipe = open_pipe or PyUsbPipe
        self._inbox: _Inbox | None = None

    @property
    def name(self) -> str:
        return f"USB {VENDOR_ID:04x}:{PRODUCT_ID:04x}" + (f" serial {self._serial}" if self._serial else "")

    async def open(self) -> None:
        await self.close()
        try:
            pipe = await _unless_cancelled(asyncio.to_thread(self._open_pipe, self._serial))
        except TimUnreachableError:
            raise
        except OSError as error:
            raise TimUnreachableError(
                f"TiM571 at {self.name} cannot be opened ({error.strerror or error}): another program may have it; as"
                " it is, only root may, unless udev gives you access to 19a2:5001."
            ) from error
        self._inbox = _Inbox(pipe, self.name)

    async def read(self) -> tuple[int, bytes]:
        return await self._connected().take()

    async def write(self, data: bytes) -> None:
        await self._connected().send(data)

    async def close(self) -> None:
        inbox, self._inbox = self._inbox, None
        if inbox is not None:
            await inbox.close()

    def _connected(self) -> _Inbox:
        if self._inbox is None:
            raise TimUnreachableError(f"TiM571 at {self.name} is not connected.")
        return self._inbox


async def _unless_cancelled(opening: Coroutine[Any, Any, Pipe]) -> Pipe:
    """A thread cannot be cancelled: what it opens after nobody wants it any more is closed."""
    task = asyncio.ensure_future(opening)
    try:
        return await asyncio.shield(task)
    except asyncio.CancelledError:
        task.add_done_callback(lambda done: None if done.cancelled() or done.exception() else done.result().close())
        raise


class _Inbox:
    """Transfers handed from the thread that waits for them to the event loop."""

    def __init__(self, pipe: Pipe, device: str) -> None:
        self._pipe = pipe
        self._device = device
        self._chunks: deque[tuple[int, bytes]] = deque()
        self._size = 0
        self._broken: OSError | None = None
        self._news = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._receive, name=f"read {device}", daemon=True)
        self._thread.start()

    async def take(self) -> tuple[int, bytes]:
        while not self._chunks:
            if self._broken is not None:
                raise TimUnreachableError(
                    f"TiM571 at {self._device} is gone ({self._broken.strerror or self._broken}): check its cable and"
                    " its 24 V supply; after a static discharge it has to be plugged in anew."
                ) from self._broken
            self._news.clear()
            await self._news.wait()
        stamp_ns, data = self._chunks.popleft()
        self._size -= len(data)
        return stamp_ns, data

    async def send(self, data: bytes) -> None:
        try:
            await asyncio.to_thread(self._pipe.write, data, WRITE_TIMEOUT_S)
        except OSError as error:
            raise TimUnreachableError(
                f"TiM571 at {self._device} takes no request ({error.strerror or error}): check its cable and its 24 V"
                " supply."
            ) from error

    async def close(self) -> None:
        self._closing.set()
        await asyncio.to_thread(self._thread.join, CLOSE_TIMEOUT_S)
        await asyncio.to_thread(self._pipe.close)

    def _receive(self) -> None:
        """The thread."""
        while not self._closing.is_set():
            try:
                data = self._pipe.read(READ_BYTES, READ_TIMEOUT_S)
            except OSError as error:
                self._hand_over(self._fail, error)
                return
            if data:
                self._hand_over(self._arrive, time.monotonic_ns(), data)

    def _hand_over(self, call: Callable[..., None], *values: Any) -> None:
        if not self._closing.is_set() and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(call, *values)

    def _arrive(self, stamp_ns: int, data: bytes) -> None:
        self._chunks.append((stamp_ns, data))
        self._size += len(data)
        while self._size > INBOX_BYTES:
            self._size -= len(self._chunks.popleft()[1])
        self._news.set()

    def _fail(self, error: OSError) -> None:
        self._broken = error
        self._news.set()


def _serial_number(device: Any) -> str:
    try:
        return str(device.serial_number)
    except (ValueError, OSError):  # what pyusb raises where udev gives no access
        return ""


class PyUsbPipe:
    """A `Pipe` by pyusb, which is imported only here: a robot with its lidar on Ethernet does without it."""

    def __init__(self, serial: str | None) -> None:
        try:
            self._core: Any = import_module("usb.core")
            self._util: Any = import_module("usb.util")
        except ImportError as error:
            raise TimUnreachableError(
                "A TiM571 on USB needs pyusb, which is not installed: pip install pyusb (and apt install libusb-1.0-0);"
                " or connect it by Ethernet."
            ) from error
        try:
            found = list(self._core.find(find_all=True, idVendor=VENDOR_ID, idProduct=PRODUCT_ID))
        except self._core.NoBackendError as error:
            raise TimUnreachableError(
                "pyusb finds no libusb on this computer: apt install libusb-1.0-0, or connect the lidar by Ethernet."
            ) from error
        devices = [device for device in found if serial is None or _serial_number(device) == serial]
        if len(devices) != 1:
            which = f"with serial number {serial} " if serial else ""
            raise TimUnreachableError(
                f"{len(devices) or 'No'} TiM5xx {which}on USB ({VENDOR_ID:04x}:{PRODUCT_ID:04x}): "
                + ("give the serial number of one." if devices else "check its cable, and its 24 V supply as well.")
            )
        (self._device,) = devices
        self._halts = 0
        if self._device.is_kernel_driver_active(0):
            self._device.detach_kernel_driver(0)
        self._device.set_configuration()
        self._util.claim_interface(self._device, 0)

    def read(self, size: int, timeout_s: float) -> bytes:
        try:
            data = bytes(self._device.read(ENDPOINT_IN, size, round(1000 * timeout_s)))
        except OSError as error:  # pyusb's USBError is one
            if error.errno == ERRNO_TIMEOUT:
                return b""
            self._halts += 1
            if error.errno != ERRNO_PIPE or self._halts > MOST_HALTS:
                raise
            self._device.clear_halt(ENDPOINT_IN)
            return b""
        self._halts = 0
        return data

    def write(self, data: bytes, timeout_s: float) -> None:
        self._device.write(ENDPOINT_OUT, data, round(1000 * timeout_s))

    def close(self) -> None:
        self._util.dispose_resources(self._device)
