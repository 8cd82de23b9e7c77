"""A driver's own counters as the robot's message: the same words for all devices."""

from __future__ import annotations

from typing import Protocol

from ghal360_robot.messages import LinkStats


class Counters(Protocol):
    """What every driver counts."""

    @property
    def detail(self) -> str: ...
    @property
    def received(self) -> int: ...
    @property
    def lost(self) -> int: ...
    @property
    def damaged(self) -> int: ...
    @property
    def reconnects(self) -> int: ...
    @property
    def rate_hz(self) -> float: ...
    @property
    def last_ns(self) -> int | None: ...


def link_stats(link: str, counters: Counters) -> LinkStats:
    """`link` is the state of the link in one of the words of `LinkStats.link`; a healthy link needs no detail."""
    return LinkStats(
        link=link,
        detail="" if link == "streaming" else counters.detail,
        received=counters.received,
        lost=counters.lost,
        damaged=counters.damaged,
        reconnects=counters.reconnects,
        rate_hz=counters.rate_hz,
        last_ns=counters.last_ns,
    )
