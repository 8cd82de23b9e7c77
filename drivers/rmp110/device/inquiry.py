"""Asking a base of the 0x500 family something, and gathering whatever comes back."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.rmp110.codec.assembler import Packet, ReplyCollector
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.device.link import Link

REPLY_TIMEOUT_S = 0.15
"""Reply within 10 ms, longest packet 6.5 ms, then 20 ms of quiet; the rest is for a busy computer."""
LOOK_S = 0.005
"""How often to see whether the bus fell quiet."""


@dataclass(frozen=True, slots=True)
class Reply:
    """What followed a request: whether anything did, and the packet where it came whole."""

    heard: bool
    packet: Packet | None = None

    @property
    def words(self) -> tuple[int, ...]:
        return self.packet.words if self.packet else ()


async def ask(link: Link, request: Frame, patience_s: float = REPLY_TIMEOUT_S) -> Reply:
    """One request and its reply, of whatever length."""
    collector = ReplyCollector()

    def feed(stamp_ns: int, frame: Frame) -> None:
        collector.feed(stamp_ns, frame)
        link.wake()

    link.consumer = feed
    if not link.try_send(request):
        await link.pause(patience_s)
        return Reply(heard=False)
    await link.wait(lambda: collector.started, patience_s)
    await _until_quiet(link, collector)
    return Reply(collector.started, collector.finish())


async def _until_quiet(link: Link, collector: ReplyCollector) -> None:
    deadline_ns = link.clock() + round(REPLY_TIMEOUT_S * 1e9)
    while collector.started and not collector.quiet(link.clock()) and link.clock() < deadline_ns:
        await link.pause(LOOK_S)
