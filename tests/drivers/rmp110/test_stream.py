"""Any bytes at all become states of finite numbers, or counts."""

from __future__ import annotations

import math
import struct

from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110 import Rmp110Config
from drivers.rmp110.codec.feedback import COMPACT, COMPACT_BITMAPS, Dialect
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import RMP110_STORED, Stored
from drivers.rmp110.device.identify import conclude
from drivers.rmp110.device.journal import Journal
from drivers.rmp110.device.link import Link
from drivers.rmp110.device.pilot import Pilot
from drivers.rmp110.device.stream import Stream
from drivers.rmp110.transport.base import FrameSink, LossSink

INFINITE, NAN, HUGE = 0x7F800000, 0x7FC00000, 0x7F7FFFFF
words = st.integers(0, 0xFFFFFFFF) | st.sampled_from([0, INFINITE, NAN, HUGE, HUGE | 1 << 31, INFINITE | 1 << 31])


class Wire:
    """A transport that the test feeds."""

    damaged = 0

    async def open(self, on_frame: FrameSink, on_lost: LossSink) -> None:
        raise NotImplementedError

    def send(self, frame: Frame) -> None:
        raise NotImplementedError

    async def close(self) -> None:
        raise NotImplementedError


def stream() -> tuple[Stream, Journal]:
    stored = Stored.of({**RMP110_STORED, **{f"feedback_bitmap_{n}": w for n, w in enumerate(COMPACT_BITMAPS, 1)}})
    config, journal = Rmp110Config(), Journal()
    identity = conclude(Dialect.B2, stored, config)
    link = Link(Wire(), None)
    return Stream(link, identity, config, Pilot(link, identity), journal), journal


@given(st.lists(st.lists(words, min_size=22, max_size=22), max_size=6))
def test_any_complete_packet_is_a_finite_state_or_damaged(packets: list[list[int]]) -> None:
    reader, journal = stream()
    for number, packet in enumerate(packets):
        for k in range(COMPACT.frame_count):
            data = struct.pack(">II", *packet[2 * k : 2 * k + 2])
            reader._feed(number * 20_000_000 + k * 130_000, Frame(0x502 + k, data))
        if journal.latest:
            state = journal.latest
            assert all(map(math.isfinite, (state.x, state.y, state.yaw, state.v, state.w, state.battery_percent)))
    assert journal.received + journal.damaged == len(packets)
