"""A V3 base on USB: a stream of bytes through a serial device (fact sheet sections 10, 11)."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import os
import termios
import threading
import time
import tty
from collections.abc import Callable

from drivers.rmp110.codec.bytestream import pack_command
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.v3.commands import General, general
from drivers.rmp110.codec.v3.deframer import Deframer
from drivers.rmp110.codec.v3.whitelist import forbidden
from drivers.rmp110.errors import RmpForbiddenFrame, RmpInterfaceError, RmpLinkError, RmpSendDropped
from drivers.rmp110.transport.base import FrameSink, LossSink

CHUNK_BYTES = 16384
"""Thirty packets: the loop stays alive whatever pours in."""
FAULT_LOG_REQUEST = general(General.FAULT_LOG)


class SerialTransport:
    """`device` is the base's, mostly `/dev/ttyACM0`. Nothing but V3 packets is ever sent."""

    def __init__(self, device: str = "/dev/ttyACM0", *, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._device = device
        self._clock = clock
        self._sending = threading.Lock()
        self._deframer = Deframer()
        self._fd: int | None = None
        self._lost: str | None = None

    async def open(self, on_frame: FrameSink, on_lost: LossSink) -> None:
        """Raises RmpInterfaceError."""
        self._on_frame = on_frame
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        try:
            self._fd = _open(self._device)
        except OSError as error:
            raise RmpInterfaceError(self._sentence(error)) from error
        except termios.error as error:
            raise RmpInterfaceError(f"{self._device} is not a serial device: give the base's") from error
        self._loop.add_reader(self._fd, self._read, self._fd)

    def send(self, frame: Frame) -> None:
        """See `Transport.send`."""
        reason = forbidden(frame)
        if reason is not None:
            raise RmpForbiddenFrame(f"stopped right before the wire: {reason}")
        packet = pack_command(frame)
        with self._sending:
            if self._fd is None or self._lost is not None:
                raise RmpLinkError(self._lost or f"{self._device} is not open")
            if frame == FAULT_LOG_REQUEST:
                self._deframer.expect_fault_log()
            try:
                written = os.write(self._fd, packet)
            except BlockingIOError as error:
                raise RmpSendDropped(f"{self._device} did not take a command: the base does not read") from error
            except OSError as error:
                raise self._broken(self._sentence(error)) from error
            if written < len(packet):
                # The rest must not follow later, and the next command would be garbage to the base.
                raise self._broken(f"{self._device} took half a command: the base does not read")

    async def close(self) -> None:
        """Never raises, may be called without `open`."""
        with self._sending:
            fd, self._fd = self._fd, None
        if fd is not None:
            asyncio.get_running_loop().remove_reader(fd)
            os.close(fd)

    @property
    def damaged(self) -> int:
        """Runs of bytes that belong to no packet."""
        return self._deframer.damaged

    def _read(self, fd: int) -> None:
        try:
            data = os.read(fd, CHUNK_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(self._sentence(error))
            return
        if not data:
            self._lose(f"{self._device} was closed: the base was unplugged or switched off")
            return
        stamp_ns = self._clock()
        for frame in self._deframer.feed(data):
            if self._fd is not None:
                self._on_frame(stamp_ns, frame)

    def _broken(self, sentence: str) -> RmpLinkError:
        self._loop.call_soon_threadsafe(self._lose, sentence)
        return RmpLinkError(sentence)

    def _lose(self, sentence: str) -> None:
        """Tell once; a lost device stays readable for ever, so nobody looks at it any more."""
        if self._fd is not None:
            self._loop.remove_reader(self._fd)
        if self._lost is None and self._fd is not None:
            self._lost = sentence
            self._on_lost(sentence)

    def _sentence(self, error: OSError) -> str:
        if error.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
            return f"{self._device} is not there: plug in the base's USB cable and switch the base on"
        if error.errno in (errno.EACCES, errno.EPERM):
            return f"{self._device} may not be opened by this user: add the user to the group 'dialout'"
        if error.errno in (errno.EBUSY, errno.EWOULDBLOCK):
            return f"{self._device} is in use by another program: a base has one commander, stop the other one first"
        if error.errno == errno.EIO:
            return f"{self._device} is gone: the base was unplugged or switched off"
        return f"{self._device} failed: {error.strerror or error}"


def _open(device: str) -> int:
    """Raw, 115200 baud, for one program only; what was received before is thrown away."""
    fd = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        tty.setraw(fd)
        settings = termios.tcgetattr(fd)
        settings[4] = settings[5] = termios.B115200
        termios.tcsetattr(fd, termios.TCSANOW, settings)
        termios.tcflush(fd, termios.TCIFLUSH)
    except BaseException:
        os.close(fd)
        raise
    return fd
