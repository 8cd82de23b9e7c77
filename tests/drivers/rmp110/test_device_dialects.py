"""Which base is it: B1 and B3 on CAN, V3, other machines; in simulated time."""

from __future__ import annotations

import asyncio
import dataclasses

import pytest

from drivers.rmp110 import STANDBY, TRACTOR, Rmp110Config
from drivers.rmp110.codec.dialect import Action, Dialect
from drivers.rmp110.codec.fault_log import FaultLog
from drivers.rmp110.codec.frames import CONFIG_ID, Frame, unpack_words
from drivers.rmp110.codec.parameters import OperationalState
from drivers.rmp110.codec.vocabulary import B3
from drivers.rmp110.errors import RmpNotIdentified, RmpTimeout
from drivers.rmp110.transport.base import Guarded
from tests.drivers.rmp110.virtual_rig import (
    CONFIG,
    READY_S,
    clock,
    drive,
    rig,
    virtual_time,
)


def named(dialect: str, config: Rmp110Config = CONFIG) -> Rmp110Config:
    return dataclasses.replace(config, dialect=dialect)


@pytest.mark.parametrize("dialect", ["auto", "b3"])
@virtual_time
async def test_dialect_b3_is_identified_and_driven(dialect: str) -> None:
    async with rig(dialect=Dialect.B3, compact=False) as it, it.device(named(dialect)) as base:
        identity = await base.ready(READY_S)
        assert identity.dialect is Dialect.B3
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.3, 0.5)
        assert it.model.twist == pytest.approx((0.2, 0.3), abs=0.01)
        state = base.latest
        assert state is not None
        assert (state.v, state.w) == pytest.approx((0.2, 0.3), abs=0.01)
        assert state.temperature_degc is not None, "B3's compact set has room for it"
        assert [battery.name for battery in state.batteries] == ["motor controller 1", "auxiliary"]


@virtual_time
async def test_a_base_that_looks_like_b1_is_not_asked_what_it_may_not_know() -> None:
    async with rig(dialect=Dialect.B1, compact=False) as it, it.device() as base:
        with pytest.raises(RmpTimeout, match="looks like one of dialect B1"):
            await base.ready(2.0)
        assert isinstance(base.refusal(), RmpNotIdentified)
        assert set(it.sent(CONFIG_ID)) == {bytes(8)}, "polls only"
        assert it.model.fault_words == [0, 0, 0, 0]


@virtual_time
async def test_dialect_b1_is_driven_where_it_was_named() -> None:
    async with (
        rig(dialect=Dialect.B1, compact=False) as it,
        it.device(named("b1")) as base,
    ):
        identity = await base.ready(READY_S)
        assert identity.dialect is Dialect.B1
        assert "wheel_base" not in identity.stored
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, -0.3, 0.5)
        assert it.model.twist == pytest.approx((0.2, -0.3), abs=0.01)
        transport = base._link._transport  # type: ignore[union-attr]
        assert isinstance(transport, Guarded)
        assert transport.guard(B3.act(Action.MODE_REQUEST, TRACTOR)), "another dialect's numbers mean something else"
        await base.request_mode(STANDBY)
        asked = {unpack_words(data)[0] for data in it.sent(CONFIG_ID)}
        assert asked <= {0x0, 0x10, 0x11, 0x12, 0x13, 0x15}


@pytest.mark.parametrize(
    ("spoken", "configured", "sentence"),
    [(Dialect.B3, "b2", "it speaks dialect B3, set that"), (Dialect.B2, "b3", "it speaks dialect B2, set that")],
)
@virtual_time
async def test_another_dialect_than_the_configured_one_is_named(
    spoken: Dialect, configured: str, sentence: str
) -> None:
    async with rig(dialect=spoken) as it, it.device(named(configured)) as base:
        with pytest.raises(RmpTimeout, match=sentence):
            await base.ready(2.0)
        assert it.sent(0x500) == []


@virtual_time
async def test_a_b2_base_taken_for_b1_is_refused() -> None:
    async with rig() as it, it.device(named("b1")) as base:
        with pytest.raises(RmpTimeout, match="expected was dialect B1"):
            await base.ready(2.0)
        assert it.sent(0x500) == []


@virtual_time
async def test_a_b2_base_taken_for_b1_keeps_its_feedback_set() -> None:
    async with rig(compact=False) as it, it.device(named("b1")) as base:
        before = it.model.stored.bitmaps
        with pytest.raises(RmpTimeout, match="not one of dialect B1"):
            await base.ready(2.0)
        assert set(it.sent(CONFIG_ID)) == {bytes(8)}, "polls only"
        assert it.model.stored.bitmaps == before


@pytest.mark.parametrize(("ignored", "found"), [(1, True), (3, True), (1000, False)])
@virtual_time
async def test_a_b3_base_that_did_not_hear_that_its_parameters_are_known_is_told_again(
    ignored: int, found: bool
) -> None:
    """Its parameters are as many frames as its compact feedback."""
    async with rig(dialect=Dialect.B3) as it:
        receive, left = it.model.receive, [ignored]

        def hard_of_hearing(now_ns: int, frame: Frame) -> tuple[Frame, ...]:
            if frame == B3.act(Action.FORCE_CONFIG_FEEDBACK, 0) and left[0]:
                left[0] -= 1
                return ()
            return receive(now_ns, frame)

        it.model.receive = hard_of_hearing  # type: ignore[method-assign]
        async with it.device() as base:
            if found:
                await base.ready(READY_S)
                assert base.latest is not None
                assert base.latest.mode is OperationalState.STANDBY
                await base.request_mode(TRACTOR)
            else:
                with pytest.raises(RmpTimeout, match="goes on replying with its parameters"):
                    await base.ready(2.0)


@virtual_time
async def test_a_base_that_already_streams_is_not_asked_anything() -> None:
    async with rig(dialect=Dialect.B3) as it:
        it.model.receive(clock().now_ns, B3.act(Action.CONTINUOUS_DATA, 1))

        async def stream() -> None:
            while True:
                await asyncio.sleep(0.01)
                it.bus.step()
                for _, frames in it.model.take_unsolicited():
                    it.bus._reply(frames)

        streaming = asyncio.create_task(stream())
        async with it.device() as base:
            with pytest.raises(RmpTimeout, match="sends by itself"):
                await base.ready(2.0)
            assert [frame for frame in it.wire if frame.to_base] == []
        streaming.cancel()


@pytest.mark.parametrize("dialect", [Dialect.B2, Dialect.B3])
@virtual_time
async def test_the_fault_log_is_read_where_it_is_wanted(dialect: Dialect) -> None:
    async with rig(dialect=dialect) as it:
        it.model.fault_words[0] = 0x40
        async with it.device(dataclasses.replace(CONFIG, read_fault_log=True)) as base:
            identity = await base.ready(READY_S)
            log = identity.fault_log
            assert isinstance(log, FaultLog)
            assert identity.firmware == f"SP {log.sp_build}, UIP {log.uip_build}"
            assert log.power_cycles >= 1
