"""Ten thousand pictures over a bus that loses packets: what is called clean must be what the camera made."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.theta_v.codec.access_units import AccessUnit, AccessUnitTracker
from drivers.theta_v.codec.h264 import opens_stream
from drivers.theta_v.codec.payload import Assembler, Packet
from drivers.theta_v.simulator.faults import FaultPlan, spoil
from drivers.theta_v.simulator.packetiser import packetise
from drivers.theta_v.transport.microframes import NOTHING
from tests.drivers.theta_v.pictures import KEY_INTERVAL, stream

PICTURES = stream(60, 64, 32)
NUMBER = {picture: index for index, picture in enumerate(PICTURES)}
PACKET_BYTES = 100  # seven packets a picture, two dozen a key picture


@cache
def packets_of(index: int, fid: int) -> tuple[bytes, ...]:
    return tuple(packetise(PICTURES[index], fid, packet_bytes=PACKET_BYTES))


def received(plan: FaultPlan, count: int) -> list[AccessUnit]:
    rng = np.random.default_rng(plan.seed)
    assembler, tracker = Assembler(opens=opens_stream), AccessUnitTracker()
    found: list[AccessUnit] = []
    for at in range(count):
        batch = spoil(list(packets_of(at % len(PICTURES), at & 1)), plan, rng)
        for unit in assembler.feed(at, [NOTHING if packet is None else packet for packet in batch]):
            access_unit = tracker.feed(unit)
            if access_unit is not None:
                found.append(access_unit)
    return found


def wrong_claims(units: list[AccessUnit]) -> int:
    """Pictures called clean that are not as they were made, or that build upon one that did not come whole."""
    wrong, sound_until = 0, -1
    for unit in units:
        index = NUMBER.get(unit.raw, -1)
        if index >= 0 and (index % KEY_INTERVAL == 0 or index == sound_until + 1):
            sound_until = index
            continue
        wrong += not unit.tainted
        sound_until = -1
    return wrong


@pytest.mark.parametrize("loss", [0.0001, 0.001, 0.01])
def test_of_losses_the_bus_reports_not_one_picture_is_called_clean_wrongly(loss: float) -> None:
    units = received(FaultPlan(seed=7, lost_packets=loss), 10_000)
    clean = [unit for unit in units if not unit.tainted]
    assert wrong_claims(units) == 0
    assert len(clean) < len(units), "nothing was lost: the test would prove nothing"
    # A lost packet costs half a group of pictures on average, no more: doubt must not eat the stream.
    packets_a_group = sum(len(packets_of(i, 0)) for i in range(KEY_INTERVAL))
    assert len(clean) / 10_000 > (1 - loss) ** (1.5 * packets_a_group)


@given(st.data(), st.sampled_from(["lost_packets", "vanished_packets", "error_packets", "missing_ends"]))
@settings(max_examples=40, deadline=None)
def test_any_loss_that_shows_on_the_wire_leaves_clean_pictures_whole(data: st.DataObject, kind: str) -> None:
    rate = data.draw(st.floats(0.001, 0.4))
    plan = FaultPlan(seed=data.draw(st.integers(0, 2**32)), **{kind: rate})
    assert wrong_claims(received(plan, 60)) == 0


@given(st.lists(st.booleans(), min_size=200, max_size=200), st.sampled_from([2, 6, 8, 12, 20]))
@settings(max_examples=40, deadline=None)
def test_any_pattern_of_reported_losses_at_any_header_length(lost: list[bool], header: int) -> None:
    assembler, tracker = Assembler(opens=opens_stream), AccessUnitTracker()
    packets: list[Packet] = []
    for index in range(25):
        pieces = packetise(PICTURES[index], index & 1, packet_bytes=PACKET_BYTES, header=bytes(header - 2))
        packets += [(0, piece) for piece in pieces]
    fed = [(-18, b"") if gone else packet for gone, packet in zip(lost, packets, strict=False)]
    units = [tracker.feed(unit) for unit in assembler.feed(0, fed)]
    assert wrong_claims([unit for unit in units if unit is not None]) == 0


@pytest.mark.parametrize("loss", [0.0001, 0.001, 0.01])
def test_packets_that_vanish_without_a_word_leave_their_microframe_empty_and_are_missed(loss: float) -> None:
    units = received(FaultPlan(seed=7, vanished_packets=loss), 10_000)
    assert wrong_claims(units) == 0
    assert any(unit.tainted for unit in units)


def test_packets_the_camera_itself_leaves_out_are_seen_in_some_cases() -> None:
    """Nothing on the wire tells of them (fact sheet 3.2, rule 8); the benchmark measures how much still shows."""
    units = received(FaultPlan(seed=7, skipped_packets=0.001), 10_000)
    wrong = wrong_claims(units)
    hurt = sum(unit.raw not in NUMBER for unit in units)
    assert hurt > 20
    assert 0 < wrong < 0.6 * 10_000
