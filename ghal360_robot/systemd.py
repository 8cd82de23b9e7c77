"""Telling systemd how the service is: readiness, status and the watchdog ping that the control loop feeds."""

from __future__ import annotations

import os
import socket
from dataclasses import dataclass

MAX_STATUS = 200
"""systemd shows one line; longer texts only fill its journal."""


def _address(environment: dict[str, str] | os._Environ[str]) -> str | None:
    path = environment.get("NOTIFY_SOCKET", "")
    if path.startswith("@"):
        return "\0" + path[1:]
    return path or None


@dataclass(slots=True)
class Notifier:
    """`sd_notify` without a library (man sd_notify: datagrams to $NOTIFY_SOCKET). Silent without systemd."""

    address: str | None
    ping_every_ns: int
    _socket: socket.socket | None = None
    _last_ping_ns: int = 0

    @classmethod
    def from_environment(cls, environment: dict[str, str] | os._Environ[str] = os.environ) -> Notifier:
        usec = environment.get("WATCHDOG_USEC", "")
        # Half of the deadline, as systemd's manual asks for.
        return cls(_address(environment), int(usec) * 500 if usec.isdigit() else 0)

    def ready(self) -> None:
        self._send("READY=1")

    def stopping(self) -> None:
        self._send("STOPPING=1")

    def status(self, text: str) -> None:
        printable = "".join(c if c.isprintable() else " " for c in text)
        self._send("STATUS=" + printable[:MAX_STATUS])

    def beat(self, now_ns: int) -> None:
        """Called by every control tick; pings at half the watchdog's deadline."""
        if self.ping_every_ns and now_ns - self._last_ping_ns >= self.ping_every_ns:
            self._last_ping_ns = now_ns
            self._send("WATCHDOG=1")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self.address is None:
            return
        if self._socket is None:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
        try:
            self._socket.sendto(message.encode(), self.address)
        except OSError:
            # systemd is gone or its queue is full: the watchdog on its side is what must notice, not we.
            self.address = self.address if self.ping_every_ns else None
