"""One telegram: what kind it is, what it is about, and the parameters still as bytes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from drivers.tim571.codec.deframer import Damage, Deframer, Frame
from drivers.tim571.codec.dialect import Dialect, frame
from drivers.tim571.codec.faults import Fault
from drivers.tim571.errors import TimMalformedError

ANSWER_OF = {"sRN": "sRA", "sRI": "sRA", "sWN": "sWA", "sWI": "sWA", "sMN": "sAN", "sMI": "sAN", "sEN": "sEA"}
"""Kind of the answer to each kind of request (fact sheet section 2)."""

FAULT = "sFA"
_HEADER_B = 8
_NAME = re.compile(r"[A-Za-z0-9_]+")


@dataclass(frozen=True, slots=True)
class Telegram:
    """A telegram taken apart as far as every telegram is the same.

    `name` is a variable, method or event; by-index telegrams carry the index in decimal. `sFA` has no name.
    `frame` is the telegram exactly as on the wire; `stamp_ns` the arrival of its first byte.
    """

    dialect: Dialect
    kind: str
    name: str
    body: bytes
    frame: bytes = b""
    stamp_ns: int = 0

    def to_wire(self) -> bytes:
        """The framed bytes of kind, name and body."""
        return frame(self.dialect, _payload(self.dialect, self.kind, self.name, self.body))


def parse(dialect: Dialect, framed: bytes, stamp_ns: int = 0) -> Telegram:
    """Take a complete frame apart; raises TimMalformedError if it names nothing."""
    payload = framed[1:-1] if dialect is Dialect.A else framed[_HEADER_B:-1]
    kind = payload[:3].decode("latin-1")
    rest = payload[4:] if payload[3:4] == b" " else payload[3:]
    if kind == FAULT:
        return Telegram(dialect, kind, "", rest, framed, stamp_ns)
    if dialect is Dialect.B and not rest[:1].isalnum():
        if len(rest) < 2:
            raise TimMalformedError(f"a {kind} telegram that names nothing", Fault.UNKNOWN_NAME)
        name, body = str(int.from_bytes(rest[:2])), rest[2:].removeprefix(b" ")
    else:
        word, _, body = rest.partition(b" ")
        name = word.decode("latin-1")
        if kind in ("sRI", "sMI", "sSI", "sWI"):
            name = _index(name)
    if not _NAME.fullmatch(name):
        raise TimMalformedError(f"a {kind} telegram with the name {name[:40]!r}", Fault.UNKNOWN_NAME)
    return Telegram(dialect, kind, name, body, framed, stamp_ns)


def _index(text: str) -> str:
    try:
        return str(int(text, 16))
    except ValueError:
        raise TimMalformedError(f"{text[:40]!r} is no index", Fault.INVALID_CHARACTER) from None


def _payload(dialect: Dialect, kind: str, name: str, body: bytes) -> bytes:
    if kind == FAULT:
        return kind.encode() + (b" " if dialect is Dialect.A else b"") + body
    if name.isdigit():
        index = int(name)
        word = b"%X" % index if dialect is Dialect.A else index.to_bytes(2)
        # By index in CoLa-B no capture shows a blank behind the index; the reader takes both.
        return kind.encode() + b" " + word + (b" " + body if body and dialect is Dialect.A else body)
    # CoLa-B write answers end in a blank although nothing follows (seen on a TiM5xx).
    blank = b" " if body or (dialect is Dialect.B and kind == "sWA") else b""
    return kind.encode() + b" " + name.encode("latin-1") + blank + body


class Receiver:
    """Bytes of one direction of a connection to telegrams and damage; nothing raises, memory is bounded."""

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self._deframer = Deframer(dialect)

    def feed(self, data: bytes, stamp_ns: int = 0) -> list[Telegram | Damage]:
        """Take the next bytes, arrived at `stamp_ns`; return what they completed."""
        return list(self._parse(self._deframer.feed(data, stamp_ns)))

    def close(self) -> list[Telegram | Damage]:
        """The stream has ended: return the damage not reported yet."""
        return list(self._parse(self._deframer.close()))

    def _parse(self, events: list[Frame | Damage]) -> Iterator[Telegram | Damage]:
        for event in events:
            if isinstance(event, Damage):
                yield event
                continue
            try:
                yield parse(self.dialect, event.data, event.stamp_ns)
            except TimMalformedError:
                yield Damage("malformed", len(event.data))
