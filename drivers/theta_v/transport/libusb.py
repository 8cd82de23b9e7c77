"""The camera on this machine's own USB, through libusb: asynchronous transfers, isochronous ones included.

One thread collects what libusb completes. What blocks (opening, claiming, alternate settings, closing) runs
one after the other in a worker thread. A new libusb session is made for each opening: without a running
udevd a session never hears of devices that come later.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

from drivers.theta_v.codec.descriptors import Endpoint
from drivers.theta_v.errors import ThetaError, ThetaGone, ThetaNotFound, ThetaRefused, ThetaWrongDevice
from drivers.theta_v.transport import usb1_api
from drivers.theta_v.transport.base import BULK_S, CONTROL_S, RICOH, GoneSink, PacketSink
from drivers.theta_v.transport.libusb_requests import exchange
from drivers.theta_v.transport.libusb_video import Queue, VideoTransfers
from drivers.theta_v.transport.opened import OpenedCamera
from drivers.theta_v.transport.usb1_api import Context, Device, Handle

EVENTS_S = 1.0  # how long the collecting thread waits at most; it is woken for everything that matters
CLOSE_S = 5.0  # the kernel gives back cancelled transfers at once; a driver that does not must not hold us

T = TypeVar("T")

log = logging.getLogger(__name__)


class LibUsbTransport(OpenedCamera):
    """A `UsbTransport` to a camera on this machine. See `UsbTransport` for the methods."""

    def __init__(
        self, *, queue: Queue | None = None, open_context: Callable[[], Context] = usb1_api.open_context
    ) -> None:
        super().__init__()
        self._queue = queue or Queue()
        self._open_context = open_context
        self._worker: ThreadPoolExecutor | None = None
        self._context: Context | None = None
        self._handle: Handle | None = None
        self._place = (0, 0)
        self._thread: threading.Thread | None = None
        self._ending = threading.Event()
        self._video: VideoTransfers | None = None
        self._on_gone: GoneSink | None = None
        self._lock = threading.Lock()
        self._gone = ""

    @property
    def name(self) -> str:
        return "USB"

    async def open(self, serial: str | None, on_gone: GoneSink) -> None:
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="theta-usb-worker")
        self._gone = ""
        try:
            await self._find(serial)
        except BaseException:
            await self.close()
            raise
        with self._lock:
            self._on_gone = on_gone
            reason = self._gone
        if reason:
            await self.close()
            raise ThetaGone(reason)

    async def close(self) -> None:
        with self._lock:
            self._on_gone = None
        worker, self._worker = self._worker, None
        if worker is None:
            return
        closing = asyncio.get_running_loop().run_in_executor(worker, self._shut_down)
        worker.shutdown(wait=False)
        try:
            # Whoever gives up waiting gets a camera that is let go all the same, or the next opening finds it held.
            await asyncio.shield(closing)
        finally:
            if not closing.done():
                _, unfinished = await asyncio.wait([closing], timeout=CLOSE_S)
                if unfinished:
                    log.warning("the kernel does not give the camera back")

    async def control(
        self,
        request_type: int,
        request: int,
        value: int,
        index: int,
        data_or_length: bytes | int = b"",
        timeout_s: float = CONTROL_S,
    ) -> bytes:
        if bool(request_type & 0x80) != isinstance(data_or_length, int) and data_or_length:
            raise ValueError("the direction of the request and of its data differ")
        what = f"request {request:#04x}"
        answer = await exchange(
            self._open_handle(),
            lambda t, ended: t.setControl(request_type, request, value, index, data_or_length, ended),
            what,
            timeout_s,
        )
        return answer if request_type & 0x80 else b""

    async def bulk_out(self, endpoint: int, data: bytes, timeout_s: float = BULK_S) -> None:
        await self._bulk(endpoint, data, timeout_s)

    async def bulk_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        return await self._bulk(endpoint, length, timeout_s)

    async def interrupt_in(self, endpoint: int, length: int, timeout_s: float = BULK_S) -> bytes:
        self.need_endpoint(endpoint)
        what = f"endpoint {endpoint:#04x}"
        return await exchange(
            self._open_handle(), lambda t, ended: t.setInterrupt(endpoint, length, ended), what, timeout_s
        )

    async def claim(self, interface: int) -> None:
        if not self.claimed(interface):
            handle = self._open_handle()
            await self._blocking(lambda: handle.claimInterface(interface), f"interface {interface}")
            self._claims.add(interface)

    async def release(self, interface: int) -> None:
        if self.claimed(interface):
            self._claims.discard(interface)
            handle = self._open_handle()
            await self._blocking(lambda: handle.releaseInterface(interface), f"interface {interface}")

    async def set_interface(self, interface: int, alternate: int) -> None:
        self.need(interface)
        handle = self._open_handle()
        what = f"alternate setting {alternate} of interface {interface}"
        try:
            await self._blocking(lambda: handle.setInterfaceAltSetting(interface, alternate), what)
        except ThetaGone as error:
            if not alternate or isinstance(error.__cause__, usb1_api.UsbNoDevice):
                raise
            # Seen when another camera on the same bus has taken the bandwidth (fact sheet 1.5).
            raise ThetaRefused(
                f"{error}; if another camera shares the USB controller, there is no room for both: use another port"
            ) from error

    async def clear_halt(self, endpoint: int) -> None:
        handle = self._open_handle()
        await self._blocking(lambda: handle.clearHalt(endpoint), f"clearing endpoint {endpoint:#04x}")

    async def reset(self) -> None:
        handle = self._open_handle()
        try:
            await self._blocking(handle.resetDevice, "a reset")
        except ThetaGone:
            raise
        except ThetaError as error:
            raise ThetaGone(f"the camera did not survive a reset: {error}") from error

    async def start_video(self, endpoint: Endpoint, payload_bytes: int, on_packets: PacketSink) -> None:
        self.need_endpoint(endpoint.address)
        if self._video is not None:
            raise RuntimeError("video is running already")
        handle = self._open_handle()
        video = VideoTransfers(handle, endpoint, payload_bytes, self._queue, on_packets, self._lose)
        self._video = video
        try:
            await self._blocking(video.start, "video")
        except ThetaError:
            self._video = None
            raise

    async def stop_video(self) -> None:
        video, self._video = self._video, None
        if video is not None:
            await self._blocking(video.stop, "video")

    async def _bulk(self, endpoint: int, data_or_length: bytes | int, timeout_s: float) -> bytes:
        self.need_endpoint(endpoint)
        what = f"endpoint {endpoint:#04x}"
        answer = await exchange(
            self._open_handle(), lambda t, ended: t.setBulk(endpoint, data_or_length, ended), what, timeout_s
        )
        return answer if isinstance(data_or_length, int) else b""

    async def _find(self, serial: str | None) -> None:
        devices = await self._blocking(self._look, "opening")
        if not devices:
            raise ThetaNotFound("no THETA on USB; is it plugged in and switched on?")
        others: list[str] = []
        refused: ThetaError | None = None
        for device in devices:
            try:
                await self._blocking(partial(self._take, device), "opening")
                who = await self.read_descriptors(self)
            except ThetaError as error:
                refused = error  # another one may do better
            else:
                if who.is_theta and serial in (None, who.serial):
                    return
                others.append(f"{who.product or 'an unnamed device'} {who.serial}".strip())
            await self._blocking(self._put_back, "closing")
        if refused is not None:
            raise refused
        wanted = f"a THETA with serial number {serial}" if serial else "a THETA"
        raise ThetaWrongDevice(f"on USB there is {', '.join(others)}, but not {wanted}")

    def _look(self) -> list[Device]:
        """In the worker: start a session and collect events; return what Ricoh made."""
        self._context = context = self._open_context()
        self._ending.clear()
        self._thread = threading.Thread(target=self._collect, args=(context,), name="theta-usb", daemon=True)
        self._thread.start()
        with contextlib.suppress(usb1_api.UsbError):  # no hot-plug here: transfers tell of the loss as well
            context.hotplugRegisterCallback(self._hotplugged, usb1_api.LEFT, 0, RICOH)
        return [d for d in context.getDeviceIterator(skip_on_error=True) if d.getVendorID() == RICOH]

    def _take(self, device: Device) -> None:
        self._handle = handle = device.open()
        self._place = (device.getBusNumber(), device.getDeviceAddress())
        with contextlib.suppress(usb1_api.UsbNotSupported):
            handle.setAutoDetachKernelDriver(True)
        if not handle.getConfiguration():
            handle.setConfiguration(1)

    def _put_back(self) -> None:
        handle, self._handle = self._handle, None
        self._claims.clear()
        if handle is not None:
            handle.close()

    def _shut_down(self) -> None:
        """In the worker: everything in the order in which it depends on one another."""
        video, self._video = self._video, None
        if video is not None:
            video.stop()
        handle = self._handle
        for interface in sorted(self._claims):
            with contextlib.suppress(usb1_api.UsbError):  # it may have left
                if handle is not None:
                    handle.releaseInterface(interface)
        thread, self._thread = self._thread, None
        context, self._context = self._context, None
        self._ending.set()
        if thread is not None and context is not None:
            context.interruptEventHandler()
            thread.join()
        try:
            self._put_back()
        finally:
            if context is not None:
                context.close()

    def _collect(self, context: Context) -> None:
        """The event thread: callbacks run in here and must return at once."""
        while not self._ending.is_set():
            try:
                context.handleEventsTimeout(EVENTS_S)
                video = self._video
                if video is not None:
                    video.round_ended()
            except usb1_api.UsbInterrupted:
                continue
            except usb1_api.UsbError as error:
                self._lose(f"libusb cannot collect what the camera sends: {error}")
                return

    def _hotplugged(self, _context: Any, device: Device, _event: int) -> bool:
        if (device.getBusNumber(), device.getDeviceAddress()) == self._place:
            self._lose(usb1_api.LEFT_THE_BUS)
        return False

    def _lose(self, reason: str) -> None:
        """From the event thread, as often as it likes; the driver hears of it once."""
        with self._lock:
            first, self._gone = not self._gone, self._gone or reason
            tell = self._on_gone if first else None
        if tell is not None:
            tell(reason)

    def _open_handle(self) -> Handle:
        if self._handle is None or self._gone:
            raise ThetaGone(self._gone or "the camera is not open")
        return self._handle

    async def _blocking(self, work: Callable[[], T], what: str) -> T:
        """Run `work` in the worker. Raises ThetaError for what libusb says."""
        if self._worker is None:
            raise ThetaGone("the camera is not open")
        try:
            return await asyncio.get_running_loop().run_in_executor(self._worker, work)
        except usb1_api.UsbError as error:
            raise usb1_api.translated(error, what) from error
