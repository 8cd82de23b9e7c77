"""Faults by plan: the same seed is the same run, and the wire keeps its own time."""

from __future__ import annotations

import asyncio
import itertools
import time
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.codec.commands import POLL, motion, request_mode
from drivers.rmp110.codec.dialect import Action, Dialect
from drivers.rmp110.codec.feedback import COMPACT_BITMAPS
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, OperationalState, Stored
from drivers.rmp110.codec.vocabulary import B3
from drivers.rmp110.simulator import faulty
from drivers.rmp110.simulator.faults import FaultInjector, FaultPlan, parse_plan
from drivers.rmp110.simulator.faulty import FaultyBase
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.wire_time import frame_bits, schedule_ns

MS = 1_000_000
S = 1_000_000_000
COMPACT = Stored.of({**RMP110_STORED, **{f"feedback_bitmap_{n}": w for n, w in enumerate(COMPACT_BITMAPS, start=1)}})


class Run:
    """A base under a plan, polled with 50 Hz in simulated time; what reaches the bus, with its stamps."""

    def __init__(self, plan: FaultPlan, stored: Stored | None = COMPACT) -> None:
        self.model = RmpModel(0, stored, boot_s=0.0)
        self.base: FaultyBase[Frame] = FaultyBase(self.model, plan, 0, foreign=(motion(0.1, 0.0),))
        self.wire: list[tuple[int, Frame]] = []
        self.now_ns = 0

    def go(self, seconds: float, frame: Frame = POLL) -> Run:
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            self.base.step(self.now_ns)
            if self.now_ns % (20 * MS) == 0:
                self.base.receive(self.now_ns, frame)
            for burst in self.base.due(self.now_ns):
                self.wire += zip(burst.stamps_ns(), burst.messages, strict=True)
            self.now_ns += 5 * MS
        return self

    def state(self) -> OperationalState:
        return self.model.state

    def times(self) -> list[float]:
        """When something of the base was on the bus, seconds."""
        return [stamp / 1e9 for stamp, frame in self.wire if frame.can_id >= 0x502]


EVERYTHING = FaultPlan(seed=7, drop=0.05, corrupt=0.05, duplicate=0.05, reorder=0.05, delay=0.1, silences=((0.5, 0.2),))


def test_the_same_seed_is_the_same_run_and_another_is_not() -> None:
    runs = [Run(plan).go(2.0).wire for plan in (EVERYTHING, EVERYTHING, FaultPlan(seed=8, drop=0.05))]
    assert runs[0] == runs[1] != runs[2]


def test_without_faults_every_poll_has_its_packet() -> None:
    run = Run(FaultPlan()).go(1.0)
    assert [frame.can_id for _, frame in run.wire] == list(range(0x502, 0x50D)) * 50


@pytest.mark.parametrize(
    ("plan", "changed"),
    [
        (FaultPlan(drop=0.1), lambda ids: len(ids) < 550),
        (FaultPlan(duplicate=0.1), lambda ids: any(a == b for a, b in itertools.pairwise(ids))),
        (FaultPlan(reorder=0.1), lambda ids: any(a == b + 1 for a, b in itertools.pairwise(ids))),
        (FaultPlan(corrupt=0.1), lambda ids: max(ids) >= 0x532),
        (FaultPlan(delay=0.2, delay_s=0.03), lambda ids: len(ids) == 550),
    ],
)
def test_each_fault_does_what_its_name_says(plan: FaultPlan, changed: Any) -> None:
    run = Run(plan).go(1.1)
    ids = [frame.can_id for stamp, frame in run.wire if stamp < 1.04 * S]
    assert changed(ids[:550])
    assert ids != list(range(0x502, 0x50D)) * 50 or plan.delay


def test_delays_come_out_late() -> None:
    run = Run(FaultPlan(delay=1.0, delay_s=0.03)).go(0.2)
    assert min(run.times()) == pytest.approx(0.03, abs=0.001)


def test_spans_of_silence_and_unplugging_are_kept() -> None:
    run = Run(FaultPlan(silences=((0.5, 0.3),), unplugs=((1.2, 0.4),))).go(2.0)
    quiet = [(a, b) for a, b in itertools.pairwise(run.times()) if b - a > 0.1]
    assert quiet == [pytest.approx((0.48, 0.8), abs=0.01), pytest.approx((1.18, 1.6), abs=0.01)]


def test_power_cycles_kill_switch_and_restarts_happen_once() -> None:
    run = Run(FaultPlan(power_cycles=((0.5, 0.3),), restarts=(1.0,), kill_at_s=1.5))
    run.go(0.9)
    assert run.model.power_cycles == 2
    run.go(0.05, request_mode(ModeRequest.TRACTOR)).go(0.04)
    assert run.state() is OperationalState.TRACTOR
    run.go(0.1)
    assert run.state() is OperationalState.STANDBY, "restarted without a power cycle"
    assert run.model.run_time_s < 0.2
    assert run.model.power_cycles == 2
    run.go(1.0)
    assert not run.model.powered
    assert max(run.times()) == pytest.approx(1.5, abs=0.03), "one more packet and silence"


def test_stuck_modes_are_asked_in_vain() -> None:
    run = Run(FaultPlan(stuck_modes=((0.0, 0.5),)))
    run.go(0.4, request_mode(ModeRequest.TRACTOR)).go(0.2)
    assert run.state() is OperationalState.STANDBY
    run.go(0.1, request_mode(ModeRequest.TRACTOR))
    assert run.state() is OperationalState.TRACTOR


def test_somebody_else_is_heard_and_obeyed() -> None:
    run = Run(FaultPlan(foreign=((2.0, 1.0),)))
    run.go(0.1, request_mode(ModeRequest.TRACTOR)).go(1.9)
    assert all(frame.can_id >= 0x502 for _, frame in run.wire)
    run.go(1.0)
    assert sum(frame == motion(0.1, 0.0) for _, frame in run.wire) == 10
    assert run.model.twist[0] == pytest.approx(0.05)


@given(st.binary(max_size=8), st.integers(0, 0x7FF))
def test_a_frame_of_eight_bytes_takes_111_to_135_bits(data: bytes, can_id: int) -> None:
    bits = frame_bits(Frame(can_id, data))
    assert 47 + 8 * len(data) <= bits <= 47 + 8 * len(data) + (34 + 8 * len(data) - 1) // 4
    if len(data) == 8:
        assert 111 <= bits <= 135


def test_stuffing_is_counted_as_on_a_real_bus() -> None:
    # Bits from start of frame to the checksum, stuffed by hand: 0 00000000000 000 1000 and 64 zeros.
    assert frame_bits(Frame(0, bytes(8))) > frame_bits(Frame(0x555, b"\x55" * 8))
    assert frame_bits(Frame(0x555, b"\x55" * 8)) <= 113


def test_replies_follow_each_other_110_to_135_microseconds_apart() -> None:
    run = Run(FaultPlan(), stored=None).go(0.1)
    gaps = {b - a for (a, f), (b, g) in itertools.pairwise(run.wire) if g.can_id == f.can_id + 1}
    assert all(110_000 <= gap <= 135_000 for gap in gaps)
    assert 5.3 * MS <= schedule_ns([frame for _, frame in run.wire[:48]])[-1] <= 6.5 * MS


def test_requests_that_come_faster_than_the_bus_are_answered_one_after_the_other() -> None:
    model = RmpModel(0, boot_s=0.0)
    base: FaultyBase[Frame] = FaultyBase(model, FaultPlan(), 0)
    for k in range(3):
        base.receive(k * MS, POLL)
    bursts = base.due(S)
    assert [len(burst.messages) for burst in bursts] == [48] * 3
    ends = [burst.stamps_ns()[-1] for burst in bursts]
    assert all(end <= burst.begin_ns for end, burst in zip(ends, bursts[1:], strict=False))


def test_a_flood_of_requests_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(faulty, "OUTBOX", 100)
    base: FaultyBase[Frame] = FaultyBase(RmpModel(0, boot_s=0.0), FaultPlan(), 0)
    for k in range(200):
        base.receive(k, POLL)
    assert len(base._outbox) == 100


@given(st.lists(st.binary(min_size=1, max_size=20), max_size=8), st.integers(0, 1000))
def test_packets_are_mangled_into_bytes_and_never_raise(packets: list[bytes], seed: int) -> None:
    injector = FaultInjector(FaultPlan(seed=seed, drop=0.2, corrupt=0.5, duplicate=0.2, reorder=0.3))
    assert all(isinstance(packet, bytes) for packet in injector.mangle(packets))
    assert FaultInjector(FaultPlan(seed=seed)).mangle(packets) == packets


def test_a_plan_is_read_from_the_command_line() -> None:
    plan = parse_plan("drop=0.01, seed=3,silence=5+2,silence=9+1,kill=30,restart=4,foreign=1+1,power=2+0.5,stuck=3+1")
    assert plan == FaultPlan(
        seed=3,
        drop=0.01,
        silences=((5.0, 2.0), (9.0, 1.0)),
        kill_at_s=30.0,
        restarts=(4.0,),
        foreign=((1.0, 1.0),),
        power_cycles=((2.0, 0.5),),
        stuck_modes=((3.0, 1.0),),
    )
    assert parse_plan("") == FaultPlan()


@pytest.mark.parametrize("text", ["drop", "drop=x", "drop=1.5", "loss=0.1", "silence=5", "seed=0.5", "kill=soon"])
def test_a_plan_that_is_none_is_one_sentence(text: str) -> None:
    with pytest.raises(ValueError, match=r"for example drop=|between 0 and 1") as raised:
        parse_plan(text)
    assert "\n" not in str(raised.value)


async def test_a_served_base_fails_by_its_plan(rig: Any, until: Any) -> None:
    plan = FaultPlan(foreign=((0.0, 9.0),), unplugs=((0.4, 9.0),))
    async with rig("socketcand", plan=plan) as it:
        transport = it.transport()
        heard: list[int] = []
        reasons: list[str] = []
        await transport.open(lambda _, frame: heard.append(frame.can_id), reasons.append)
        transport.send(POLL)
        await until(lambda: 0x500 in heard and 0x50C in heard)
        await until(lambda: reasons)
        await transport.close()
        await asyncio.sleep(0)


async def test_continuous_data_of_b3_streams_over_a_served_bus(rig: Any, until: Any) -> None:
    async with rig(dialect=Dialect.B3, compact=False) as it:
        transport = it.transport()
        stamps: list[int] = []

        def hear(stamp_ns: int, frame: Frame) -> None:
            if frame.can_id == 0x502:
                stamps.append(stamp_ns)

        await transport.open(hear, lambda _: None)
        # Nothing of ours may ask for this: the whitelist stops it.
        it.sim.model.receive(time.monotonic_ns(), B3.act(Action.CONTINUOUS_DATA, 1))
        await until(lambda: len(stamps) > 30)
        assert 0.15 * S < stamps[30] - stamps[0] < 2 * S, "a busy computer may be late"
        await transport.close()
