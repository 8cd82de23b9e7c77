"""Which base is it: B1 and B3 on CAN, V3, other machines; in simulated time."""

from __future__ import annotations

import dataclasses

import pytest

from drivers.rmp110 import STANDBY, TRACTOR, Rmp110Config
from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.fault_log import FaultLog
from drivers.rmp110.codec.frames import CONFIG_ID, unpack_words
from drivers.rmp110.errors import RmpNotIdentified, RmpTimeout
from tests.drivers.rmp110.virtual_rig import (
    CONFIG,
    READY_S,
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
    async with rig(dialect=Dialect.B1, guard=Dialect.B1, compact=False) as it, it.device() as base:
        with pytest.raises(RmpTimeout, match="looks like one of dialect B1"):
            await base.ready(2.0)
        assert isinstance(base.refusal(), RmpNotIdentified)
        assert set(it.sent(CONFIG_ID)) == {bytes(8)}, "polls only"
        assert it.model.fault_words == [0, 0, 0, 0]


@virtual_time
async def test_dialect_b1_is_driven_where_it_was_named() -> None:
    async with (
        rig(dialect=Dialect.B1, guard=Dialect.B1, compact=False) as it,
        it.device(named("b1")) as base,
    ):
        identity = await base.ready(READY_S)
        assert identity.dialect is Dialect.B1
        assert "wheel_base" not in identity.stored
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, -0.3, 0.5)
        assert it.model.twist == pytest.approx((0.2, -0.3), abs=0.01)
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
    async with rig(guard=Dialect.B1) as it, it.device(named("b1")) as base:
        with pytest.raises(RmpTimeout, match="expected was dialect B1"):
            await base.ready(2.0)
        assert it.sent(0x500) == []


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
