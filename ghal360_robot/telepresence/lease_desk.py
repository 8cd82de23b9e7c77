"""Who drives: one connection at a time, handed over in sight of both, void when its holder falls silent. Pure.

Letting somebody else drive always ends in standstill: the safety chain disarms when the holder changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

ASK_NS = 5_000_000_000
"""Who has asked for so long without an answer may take it."""

ASK_LASTS_NS = 30_000_000_000
LEASE_NS = 3_000_000_000
"""A holder who says nothing for so long has gone; two or three lost renewals of one a second are no reason."""


@dataclass(frozen=True, slots=True)
class Desk:
    """Connections by their id; empty where there is none."""

    holder: str = ""
    renewed_ns: int = 0
    asking: str = ""
    asked_ns: int = 0

    def expired(self, now_ns: int) -> bool:
        return bool(self.holder) and now_ns - self.renewed_ns > LEASE_NS

    def may_take(self, conn: str, now_ns: int) -> bool:
        """Whether `take` would be granted to this connection."""
        return self.asking == conn and now_ns - self.asked_ns >= ASK_NS


def settle(desk: Desk, now_ns: int) -> Desk:
    """What time alone changes."""
    if desk.expired(now_ns):
        desk = replace(desk, holder="")
    if desk.asking and now_ns - desk.asked_ns > ASK_LASTS_NS:
        desk = replace(desk, asking="")
    if desk.asking and not desk.holder:
        return Desk(desk.asking, now_ns)
    return desk


def wish(desk: Desk, conn: str, what: str, now_ns: int) -> tuple[Desk, str]:
    """The desk after a wish, and why it was refused; empty where it was not."""
    desk = settle(desk, now_ns)
    match what:
        case "ask":
            return _ask(desk, conn, now_ns)
        case "take":
            if desk.holder == conn:
                return desk, ""
            if desk.holder and not desk.may_take(conn, now_ns):
                return desk, "ask first, and give the driver five seconds to answer"
            return Desk(conn, now_ns), ""
        case "release":
            if desk.holder == conn:
                return settle(replace(desk, holder=""), now_ns), ""
            return (replace(desk, asking="") if desk.asking == conn else desk), ""
        case "hand_over" if desk.holder == conn:
            return (Desk(desk.asking, now_ns), "") if desk.asking else (desk, "nobody asks for it")
        case "keep" if desk.holder == conn:
            return replace(desk, asking=""), ""
    return desk, "only the driver can answer that"


def renew(desk: Desk, conn: str, now_ns: int) -> Desk:
    """A sign of life of the holder; of anybody else it changes nothing."""
    return replace(desk, renewed_ns=now_ns) if desk.holder == conn else desk


def gone(desk: Desk, conn: str, now_ns: int) -> Desk:
    """A connection has closed."""
    if desk.asking == conn:
        desk = replace(desk, asking="")
    return settle(replace(desk, holder=""), now_ns) if desk.holder == conn else desk


def _ask(desk: Desk, conn: str, now_ns: int) -> tuple[Desk, str]:
    if desk.holder == conn:
        return desk, ""
    if not desk.holder:
        return Desk(conn, now_ns), ""
    if desk.asking and desk.asking != conn:
        return desk, "somebody else is asking already"
    return (desk if desk.asking else replace(desk, asking=conn, asked_ns=now_ns)), ""
