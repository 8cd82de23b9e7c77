"""The driver against the simulated base, over an in-process bus and over TCP."""

from __future__ import annotations

import asyncio
import dataclasses
import subprocess
import sys
import time
from typing import Any

import can
import pytest

from drivers.rmp110 import STANDBY, TRACTOR, CanTransport, Rmp110, Rmp110Config
from drivers.rmp110.codec.commands import motion
from drivers.rmp110.codec.feedback import COMPACT_BITMAPS, FACTORY_BITMAPS, Dialect
from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame, unpack_words
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, OperationalState
from drivers.rmp110.device.state import LinkState
from drivers.rmp110.errors import (
    RmpBadCommand,
    RmpFaulted,
    RmpForeignCommands,
    RmpLimitsDiffer,
    RmpLinkError,
    RmpNotIdentified,
    RmpRefused,
    RmpTimeout,
    RmpWrongMode,
)
from drivers.rmp110.simulator.faults import FaultPlan
from drivers.rmp110.simulator.serve import SimulatedRmp

pytestmark = pytest.mark.usefixtures("short_listening")

BUSES = pytest.mark.parametrize("interface", ["virtual", "socketcand"])
READY_S = 5.0


class Tape:
    """Every frame both ways, as the recorder gets it."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, str, Frame]] = []

    def __call__(self, stamp_ns: int, direction: str, can_id: int, data: bytes) -> None:
        self.frames.append((stamp_ns, direction, Frame(can_id, data)))

    def sent(self, can_id: int) -> list[Frame]:
        return [frame for _, direction, frame in self.frames if direction == "tx" and frame.can_id == can_id]


def state_of(sim: SimulatedRmp) -> OperationalState:
    return sim.model.state


async def drive(base: Rmp110, v: float, w: float, seconds: float) -> None:
    """Motion with 50 Hz, as the control loop sends it."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        base.send_motion(v, w)
        await asyncio.sleep(0.02)


@BUSES
async def test_identified_driven_and_left_in_standby(interface: str, rig: Any, config: Rmp110Config) -> None:
    tape = Tape()
    async with rig(interface) as it, Rmp110(it.transport, config, tape) as base:
        with pytest.raises(RmpNotIdentified):
            base.send_motion(0.1, 0.0)
        identity = await base.ready(READY_S)
        assert identity.dialect is Dialect.B2
        assert (identity.differences, identity.refusal) == ({}, None)
        with pytest.raises(RmpWrongMode, match="tractor"):
            base.send_motion(0.1, 0.0)
        assert tape.sent(MOTION_ID) == [], "nothing that could move it went out before TRACTOR"

        await base.request_mode(TRACTOR)
        assert state_of(it.sim) is OperationalState.TRACTOR
        applied = base.send_motion(5.0, 0.0)
        assert applied.v == pytest.approx(0.5)
        await asyncio.sleep(0.02)
        await drive(base, 0.3, 0.3, 0.6)
        state = base.latest
        assert state is not None
        assert (state.v, state.w) == pytest.approx((0.3, 0.3), abs=0.01)
        assert (state.target_v, state.target_w) == pytest.approx((0.3, 0.3), abs=0.01)
        assert it.sim.model.twist == pytest.approx((0.3, 0.3), abs=0.01)
        assert state.x > 0.1
        assert state.y > 0.005
        assert 0.1 < state.yaw < 0.4
        assert state.battery_percent > 90
    assert base.link is LinkState.CLOSED
    assert state_of(it.sim) is OperationalState.STANDBY
    assert it.sim.model.twist == pytest.approx((0.0, 0.0), abs=0.02)
    stats = base.stats
    assert (stats.lost, stats.damaged, stats.dropped) == (0, 0, 0)
    assert 40 < stats.rate_hz < 70
    received = [frame for _, direction, frame in tape.frames if direction == "rx"]
    assert len(received) >= 11 * stats.received


OTHER_PROCESS = """
import asyncio, sys, time
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.serve import serve

async def main():
    async with serve("socketcand", "can0", model=RmpModel(time.monotonic_ns(), boot_s=0.1)) as base:
        print(base.port, flush=True)
        await asyncio.to_thread(sys.stdin.read)

asyncio.run(main())
"""


async def test_a_base_in_another_process_is_driven_and_its_death_noticed(config: Rmp110Config, until: Any) -> None:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", OTHER_PROCESS, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdout is not None
    try:
        port = int(await asyncio.wait_for(process.stdout.readline(), 20))
        gentle = dataclasses.replace(config, expected=RMP110_STORED)
        async with Rmp110(lambda: CanTransport("socketcand", "can0", host="127.0.0.1", port=port), gentle) as base:
            await base.ready(READY_S)
            await until(lambda: base.latest and base.latest.mode is OperationalState.STANDBY)
            await base.request_mode(TRACTOR)
            await drive(base, 0.5, 0.0, 0.4)
            assert base.latest is not None
            assert base.latest.v > 0.05
            process.kill()
            await until(lambda: base.link is LinkState.BACKOFF)
            assert "failed: the server closed the connection" in base.stats.detail
            await until(lambda: "Connection refused; check that the server" in base.stats.detail)
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def test_odometry_is_what_the_wheels_did(rig: Any, config: Rmp110Config, until: Any) -> None:
    async with rig() as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        start = it.sim.model.drive.right_m, it.sim.model.drive.left_m
        await drive(base, 0.2, -0.4, 0.4)
        await base.request_mode(STANDBY)
        await until(lambda: base.latest and base.latest.v == base.latest.w == 0)
        right, left = it.sim.model.drive.right_m - start[0], it.sim.model.drive.left_m - start[1]
        state = base.latest
        assert state is not None
        assert state.yaw == pytest.approx((right - left) / 0.481224, abs=1e-3)
        assert state.yaw < -0.1


async def test_states_can_be_iterated_until_the_base_is_closed(rig: Any, config: Rmp110Config, until: Any) -> None:
    async with rig() as it:
        async with Rmp110(it.transport, config) as base:
            await base.ready(READY_S)
            seen = []

            async def read() -> None:
                async for state in base.states():
                    seen.append(state)  # noqa: PERF401 - what was seen counts when the iteration ends, too

            reading = asyncio.create_task(read())
            await until(lambda: len(seen) >= 10)
        async with asyncio.timeout(1):
            await reading
    stamps = [state.stamp_ns for state in seen]
    assert stamps == sorted(set(stamps))
    assert seen[0].mode is OperationalState.STANDBY


async def test_in_standby_it_polls_and_sends_nothing_else(rig: Any, config: Rmp110Config, until: Any) -> None:
    async with rig() as it, Rmp110(it.transport, dataclasses.replace(config, poll_hz=25.0)) as base:
        await base.ready(READY_S)
        it.sim.received.clear()
        before, started = base.stats.received, time.monotonic()
        await until(lambda: base.stats.received >= before + 10)
        assert 8 / (time.monotonic() - started) < 27
        assert set(it.sim.received) == {CONFIG_ID}


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
async def test_a_velocity_that_is_no_number_is_dropped_and_counted(
    value: float, rig: Any, config: Rmp110Config
) -> None:
    tape = Tape()
    async with rig() as it, Rmp110(it.transport, config, tape) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        with pytest.raises(RmpBadCommand):
            base.send_motion(value, 0.0)
        with pytest.raises(RmpBadCommand):
            base.send_motion(0.0, value)
        assert tape.sent(MOTION_ID) == []
        assert base.stats.dropped == 2


async def test_a_command_that_nobody_renews_becomes_zero(rig: Any, config: Rmp110Config, until: Any) -> None:
    tape = Tape()
    async with rig() as it, Rmp110(it.transport, config, tape) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.15, 0.0, 0.3)
        last_ns = time.monotonic_ns()
        await until(lambda: tape.sent(MOTION_ID)[-1].data == bytes(8))
        assert 0.25 < (time.monotonic_ns() - last_ns) / 1e9 < 0.5, "before the base's own 0.5 s"
        await until(lambda: it.sim.model.twist == (0.0, 0.0))
        assert it.sim.model.state is OperationalState.TRACTOR
        base.send_motion(0.1, 0.0)


@pytest.mark.parametrize("mode", [ModeRequest.DISABLE, ModeRequest.POWERDOWN, ModeRequest.DTZ, ModeRequest.BALANCE])
async def test_no_other_mode_is_ever_requested(mode: ModeRequest, config: Rmp110Config) -> None:
    with pytest.raises(RmpRefused, match="never requested"):
        await Rmp110(lambda: CanTransport("virtual", "x"), config).request_mode(mode)


async def test_silence_ends_motion_and_comes_back_only_with_a_new_request(
    rig: Any, config: Rmp110Config, until: Any
) -> None:
    async with rig() as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.1, 0.0, 0.2)
        it.sim.silence(for_s=0.45)
        started = time.monotonic()
        await until(lambda: base.refusal() is not None)
        assert time.monotonic() - started < 0.45
        with pytest.raises(RmpNotIdentified):
            base.send_motion(0.2, 0.0)
        await until(lambda: base.link is not LinkState.STREAMING)
        assert "no feedback for 0.3 s" in base.stats.detail
        assert base.stats.lost > 5
        await base.ready(READY_S)
        assert base.stats.detail == ""
        assert base.stats.reconnects >= 1
        with pytest.raises(RmpWrongMode, match="nobody asked"):
            base.send_motion(0.2, 0.0)
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.2)


async def test_a_closed_connection_is_noticed_and_mended(rig: Any, config: Rmp110Config, until: Any) -> None:
    async with rig("socketcand") as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        it.sim.unplug()
        started = time.monotonic()
        await until(lambda: base.link is not LinkState.STREAMING)
        assert time.monotonic() - started < 0.25, "sooner than silence would tell"
        assert "failed" in base.stats.detail
        assert isinstance(base.refusal(), RmpNotIdentified)
        it.sim.plug()
        await base.ready(READY_S)


async def test_the_kill_switch_is_told_in_words_and_the_base_found_again_after_power_on(
    rig: Any, config: Rmp110Config, until: Any
) -> None:
    tape = Tape()
    async with rig() as it, Rmp110(it.transport, config, tape) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.1, 0.0, 0.2)
        it.sim.kill_switch()
        await until(lambda: base.latest and base.latest.faults)
        assert base.latest is not None
        assert base.latest.faults == ("architecture: kill switch active",)
        assert base.latest.dynamic_response == 0x200
        with pytest.raises((RmpFaulted, RmpNotIdentified), match="kill switch"):
            base.send_motion(0.2, 0.0)
        await until(lambda: tape.sent(MOTION_ID)[-1].data == bytes(8))
        await until(lambda: base.link is LinkState.BACKOFF and base.stats.reconnects >= 1)
        assert "power button" in base.stats.detail
        it.sim.power_on()
        await base.ready(READY_S)
        assert isinstance(base.refusal(), RmpWrongMode)


async def test_a_latched_fault_refuses_tractor(rig: Any, config: Rmp110Config) -> None:
    async with rig() as it, Rmp110(it.transport, config) as base:
        it.sim.model.fault_words[3] = 0x20
        await base.ready(READY_S)
        with pytest.raises(RmpFaulted, match="motor controller 1 failed"):
            await base.request_mode(TRACTOR)


async def test_a_base_that_leaves_tractor_by_itself_is_not_commanded_any_more(
    rig: Any, config: Rmp110Config, until: Any
) -> None:
    async with rig() as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        it.sim.model.state = OperationalState.STANDBY
        await until(lambda: base.refusal() is not None)
        with pytest.raises(RmpWrongMode, match="the base left it and is in STANDBY"):
            base.send_motion(0.1, 0.0)
        it.sim.model.state = OperationalState.TRACTOR
        await until(lambda: base.latest and base.latest.mode is OperationalState.TRACTOR)
        assert isinstance(base.refusal(), RmpWrongMode), "only a new request gives motion back"


@BUSES
async def test_somebody_else_commanding_takes_motion_away(
    interface: str, rig: Any, config: Rmp110Config, until: Any
) -> None:
    async with rig(interface) as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        other = it.transport(exclusive=False)
        await other.open(lambda _stamp, _frame: None, lambda _reason: None)
        try:
            other.send(motion(0.5, 0.0))
            await until(lambda: base.refusal() is not None)
            assert isinstance(base.refusal(), RmpNotIdentified)
            assert "another program or panel commands this base" in base.stats.detail

            until_s = time.monotonic() + 0.4
            while time.monotonic() < until_s:
                other.send(motion(0.0, 0.0))
                await asyncio.sleep(0.02)
                assert base.link is not LinkState.STREAMING
        finally:
            await other.close()
        await base.ready(READY_S)
        assert isinstance(base.refusal(), RmpWrongMode)


async def test_while_somebody_else_commands_nothing_is_sent(rig: Any, config: Rmp110Config, until: Any) -> None:
    tape = Tape()
    async with rig() as it:
        other = it.transport(exclusive=False)
        await other.open(lambda _stamp, _frame: None, lambda _reason: None)
        try:
            commanding = asyncio.create_task(_command(other))
            async with Rmp110(it.transport, config, tape) as base:
                await until(lambda: base.stats.reconnects >= 2)
                assert [frame for _, direction, frame in tape.frames if direction == "tx"] == []
                assert "another program" in base.stats.detail
            commanding.cancel()
            await asyncio.wait({commanding})
        finally:
            await other.close()


async def _command(transport: CanTransport) -> None:
    while True:
        transport.send(motion(0.0, 0.0))
        await asyncio.sleep(0.01)


async def test_dialect_b3_is_identified_and_driven(rig: Any, config: Rmp110Config) -> None:
    async with rig(dialect=Dialect.B3) as it, Rmp110(it.transport, config) as base:
        identity = await base.ready(READY_S)
        assert identity.dialect is Dialect.B3
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.2)


async def test_a_bus_without_a_base_says_what_to_check(rig: Any, config: Rmp110Config) -> None:
    async with rig() as it:
        it.sim.power_off()
        async with Rmp110(it.transport, config) as base:
            with pytest.raises(RmpTimeout, match=r"switch it on .* check the CAN cable"):
                await base.ready(1.2)


async def test_a_missing_interface_is_one_sentence_and_tried_again(config: Rmp110Config, until: Any) -> None:
    async with Rmp110(lambda: CanTransport("socketcan", "can987"), config) as base:
        with pytest.raises(RmpTimeout, match="CAN interface can987 not found"):
            await base.ready(0.3)
        await until(lambda: base.stats.reconnects >= 2)
        assert base.refusal() is not None


async def test_the_factory_feedback_set_is_replaced_by_the_compact_one(rig: Any, config: Rmp110Config) -> None:
    async with rig(compact=False) as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        assert it.sim.model.stored.bitmaps == COMPACT_BITMAPS


async def test_without_permission_nothing_is_written_and_the_stored_set_is_read(rig: Any, config: Rmp110Config) -> None:
    tape = Tape()
    async with (
        rig(compact=False) as it,
        Rmp110(it.transport, dataclasses.replace(config, write_feedback_set=False), tape) as base,
    ):
        await base.ready(READY_S)
        assert it.sim.model.stored.bitmaps == FACTORY_BITMAPS
        assert base.latest is not None
        assert {unpack_words(frame.data)[0] for frame in tape.sent(CONFIG_ID)} == {0, 30}


async def test_a_base_that_never_answers_polls_is_still_found_and_given_a_feedback_set(
    rig: Any, config: Rmp110Config
) -> None:
    async with (
        rig(stored={f"feedback_bitmap_{n}": 0 for n in (1, 2, 3)}) as it,
        Rmp110(it.transport, config) as base,
    ):
        await base.ready(READY_S)
        assert it.sim.model.stored.bitmaps == COMPACT_BITMAPS


async def test_stored_limits_scale_motion_and_configured_ones_clamp_it(rig: Any, config: Rmp110Config) -> None:
    tape = Tape()
    async with (
        rig(stored={"max_velocity": 2.2352, "max_yaw_rate": 3.0}) as it,
        Rmp110(it.transport, config, tape) as base,
    ):
        identity = await base.ready(READY_S)
        assert set(identity.differences) == {"max_velocity", "max_yaw_rate"}
        await base.request_mode(TRACTOR)
        base.send_motion(0.5, 0.2)
        await asyncio.sleep(0.02)
        base.send_motion(2.0, -3.0)
        first, second = tape.sent(MOTION_ID)[:2]
        assert first.data == bytes.fromhex("3E650FF2 BD888889"), "0.5 by 2.2352 as float32 has it"
        assert unpack_words(second.data)[0] == unpack_words(first.data)[0], "0.5 m/s is the configured limit"
        assert unpack_words(second.data)[1] == 0x3EAAAAAB, "1.0 of 3.0 rad/s, clockwise"


async def test_a_deceleration_that_nobody_configured_refuses_motion(rig: Any, config: Rmp110Config) -> None:
    async with rig(stored={"max_decel": 0.25}) as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        with pytest.raises(RmpLimitsDiffer, match=r"max_decel = 0.25 m/s\^2, the configuration expects 4"):
            await base.request_mode(TRACTOR)


async def test_with_permission_differing_parameters_are_written_and_verified(rig: Any, config: Rmp110Config) -> None:
    tape = Tape()
    async with (
        rig(stored={"max_decel": 3.923, "max_velocity": 2.2352}) as it,
        Rmp110(it.transport, dataclasses.replace(config, write_parameters=True), tape) as base,
    ):
        identity = await base.ready(READY_S)
        assert identity.differences == {}
        assert it.sim.model.stored.differing(config.expected) == {}
        written = [unpack_words(frame.data)[0] for frame in tape.sent(CONFIG_ID)]
        assert sorted(number for number in written if 1 <= number <= 20) == [1, 3], "only what differs"


async def test_a_base_that_refuses_the_track_width_still_turns_as_commanded(rig: Any, config: Rmp110Config) -> None:
    async with (
        rig(stored={"track_width": 0.569976}) as it,
        Rmp110(it.transport, dataclasses.replace(config, write_parameters=True)) as base,
    ):
        identity = await base.ready(READY_S)
        assert list(identity.differences) == ["track_width"]
        await base.request_mode(TRACTOR)
        await drive(base, 0.0, 0.4, 0.4)
        assert it.sim.model.twist[1] == pytest.approx(0.4, abs=0.01)
        assert base.latest is not None
        assert base.latest.w == pytest.approx(0.4, abs=0.01)
        assert base.latest.target_w == pytest.approx(0.4, abs=0.01)


async def test_a_booting_base_is_read_but_not_asked_to_drive(rig: Any, config: Rmp110Config, until: Any) -> None:
    async with rig(boot_s=0.6) as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        with pytest.raises(RmpWrongMode, match="wait until it is in STANDBY"):
            await base.request_mode(TRACTOR)
        await until(lambda: base.latest and base.latest.mode is OperationalState.STANDBY)
        await base.request_mode(TRACTOR)


async def test_a_base_that_ignores_a_mode_request_is_reported(
    rig: Any, config: Rmp110Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with rig() as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        monkeypatch.setattr(it.sim.model, "_change_mode", lambda _: None)
        with pytest.raises(RmpTimeout, match="did not go to TRACTOR within 1 s"):
            await base.request_mode(TRACTOR)
        assert isinstance(base.refusal(), RmpWrongMode)


async def test_a_base_that_went_away_while_driving_is_brought_to_zero_by_itself(
    rig: Any, config: Rmp110Config, until: Any
) -> None:
    async with rig() as it:
        base = Rmp110(it.transport, config)
        async with base:
            await base.ready(READY_S)
            await base.request_mode(TRACTOR)
            await drive(base, 0.2, 0.0, 0.4)
            it.sim.silence(for_s=10)  # close cannot reach it either
            await until(lambda: base.link is not LinkState.STREAMING)
        await until(lambda: it.sim.model.twist == (0.0, 0.0))


async def test_losses_and_damage_are_counted_and_do_not_end_the_link(
    rig: Any, config: Rmp110Config, until: Any
) -> None:
    async with rig() as it, Rmp110(it.transport, config) as base:
        await base.ready(READY_S)
        it.sim._faults = type(it.sim._faults)(FaultPlan(seed=3, drop=0.02, corrupt=0.02))
        before = base.stats.received
        await until(lambda: base.stats.received >= before + 30)
        stats = base.stats
        assert stats.lost > 0
        assert stats.damaged > 0
        assert stats.reconnects == 0
        assert base.latest is not None
        assert (base.latest.v, base.latest.x) == (0.0, 0.0)


async def test_identification_survives_lost_frames(rig: Any, config: Rmp110Config) -> None:
    plan = FaultPlan(seed=11, drop=0.01)
    async with rig(plan=plan) as it, Rmp110(it.transport, config) as base:
        await base.ready(10.0)


async def test_a_full_bus_drops_commands_and_the_next_one_goes_out(
    rig: Any, config: Rmp110Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    transports: list[CanTransport] = []
    async with rig() as it:

        def transport() -> CanTransport:
            transports.append(it.transport())
            return transports[-1]

        async with Rmp110(transport, config) as base:
            await base.ready(READY_S)
            await base.request_mode(TRACTOR)
            bus = transports[-1]._bus
            assert bus is not None

            def full(*_: object, **__: object) -> None:
                raise can.CanOperationError("No buffer space available", 105)

            with monkeypatch.context() as patch:
                patch.setattr(bus, "send", full)
                with pytest.raises(OSError, match="transmit buffer full"):
                    base.send_motion(0.2, 0.0)
                assert base.stats.dropped == 1
            assert base.send_motion(0.2, 0.0).v == pytest.approx(0.2)


def test_link_errors_are_also_the_built_in_kind() -> None:
    assert issubclass(RmpForeignCommands, ConnectionError)
    assert issubclass(RmpLinkError, OSError)
    assert issubclass(RmpTimeout, TimeoutError)
    assert issubclass(RmpBadCommand, ValueError)


@pytest.mark.parametrize(
    "change",
    [{"poll_hz": 10.0}, {"poll_hz": 100.0}, {"max_v_mps": 0.0}, {"track_m": 5.0}, {"expected": {"speed": 1.0}}],
)
def test_settings_outside_of_what_a_base_can_be_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"poll_hz|max_v_mps|unknown stored"):
        Rmp110Config(**change)
