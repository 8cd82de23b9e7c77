"""Any bytes at all become states of finite numbers, or counts."""

from __future__ import annotations

import math
import struct
from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110 import Rmp110Config
from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.feedback import COMPACT, COMPACT_BITMAPS
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import RMP110_STORED, Stored
from drivers.rmp110.codec.v3.packets import FAULT_LOG, pack_status, parse_packet
from drivers.rmp110.codec.v3.whitelist import INPUT_BITS
from drivers.rmp110.codec.v3.words import LAYOUT, PARAMETERS
from drivers.rmp110.device.identify import conclude
from drivers.rmp110.device.journal import Journal
from drivers.rmp110.device.judgement import judge
from drivers.rmp110.device.language import V3Language
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


def v3_stream(order: str) -> tuple[Stream, Journal]:
    stored = Stored.of({}, parameters=PARAMETERS)
    config, journal = Rmp110Config(protocol="v3"), Journal()
    identity = judge(Dialect.V3, stored, LAYOUT, config, partial(V3Language, order), input_bits=INPUT_BITS)
    link = Link(Wire(), None)
    return Stream(link, identity, config, Pilot(link, identity), journal), journal


def finite(journal: Journal) -> bool:
    state = journal.latest
    if state is None:
        return True
    numbers = (state.x, state.y, state.yaw, state.v, state.w, state.battery_percent, state.temperature_degc or 0.0)
    return all(map(math.isfinite, (*numbers, *state.covariance)))


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
        assert finite(journal)
    assert journal.received + journal.damaged == len(packets)


@given(st.lists(st.lists(words, min_size=132, max_size=132), max_size=4), st.sampled_from("<>"))
def test_any_v3_status_is_a_finite_state_or_damaged(packets: list[list[int]], order: str) -> None:
    reader, journal = v3_stream(order)
    for number, packet in enumerate(packets):
        frame = parse_packet(pack_status(packet, order))
        assert frame is not None
        reader._feed(number * 10_000_000, frame)
        assert finite(journal)
    assert journal.received + journal.damaged == len(packets)


def test_a_fault_log_in_the_stream_is_damage() -> None:
    reader, journal = v3_stream("<")
    reader._feed(0, Frame(FAULT_LOG, bytes(1244)))
    assert (journal.received, reader.damaged) == (0, 1)
