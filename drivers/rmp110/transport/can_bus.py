"""The base's bus through python-can: socketcan on the robot, virtual, udp_multicast or socketcand otherwise."""

from __future__ import annotations

import asyncio
import errno
import logging
import threading
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

import can

from drivers.rmp110.codec.frames import FILTER_ID, FILTER_MASK, MOTION_ID, Frame
from drivers.rmp110.codec.whitelist import forbidden
from drivers.rmp110.errors import RmpForbiddenFrame, RmpLinkError, RmpSendDropped, RmpUnacknowledged
from drivers.rmp110.transport.base import FrameSink, Guard, LossSink, TransportStats, WarningSink
from drivers.rmp110.transport.bus_health import BusHealth
from drivers.rmp110.transport.bus_lock import BusLock
from drivers.rmp110.transport.error_frames import PASSIVE, ErrorClass, parse_error_frame
from drivers.rmp110.transport.open_bus import open_bus, plain
from drivers.rmp110.transport.reader import BusReader
from drivers.rmp110.transport.socketcand import SocketcandBus

log = logging.getLogger(__name__)

FULL = {errno.ENOBUFS, errno.EAGAIN}
"""The driver's queue is full: usually nobody on the bus acknowledges."""
ECHOES = 32
"""Own frames to recognise when udp_multicast brings them back; a few milliseconds' worth is enough."""


class CanTransport:
    """A python-can bus as a `Transport`; `options` go to python-can (`host`, `port` for socketcand).

    With `exclusive` nobody else who asks for the same bus gets it, on this machine; `lock_dir` says where the
    lock files are (see `bus_lock`). `on_warning` is told, in the event loop, when the bus works and is in trouble;
    without one that goes to the log. `guard` has the last word on every frame; the driver
    sets that of the dialect it finds.

    A socketcan interface keeps up to `txqueuelen` frames while nobody acknowledges, and sends them once somebody
    does. It comes with ten; leave it at that.
    """

    def __init__(
        self,
        interface: str = "socketcan",
        channel: str = "can0",
        *,
        exclusive: bool = True,
        lock_dir: Path | None = None,
        on_warning: WarningSink = log.warning,
        guard: Guard = forbidden,
        **options: Any,
    ) -> None:
        self.interface = interface
        self.channel = channel
        self._exclusive = exclusive
        self._lock_dir = lock_dir
        self._on_warning = on_warning
        self.guard = guard
        self._options = options
        self._sending = threading.Lock()
        self._bus: can.BusABC | None = None
        self._lock: BusLock | None = None
        self._reader: BusReader | None = None
        self._echoes: deque[Frame] | None = deque(maxlen=ECHOES) if interface == "udp_multicast" else None
        self._lost: str | None = None
        self._health = BusHealth(channel)
        self._unheard = False
        """Whether the controller said so, and the base has not been heard since."""
        self._foreign_kind = 0
        self._received = self._sent = self._dropped = 0

    async def open(self, on_frame: FrameSink, on_lost: LossSink) -> None:
        """Raises RmpInterfaceError, also where another owner has the bus."""
        self._on_frame = on_frame
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        opening = asyncio.ensure_future(asyncio.to_thread(self._acquire))
        try:
            self._lock, bus = await asyncio.shield(opening)
        except asyncio.CancelledError:
            # The thread cannot be stopped; whatever it still opens is closed again.
            opening.add_done_callback(_discard)
            raise
        self._bus = bus
        self._reader = BusReader(bus, self._receive, self._fail)
        self._reader.start()

    def _acquire(self) -> tuple[BusLock | None, can.BusABC]:
        lock = BusLock(self._key, self._lock_dir) if self._exclusive else None
        try:
            return lock, open_bus(self.interface, self.channel, self._options)
        except BaseException:
            if lock:
                lock.release()
            raise

    @property
    def _key(self) -> str:
        """What makes two buses the same: interface, channel, and the server where there is one."""
        places = [self._options[name] for name in ("host", "port") if name in self._options]
        return ":".join(str(part) for part in (self.interface, self.channel, *places))

    def send(self, frame: Frame) -> None:
        """See `Transport.send`; from any thread, and never longer than the kernel needs to take or refuse a frame."""
        reason = self.guard(frame)
        if reason is not None:
            raise RmpForbiddenFrame(f"stopped right before the wire: {reason}")
        if self._unheard and frame.can_id == MOTION_ID and any(frame.data):
            self._dropped += 1
            raise RmpUnacknowledged(
                f"a motion command was not sent: nobody acknowledges on CAN interface {self.channel}; "
                "check that the base is on and the cable plugged"
            )
        message = can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)
        with self._sending:
            if self._lost is not None:
                # A bus that comes back must not find old motion in its queue.
                raise RmpLinkError(self._lost)
            if self._bus is None:
                raise RmpLinkError(f"CAN interface {self.channel} is not open")
            try:
                self._bus.send(message, timeout=0)
            except (can.CanError, OSError) as error:
                raise self._send_error(error) from error
            self._sent += 1
            if self._echoes is not None:
                self._echoes.append(frame)

    def _send_error(self, error: Exception) -> RmpSendDropped | RmpLinkError:
        number = getattr(error, "error_code", None) or getattr(error, "errno", None)
        if number in FULL or "full" in str(error).lower() or isinstance(error, can.CanTimeoutError):
            self._dropped += 1
            return RmpSendDropped(
                f"CAN interface {self.channel} did not take a frame (transmit buffer full): "
                "nobody acknowledges on the bus; check that the base is on and the cable plugged"
            )
        reason = self._lost_sentence(error)
        self._loop.call_soon_threadsafe(self._lose, reason)
        return RmpLinkError(reason)

    async def close(self) -> None:
        """Stop and release the bus; may be called twice, and while another thread sends."""
        reader, self._reader = self._reader, None
        with self._sending:
            bus, self._bus = self._bus, None
        lock, self._lock = self._lock, None
        try:
            if reader is not None:
                self._foreign_kind += reader.overflowed
                await reader.stop()
        finally:
            if bus is not None:
                _shut(bus)
            if lock is not None:
                lock.release()

    @property
    def damaged(self) -> int:
        overflowed = self._reader.overflowed if self._reader else 0
        unreadable = self._bus.damaged if isinstance(self._bus, SocketcandBus) else 0
        return self._foreign_kind + overflowed + unreadable

    @property
    def error_frames(self) -> int:
        """Error frames of the controller, of any kind."""
        return self._health.counts.frames

    @property
    def stats(self) -> TransportStats:
        """Counts since `open`."""
        return TransportStats(
            received=self._received,
            sent=self._sent,
            dropped=self._dropped,
            damaged=self.damaged,
            overflowed=self._reader.overflowed if self._reader else 0,
            errors=replace(self._health.counts),
        )

    def _receive(self, stamp_ns: int, message: can.Message) -> None:
        if message.is_error_frame:
            self._judge(message)
            return
        if message.is_extended_id or message.is_remote_frame or message.is_fd:
            self._foreign_kind += 1
            return
        if message.arbitration_id & FILTER_MASK != FILTER_ID:
            # Other devices' traffic, where the interface has no filter of its own.
            return
        frame = Frame(message.arbitration_id, bytes(message.data))
        if self._echoes and frame in self._echoes:
            # python-can's udp_multicast delivers one's own frames; these are not somebody else's commands.
            self._echoes.remove(frame)
            return
        self._received += 1
        self._unheard = False
        self._on_frame(stamp_ns, frame)

    def _judge(self, message: can.Message) -> None:
        frame = parse_error_frame(message.arbitration_id, bytes(message.data))
        self._unheard = self._unheard or frame.has(ErrorClass.NO_ACK) or bool(frame.controller & PASSIVE)
        warning, lost = self._health.judge(frame)
        if warning and self._lost is None:
            self._on_warning(warning)
        if lost:
            self._lose(lost)

    def _fail(self, error: Exception) -> None:
        self._lose(self._lost_sentence(error))

    def _lose(self, reason: str) -> None:
        """Tell once, whoever noticed first: the reader, a sender, or the controller."""
        if self._lost is None and self._bus is not None:
            self._lost = reason
            self._on_lost(reason)

    def _lost_sentence(self, error: Exception) -> str:
        number = getattr(error, "error_code", None) or getattr(error, "errno", None)
        if number == errno.ENETDOWN:
            return f"CAN interface {self.channel} is down: run 'ip link set {self.channel} up type can bitrate 1000000'"
        if number == errno.ENODEV:
            return f"CAN interface {self.channel} is gone: the adapter was unplugged"
        return f"CAN interface {self.channel} failed: {plain(error)}"


def _discard(opening: asyncio.Future[tuple[BusLock | None, can.BusABC]]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        lock, bus = opening.result()
        _shut(bus)
        if lock:
            lock.release()


def _shut(bus: can.BusABC) -> None:
    try:
        bus.shutdown()
    except (can.CanError, OSError) as error:
        log.debug("closing the bus: %s", error)
