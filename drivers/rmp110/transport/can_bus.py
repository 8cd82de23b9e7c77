"""The base's bus through python-can: socketcan on the robot, virtual, udp_multicast or socketcand otherwise."""

from __future__ import annotations

import asyncio
import errno
from collections import deque
from typing import Any

import can

from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.whitelist import forbidden
from drivers.rmp110.errors import RmpForbiddenFrame, RmpLinkError, RmpSendDropped
from drivers.rmp110.transport.base import FrameSink, LossSink
from drivers.rmp110.transport.open_bus import open_bus, plain
from drivers.rmp110.transport.reader import BusReader
from drivers.rmp110.transport.socketcand import SocketcandBus

FULL = {errno.ENOBUFS, errno.EAGAIN}
"""The driver's queue is full: usually nobody on the bus acknowledges."""
ECHOES = 32
"""Own frames to recognise when udp_multicast brings them back; a few milliseconds' worth is enough."""
CAN_ERR_BUSOFF = 0x40
"""Error class of Linux' error frames (linux/can/error.h)."""


class CanTransport:
    """A python-can bus as a `Transport`; `options` go to python-can (`host`, `port` for socketcand)."""

    def __init__(self, interface: str = "socketcan", channel: str = "can0", **options: Any) -> None:
        self.interface = interface
        self.channel = channel
        self._options = options
        self._bus: can.BusABC | None = None
        self._reader: BusReader | None = None
        self._echoes: deque[Frame] | None = deque(maxlen=ECHOES) if interface == "udp_multicast" else None
        self._foreign_kind = 0
        self.error_frames = 0

    async def open(self, on_frame: FrameSink, on_lost: LossSink) -> None:
        self._on_frame = on_frame
        self._on_lost = on_lost
        opening = asyncio.ensure_future(asyncio.to_thread(open_bus, self.interface, self.channel, self._options))
        try:
            self._bus = await asyncio.shield(opening)
        except asyncio.CancelledError:
            # The thread cannot be stopped; whatever it still opens is closed again.
            opening.add_done_callback(_discard)
            raise
        self._reader = BusReader(self._bus, self._receive, self._fail)
        self._reader.start()

    def send(self, frame: Frame) -> None:
        reason = forbidden(frame)
        if reason is not None:
            raise RmpForbiddenFrame(f"stopped right before the wire: {reason}")
        if self._bus is None:
            raise RmpLinkError(f"CAN interface {self.channel} is not open")
        message = can.Message(arbitration_id=frame.can_id, data=frame.data, is_extended_id=False)
        try:
            self._bus.send(message, timeout=0)
        except (can.CanError, OSError) as error:
            raise self._send_error(error) from error
        if self._echoes is not None:
            self._echoes.append(frame)

    def _send_error(self, error: Exception) -> RmpSendDropped | RmpLinkError:
        number = getattr(error, "error_code", None) or getattr(error, "errno", None)
        if number in FULL or "full" in str(error).lower() or isinstance(error, can.CanTimeoutError):
            return RmpSendDropped(
                f"CAN interface {self.channel} did not take a frame (transmit buffer full): "
                "nobody acknowledges on the bus; check that the base is on and the cable plugged"
            )
        return RmpLinkError(self._lost_sentence(error))

    async def close(self) -> None:
        reader, self._reader = self._reader, None
        bus, self._bus = self._bus, None
        if reader is not None:
            await reader.stop()
        if bus is not None:
            bus.shutdown()

    @property
    def damaged(self) -> int:
        overflowed = self._reader.overflowed if self._reader else 0
        unreadable = self._bus.damaged if isinstance(self._bus, SocketcandBus) else 0
        return self._foreign_kind + overflowed + unreadable

    def _receive(self, stamp_ns: int, message: can.Message) -> None:
        if message.is_error_frame:
            self.error_frames += 1
            if message.arbitration_id & CAN_ERR_BUSOFF:
                self._on_lost(
                    f"CAN interface {self.channel} went bus-off: check cable, termination (120 ohm at both ends) "
                    "and the bit rate of 1 Mbit/s"
                )
            return
        if message.is_extended_id or message.is_remote_frame or message.is_fd:
            self._foreign_kind += 1
            return
        frame = Frame(message.arbitration_id, bytes(message.data))
        if self._echoes and frame in self._echoes:
            # python-can's udp_multicast delivers one's own frames; these are not somebody else's commands.
            self._echoes.remove(frame)
            return
        self._on_frame(stamp_ns, frame)

    def _fail(self, error: Exception) -> None:
        self._on_lost(self._lost_sentence(error))

    def _lost_sentence(self, error: Exception) -> str:
        number = getattr(error, "error_code", None) or getattr(error, "errno", None)
        if number == errno.ENETDOWN:
            return f"CAN interface {self.channel} is down: run 'ip link set {self.channel} up type can bitrate 1000000'"
        if number == errno.ENODEV:
            return f"CAN interface {self.channel} is gone: the adapter was unplugged"
        return f"CAN interface {self.channel} failed: {plain(error)}"


def _discard(opening: asyncio.Future[can.BusABC]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().shutdown()
