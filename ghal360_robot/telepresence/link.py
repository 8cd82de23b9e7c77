"""Between the robot's process and the page's: lines of JSON on one socket pair, access units on another.

Both ends stay bounded: who falls behind loses what is old, and nobody waits. The robot's end of the video is a thread
of its own; writing to the line of JSON never blocks.
"""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import threading
from dataclasses import asdict, is_dataclass
from typing import TYPE_CHECKING, Any

from ghal360_robot.telepresence.frames import Frame
from ghal360_robot.telepresence.inbox import Inbox

if TYPE_CHECKING:
    import asyncio

    from drivers.theta_v.codec.access_units import AccessUnit

UNIT = struct.Struct("<QIHHBxxxI")
"""Stamp in ns, sequence, width, height, flags (1 key, 2 tainted), length."""

MAX_LINE_BYTES = 1 << 20
MAX_BACKLOG_BYTES = 512 << 10
"""A page process that is so far behind is told nothing more until it has caught up."""

MAX_WAITING = 6
"""Access units before the process takes them in; a fifth of a second."""

MAX_UNIT_BYTES = 8 << 20


def send(writer: asyncio.StreamWriter, kind: str, value: Any) -> bool:
    """Write one line `{kind: value}`; False where the other side is too far behind to be told anything."""
    if writer.is_closing() or writer.transport.get_write_buffer_size() > MAX_BACKLOG_BYTES:
        return False
    body = asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
    writer.write(json.dumps({kind: body}, separators=(",", ":")).encode() + b"\n")
    return True


async def receive(reader: asyncio.StreamReader) -> tuple[str, Any] | None:
    """The next line as (kind, value); None when the other side is gone, or says what makes no sense."""
    try:
        line = await reader.readline()
    except (ConnectionError, ValueError):
        return None
    if not line.endswith(b"\n"):
        return None
    try:
        ((kind, value),) = json.loads(line).items()
    except (ValueError, AttributeError, RecursionError):
        return None  # out of step: nothing that follows can be trusted
    return kind, value


class VideoTap:
    """The robot's end of the video: `offer` from the camera's thread returns at once."""

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        self._waiting: Inbox[bytes] = Inbox()
        self._joining = False
        self.dropped = 0
        self._thread = threading.Thread(target=self._send, name="page video", daemon=True)
        self._thread.start()

    def offer(self, unit: AccessUnit) -> None:
        """One more access unit; where the process does not keep up, all up to the next key picture are dropped."""
        if not unit.decodable or len(unit.data) > MAX_UNIT_BYTES:
            return
        flags = unit.keyframe | unit.tainted << 1
        header = UNIT.pack(unit.stamp_ns, unit.sequence & 0xFFFFFFFF, unit.width, unit.height, flags, len(unit.data))
        if unit.keyframe and len(self._waiting) < MAX_WAITING:
            self._joining = False
        if self._joining or len(self._waiting) >= MAX_WAITING:
            self._joining = True
            self.dropped += 1
            return
        self._waiting.put(header + unit.data)

    def close(self) -> None:
        """End the thread; what waits is dropped."""
        self._waiting.close()
        with contextlib.suppress(OSError):
            self._sock.shutdown(socket.SHUT_RDWR)  # wakes the thread where it waits to send
        self._sock.close()

    def _send(self) -> None:
        while (message := self._waiting.get()) is not None:
            try:
                self._sock.sendall(message)
            except OSError:
                return  # the process is gone; its end is noticed elsewhere


async def receive_frame(reader: asyncio.StreamReader) -> Frame | None:
    """The next access unit; None when the other side is gone."""
    try:
        stamp_ns, sequence, width, height, flags, length = UNIT.unpack(await reader.readexactly(UNIT.size))
        if length > MAX_UNIT_BYTES:
            raise ValueError(f"an access unit of {length} bytes: the link is out of step")
        data = await reader.readexactly(length)
    except (EOFError, ConnectionError):
        return None
    return Frame(data, stamp_ns, sequence, width, height, bool(flags & 1), bool(flags & 2))
