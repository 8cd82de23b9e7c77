"""HOST:PORT on the command line."""

from __future__ import annotations

from ghal360_robot.errors import UsageError


def split_address(text: str, *, any_port: bool = False) -> tuple[str, int]:
    """Host and port of `HOST:PORT` (IPv6 hosts in brackets). Port 0 only with `any_port`. Raises UsageError."""
    host, colon, digits = text.rpartition(":")
    port = int(digits) if digits.isascii() and digits.isdigit() and len(digits) <= 5 else -1
    if not colon or not host or not (0 if any_port else 1) <= port <= 65535:
        raise UsageError(f"'{text}' is no HOST:PORT, for example 127.0.0.1:3240")
    return host.removeprefix("[").removesuffix("]"), port
