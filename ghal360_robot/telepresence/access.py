"""Who may open the page: tokens in a file of its owner, sessions behind strict cookies, names this robot answers to."""

from __future__ import annotations

import hmac
import json
import os
import secrets
import stat
from dataclasses import dataclass, field
from enum import StrEnum
from ipaddress import ip_address
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from ghal360_robot.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

COOKIE = "ghal360"
TOKEN_BYTES = 24
SESSION_NS = 12 * 3600 * 1_000_000_000
"""A working day; then the token is asked for again."""

MAX_SESSIONS = 64


class Role(StrEnum):
    """What somebody may do; a viewer may look and stop the robot, a driver may drive as well."""

    VIEWER = "viewer"
    DRIVER = "driver"


def is_loopback(address: str) -> bool:
    """Whether only this machine can reach a server listening there."""
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


def load_tokens(path: Path) -> dict[Role, str]:
    """The tokens in `path`, made anew where there is no such file. Raises UsageError, also where others may read it."""
    try:
        if path.exists():
            return _read_tokens(path)
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        tokens = {role: secrets.token_urlsafe(TOKEN_BYTES) for role in Role}
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            json.dump(tokens, file)
    except OSError as error:
        raise UsageError(f"cannot use the token file {path}: {error.strerror}") from error
    return tokens


def _read_tokens(path: Path) -> dict[Role, str]:
    if stat.S_IMODE(path.stat().st_mode) & 0o077:
        raise UsageError(f"others may read the tokens in {path}: run `chmod 600 {path}`, or delete it for new ones")
    try:
        data = json.loads(path.read_text(encoding="ascii"))
        tokens = {role: str(data[role]) for role in Role}
    except (ValueError, KeyError, TypeError) as error:
        raise UsageError(f"{path} does not hold a viewer's and a driver's token: delete it for new ones") from error
    if any(len(token) < TOKEN_BYTES for token in tokens.values()) or len(set(tokens.values())) < len(tokens):
        raise UsageError(f"the tokens in {path} are too short or alike: delete it for new ones")
    return tokens


@dataclass(slots=True)
class Sessions:
    """Tokens become sessions: cookies nobody can read or send from elsewhere. Instants are the caller's."""

    tokens: dict[Role, str]
    _open: dict[str, tuple[Role, int]] = field(default_factory=dict)

    def log_in(self, token: str, now_ns: int) -> tuple[str, Role] | None:
        """A new session, or None for a token that is none."""
        role = None
        for candidate, known in self.tokens.items():  # all are compared, so that time tells nothing
            if hmac.compare_digest(token.encode(), known.encode()):
                role = candidate
        if role is None:
            return None
        while len(self._open) >= MAX_SESSIONS:
            del self._open[next(iter(self._open))]
        session = secrets.token_urlsafe(TOKEN_BYTES)
        self._open[session] = (role, now_ns)
        return session, role

    def role(self, session: str | None, now_ns: int) -> Role | None:
        """What the bearer of this cookie may do; None for nothing."""
        role, since_ns = self._open.get(session or "", (None, 0))
        if role is not None and now_ns - since_ns > SESSION_NS:
            self._open.pop(session or "", None)
            return None
        return role

    def log_out(self, session: str | None) -> None:
        self._open.pop(session or "", None)


def allowed_hosts(listen: str, port: int, names: Iterable[str]) -> frozenset[str]:
    """What a Host header may say, lower case with port; anything else is another site's name for this address."""
    own = ("localhost", "127.0.0.1", "::1") if is_loopback(listen) else ()
    unspecified = listen in {"0.0.0.0", "::"}  # noqa: S104 - compared with, not bound to
    hosts = {*own, *names, *(() if unspecified else (listen,))}
    return frozenset(f"{in_address(host).lower()}:{port}" for host in hosts)


def in_address(host: str) -> str:
    """A host as it stands in an address: IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host


def host_allowed(host: str | None, allowed: frozenset[str], *, tls: bool) -> bool:
    """Whether a request's Host header names this robot (else: DNS rebinding)."""
    if not host:
        return False
    default = ":443" if tls else ":80"
    host = host.lower()
    return host in allowed or host + default in allowed


def origin_allowed(origin: str | None, host: str | None, *, tls: bool) -> bool:
    """Whether the page that asks came from this very server; no Origin at all is no browser of ours."""
    if not origin or not host:
        return False
    parts = urlsplit(origin)
    return parts.scheme == ("https" if tls else "http") and parts.netloc.lower() == host.lower()
