"""The text that socketcand speaks over TCP, both directions: `< send 500 8 0 0 0 0 0 0 0 0 >`.

https://github.com/linux-can/socketcand, doc/protocol.md. Whatever arrives is hostile: bounded and counted.
"""

from __future__ import annotations

import can

MAX_MESSAGE = 200
"""The longest message of the raw mode has 60 characters; anything that does not end is no message."""


class TextSplitter:
    """Messages between `<` and `>` from a byte stream in any fragmentation; `damaged` counts what was none."""

    def __init__(self) -> None:
        self._rest = b""
        self.damaged = 0

    def feed(self, data: bytes) -> list[str]:
        """The messages that are complete now, without brackets and outer blanks."""
        messages: list[str] = []
        *complete, rest = (self._rest + data).split(b">")
        for piece in complete:
            junk, bracket, text = piece.rpartition(b"<")
            if junk.strip() or not bracket or len(text) > MAX_MESSAGE:
                self.damaged += 1
            if bracket and len(text) <= MAX_MESSAGE:
                messages.append(text.decode("ascii", "replace").strip())
        if len(rest) > MAX_MESSAGE:
            self.damaged += 1
            rest = b""
        self._rest = rest
        return messages


def format_send(message: can.Message) -> bytes:
    """A frame from client to server."""
    data = " ".join(f"{byte:x}" for byte in message.data)
    return f"< send {_id(message)} {len(message.data):x} {data} >".encode("ascii")


def parse_send(text: str) -> can.Message | None:
    """The frame of a `send` message; None where it is none."""
    parts = text.split()
    if len(parts) < 3 or parts[0] != "send":
        return None
    try:
        length = int(parts[2], 16)
        data = bytes(int(part, 16) for part in parts[3:])
    except ValueError:
        return None
    return _message(parts[1], data) if length == len(data) else None


def format_frame(message: can.Message) -> bytes:
    """A frame from server to client."""
    return f"< frame {_id(message)} {message.timestamp:.6f} {message.data.hex().upper()} >".encode("ascii")


def format_error(can_id: int, timestamp: float) -> bytes:
    """An error frame from server to client: its classes, without details."""
    return f"< error {can_id & 0x1FFFFFFF:03X} {timestamp:.6f} >".encode("ascii")


def parse_frame(text: str) -> can.Message | None:
    """The frame of a `frame` or `error` message; None where it is none."""
    parts = text.split()
    if len(parts) == 3 and parts[0] == "error" and _is_hex(parts[1]) and _is_time(parts[2]):
        return can.Message(arbitration_id=int(parts[1], 16) & 0x1FFFFFFF, is_error_frame=True, is_extended_id=True)
    if len(parts) < 3 or parts[0] != "frame":
        return None
    try:
        data = bytes.fromhex("".join(parts[3:]))
    except ValueError:
        return None
    return _message(parts[1], data)


def _id(message: can.Message) -> str:
    return f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"


def _is_hex(text: str) -> bool:
    return 0 < len(text) <= 8 and all(character in "0123456789abcdefABCDEF" for character in text)


def _is_time(text: str) -> bool:
    """Seconds with a decimal point; words of an error message are none."""
    seconds, point, fraction = text.partition(".")
    return bool(point) and seconds.isdigit() and fraction.isdigit()


def _message(can_id: str, data: bytes) -> can.Message | None:
    if not _is_hex(can_id) or len(data) > 8:
        return None
    number, extended = int(can_id, 16), len(can_id) == 8
    if number > (0x1FFFFFFF if extended else 0x7FF):
        return None
    return can.Message(arbitration_id=number, is_extended_id=extended, data=data)
