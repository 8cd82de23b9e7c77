"""What one connection counts."""

from __future__ import annotations

from drivers.rmp110.codec.commands import motion
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.device.link import REPLY_S, Link
from drivers.rmp110.transport.base import FrameSink, LossSink

LATE_NS = round(REPLY_S * 1e9) + 1


class Wire:
    """Takes everything."""

    damaged = 0

    async def open(self, on_frame: FrameSink, on_lost: LossSink) -> None: ...

    def send(self, frame: Frame) -> None: ...

    async def close(self) -> None: ...


def asked(requests: int) -> Link:
    """A link that has sent so many requests, all at time 0."""
    link = Link(Wire(), None, clock=lambda: 0)
    for _ in range(requests):
        link.send(motion(0.0, 0.0))
    return link


def test_a_request_without_an_answer_is_lost_after_a_while() -> None:
    link = asked(3)
    link.answered()
    link.count_lost(LATE_NS - 1)
    assert link.lost == 0
    link.count_lost(LATE_NS)
    assert link.lost == 2


def test_an_answer_that_was_only_held_up_is_not_lost() -> None:
    link = asked(3)
    link.count_lost(LATE_NS)
    for _ in range(2):
        link.answered()
    assert link.lost == 1
    for _ in range(5):  # more than was ever asked for
        link.answered()
    assert link.lost == 0
