"""A base with V3 firmware behind the same device: identified, driven, refused, let go; in simulated time."""

from __future__ import annotations

import asyncio
import dataclasses
import struct

import pytest

from drivers.rmp110 import STANDBY, TRACTOR
from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.fault_log import FaultLog
from drivers.rmp110.codec.parameters import OperationalState
from drivers.rmp110.codec.v3.commands import CONFIG_ID, MOTION_ID, ZERO_MOTION, continuous_data
from drivers.rmp110.device.state import LinkState
from drivers.rmp110.device.stream import missing
from drivers.rmp110.errors import RmpFaulted, RmpLimitsDiffer, RmpNotIdentified, RmpTimeout, RmpWrongMode
from tests.drivers.rmp110.v3_rig import CONFIG_V3, v3_rig
from tests.drivers.rmp110.virtual_rig import BRISK, READY_S, clock, drive, until, virtual_time


@pytest.mark.parametrize("order", "<>")
@virtual_time
async def test_a_v3_base_is_identified_driven_and_left_in_standby(order: str) -> None:
    it = v3_rig(order=order)
    base = it.device()
    async with base:
        identity = await base.ready(READY_S)
        assert identity.dialect is Dialect.V3
        assert identity.differences == {}
        with pytest.raises(RmpWrongMode):
            base.send_motion(0.1, 0.0)
        await base.request_mode(TRACTOR)
        applied = base.send_motion(9.0, 0.0)
        assert (applied.v, applied.velocity) == (0.5, 0.5)
        await asyncio.sleep(0.02)
        await drive(base, 0.3, 0.4, 0.6)
        state = base.latest
        assert state is not None
        assert (state.v, state.w) == pytest.approx((0.3, 0.4), abs=0.01)
        assert (state.target_v, state.target_w) == pytest.approx((0.3, 0.4), abs=0.01)
        assert it.model.twist == pytest.approx((0.3, 0.4), abs=0.01)
        assert state.yaw > 0.1
        assert state.warnings == ()
        assert state.temperature_degc is not None
        assert base.stats.rate_hz == pytest.approx(100, abs=3)
    assert it.model.state is OperationalState.STANDBY
    assert it.sent[-1] == continuous_data(on=False)
    motions = [struct.unpack(">3f", frame.data) for frame in it.sent if frame.can_id == MOTION_ID]
    assert (motions[1][0], motions[1][2]) == pytest.approx((0.3, 0.4)), "m/s and counter-clockwise"
    assert (base.stats.lost, base.stats.damaged, base.stats.dropped) == (0, 0, 0)


@pytest.mark.parametrize(
    ("machine_id", "sentence"),
    [(2, "it is an RMP 220; this driver drives an RMP 110 only"), (9, "word 12 reads 0x00000009 in one byte order")],
)
@virtual_time
async def test_another_machine_with_v3_firmware_is_refused_in_words(machine_id: int, sentence: str) -> None:
    it = v3_rig(machine_id=machine_id)
    async with it.device() as base:
        with pytest.raises(RmpTimeout, match=sentence):
            await base.ready(2.0)
        assert isinstance(base.refusal(), RmpNotIdentified)
        assert not [frame for frame in it.sent if frame.can_id == MOTION_ID]


@virtual_time
async def test_a_v3_base_that_says_nothing_is_told_so() -> None:
    it = v3_rig()
    it.silent = True
    async with it.device() as base:
        with pytest.raises(RmpTimeout, match="does not answer in V3"):
            await base.ready(3.0)


@virtual_time
async def test_v3_parameters_are_written_at_once_without_the_charging_bit_and_read_back() -> None:
    it = v3_rig({"max_decel": 3.923, "input_bitmap": 0x2})
    async with it.device() as base:
        identity = await base.ready(READY_S)
        assert "charger" in identity.warnings[0]
        with pytest.raises(RmpLimitsDiffer, match="max_decel"):
            await base.request_mode(TRACTOR)
    async with it.device(dataclasses.replace(CONFIG_V3, write_parameters=True)) as base:
        identity = await base.ready(READY_S)
        assert (identity.differences, identity.warnings) == ({}, ())
        assert len([frame for frame in it.sent if frame.can_id == CONFIG_ID]) == 1
        assert it.model.stored["input_bitmap"] == 0
        assert it.model.stored.differing(BRISK) == {}


@virtual_time
async def test_v3_parameters_wait_for_standby() -> None:
    it = v3_rig({"max_decel": 3.923})
    it.model.state = OperationalState.TRACTOR
    async with it.device(dataclasses.replace(CONFIG_V3, write_parameters=True)) as base:
        assert (await base.ready(READY_S)).refusal is not None
        assert not [frame for frame in it.sent if frame.can_id == CONFIG_ID]
        await base.request_mode(STANDBY)
        await until(lambda: base.identity is None)
        assert (await base.ready(READY_S)).refusal is None


@pytest.mark.parametrize("bitmap", [0x100, 0x4000])
@virtual_time
async def test_a_v3_base_that_filters_commands_is_not_driven_until_that_is_written(bitmap: int) -> None:
    it = v3_rig({"input_bitmap": bitmap})
    async with it.device() as base:
        await base.ready(READY_S)
        with pytest.raises(RmpLimitsDiffer, match="filter commands"):
            await base.request_mode(TRACTOR)
    async with it.device(dataclasses.replace(CONFIG_V3, write_parameters=True)) as base:
        await base.ready(READY_S)
        assert it.model.stored["input_bitmap"] == 0
        await base.request_mode(TRACTOR)


@virtual_time
async def test_a_stream_that_stops_is_asked_for_again_and_silence_ends_the_link() -> None:
    it = v3_rig()
    async with it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.2)
        it.model._streaming = False
        await until(lambda: base.stats.received > 0 and it.sent[-1] == continuous_data(on=True), 0.3)
        assert base.link is LinkState.STREAMING
        it.silent = True
        await until(lambda: base.link is not LinkState.STREAMING, 0.5)
        assert "does not answer in V3" in base.stats.detail
        assert ZERO_MOTION in it.sent[-4:]
        it.silent = False
        await base.ready(READY_S)
        assert isinstance(base.refusal(), RmpWrongMode)


@pytest.mark.parametrize("poll_hz", [20.0, 50.0])
@virtual_time
async def test_silence_of_a_v3_base_is_noticed_whatever_the_polling_rate(poll_hz: float) -> None:
    it = v3_rig()
    async with it.device(dataclasses.replace(CONFIG_V3, poll_hz=poll_hz)) as base:
        await base.ready(READY_S)
        it.silent = True
        await until(lambda: base.link is not LinkState.STREAMING, 0.5)


@virtual_time
async def test_a_v3_base_that_announces_its_power_down_is_let_go() -> None:
    it = v3_rig()
    async with it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.2)
        it.model.press_power_button()
        await until(lambda: base.link is not LinkState.STREAMING)
        assert "says that it switches off" in base.stats.detail
        assert ZERO_MOTION in it.sent[-3:]
        with pytest.raises(RmpNotIdentified, match="switches off"):
            base.send_motion(0.1, 0.0)
        await asyncio.sleep(29.0)
        still_on = it.model.powered
        assert still_on, "it would obey"
        assert "switches off" in str(base.refusal())
        assert base.stats.reconnects == 0
        await asyncio.sleep(2.0)
        assert not it.model.powered
        it.model.power_on(clock().now_ns)
        await base.ready(10.0)


@virtual_time
async def test_v3_faults_are_told_with_their_own_words() -> None:
    it = v3_rig()
    it.model.fault_words[0] = 0x800
    async with it.device(dataclasses.replace(CONFIG_V3, read_fault_log=True)) as base:
        identity = await base.ready(READY_S)
        assert isinstance(identity.fault_log, FaultLog)
        with pytest.raises(RmpFaulted, match="invalid keys"):
            await base.request_mode(TRACTOR)


@pytest.mark.parametrize(
    ("before_s", "now_s", "lost"),
    [(1.0, 1.01, 0), (1.0, 1.02, 1), (1.0, 1.10, 9), (1.0, 0.5, 0), (70000.0, 70000.016, 0), (0.0, 1e30, 100)],
)
def test_a_streams_missing_packets_are_counted_by_the_bases_time(before_s: float, now_s: float, lost: int) -> None:
    assert missing(before_s, now_s) == lost
