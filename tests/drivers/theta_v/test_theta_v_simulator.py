"""The camera model by itself, on a clock of the test's own."""

from __future__ import annotations

import struct
from dataclasses import replace

import pytest

from drivers.theta_v.codec.payload import EOF, ERR
from drivers.theta_v.codec.probe import Probe
from drivers.theta_v.errors import ThetaGone, ThetaNotFound, ThetaStall
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.descriptors import Composition
from drivers.theta_v.simulator.faults import FaultPlan, Unplug
from drivers.theta_v.simulator.port import Port
from tests.drivers.theta_v.pictures import stream

PICTURES = stream(30, 192, 96)
MICROFRAME_NS = 125_000


class Clock:
    def __init__(self) -> None:
        self.now_ns = 1_000_000_000

    def __call__(self) -> int:
        return self.now_ns


def control(port: Port, request_type: int, request: int, value: int, index: int, data: bytes = b"") -> bytes:
    return port.control(struct.pack("<BBHHH", request_type, request, value, index, len(data)), data)


def start(camera: SimulatedThetaV) -> Port:
    port = camera.connect()
    block = Probe(format_index=1, frame_index=2, interval_100ns=333_667).encode(34)
    control(port, 0x00, 9, 1, 0)
    control(port, 0x21, 1, 0x0100, 2, block)
    control(port, 0x21, 1, 0x0200, 2, block)
    control(port, 0x01, 0x0B, 1, 2)
    return port


def test_a_picture_begins_in_the_microframe_in_which_it_was_offered() -> None:
    clock = Clock()
    camera = SimulatedThetaV(clock=clock)
    port = start(camera)
    begin = clock.now_ns
    clock.now_ns += 10 * MICROFRAME_NS - 1
    assert camera.offer(PICTURES[0])
    burst = port.isochronous(0x84, 32, begin)
    count = -(-len(PICTURES[0]) // 3070)
    assert [slot for slot, _, _ in burst.packets] == list(range(10, 10 + count))
    assert b"".join(data[2:] for _, _, data in burst.packets) == PICTURES[0]
    assert port.idle


def test_a_host_that_does_not_fetch_makes_the_camera_drop_and_ask_for_a_key_picture() -> None:
    camera = SimulatedThetaV(clock=Clock())
    start(camera)
    assert camera.wants_keyframe
    assert [camera.offer(p) for p in PICTURES[:6]] == [True] * 4 + [False] * 2
    assert camera.overruns == 2
    assert camera.wants_keyframe


def carried(plan: FaultPlan) -> list[tuple[int, int, bytes]]:
    clock = Clock()
    camera = SimulatedThetaV(clock=clock, plan=plan)
    port = start(camera)
    found = []
    for picture in PICTURES:
        begin = clock.now_ns
        camera.offer(picture)
        clock.now_ns += 64 * MICROFRAME_NS
        found += port.isochronous(0x84, 64, begin).packets
    return found


@pytest.mark.parametrize(
    "plan",
    [
        FaultPlan(1, lost_packets=0.3),
        FaultPlan(1, vanished_packets=0.3),
        FaultPlan(1, corrupt_packets=0.3),
        FaultPlan(1, error_packets=0.3),
        FaultPlan(1, missing_ends=0.3),
        FaultPlan(1, lost_pictures=0.3),
    ],
)
def test_each_fault_shows_and_the_same_seed_shows_the_same(plan: FaultPlan) -> None:
    whole, faulty = carried(FaultPlan()), carried(plan)
    assert faulty == carried(plan)
    assert faulty != carried(replace(plan, seed=2))
    assert any(status for _, status, _ in faulty) == bool(plan.lost_packets)
    assert any(data[1] & ERR for _, _, data in faulty if data) == bool(plan.error_packets)
    assert (len(faulty) < len(whole)) == bool(plan.vanished_packets or plan.lost_pictures)
    if plan.missing_ends:
        assert 0 < sum(bool(data[1] & EOF) for _, _, data in faulty) < len(PICTURES)
    if plan.corrupt_packets:
        assert [len(data) for _, _, data in faulty] == [len(data) for _, _, data in whole]
        assert faulty != whole


def test_the_cable_is_pulled_and_put_back_when_the_plan_says() -> None:
    clock = Clock()
    camera = SimulatedThetaV(clock=clock, plan=FaultPlan(events=(Unplug(1.0, 2.0),)))
    port = start(camera)
    clock.now_ns += 1_100_000_000
    with pytest.raises(ThetaGone):
        port.isochronous(0x84, 1, clock.now_ns)
    with pytest.raises(ThetaNotFound):
        camera.connect()
    clock.now_ns += 2_000_000_000
    assert not port.connected, "the old handle stays dead"
    assert camera.connect().connected


def test_a_camera_nobody_talks_to_falls_asleep_and_sends_no_pictures() -> None:
    clock = Clock()
    camera = SimulatedThetaV(clock=clock)
    start(camera)
    clock.now_ns += 179 * 10**9
    assert camera.offer(PICTURES[0])
    clock.now_ns += 2 * 10**9
    assert not camera.offer(PICTURES[0])
    assert camera.demand is None
    assert camera.ptp.asleep


def test_mtp_mode_has_no_video_and_its_own_product_id() -> None:
    camera = SimulatedThetaV(composition=Composition.MTP, clock=Clock())
    port = camera.connect()
    assert camera.device_descriptor[10:12] == b"\x68\x03"
    control(port, 0x00, 9, 1, 0)
    with pytest.raises(ThetaStall):
        control(port, 0x01, 0x0B, 0, 2)
    with pytest.raises(ThetaStall):
        port.isochronous(0x84, 1, 0)
