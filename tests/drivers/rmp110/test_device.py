"""The driver against the simulated base in simulated time: driving, refusing, stopping, coming back."""

from __future__ import annotations

import asyncio
import dataclasses
import itertools
from typing import Any

import pytest

from drivers.rmp110 import STANDBY, TRACTOR, CanTransport, Rmp110, Rmp110Config
from drivers.rmp110.codec.commands import motion
from drivers.rmp110.codec.feedback import COMPACT_BITMAPS, FACTORY_BITMAPS
from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame, unpack_words
from drivers.rmp110.codec.parameters import ModeRequest, OperationalState
from drivers.rmp110.device.state import LinkState
from drivers.rmp110.errors import (
    RmpBadCommand,
    RmpFaulted,
    RmpForeignCommands,
    RmpLimitsDiffer,
    RmpLinkError,
    RmpNotIdentified,
    RmpRefused,
    RmpSendDropped,
    RmpTimeout,
    RmpTooFast,
    RmpWrongMode,
)
from drivers.rmp110.simulator.faults import FaultPlan
from tests.drivers.rmp110.virtual_rig import CONFIG, READY_S, Rig, clock, drive, rig, until, virtual_time

ZERO = bytes(8)


def numbers(it: Rig) -> list[int]:
    """Configuration commands that the base saw."""
    return [unpack_words(data)[0] for data in it.sent(CONFIG_ID)]


@virtual_time
async def test_identified_driven_and_left_in_standby() -> None:
    async with rig() as it:
        base = it.device()
        async with base:
            with pytest.raises(RmpNotIdentified):
                base.send_motion(0.1, 0.0)
            identity = await base.ready(READY_S)
            assert (identity.differences, identity.refusal, identity.warnings) == ({}, None, ())
            with pytest.raises(RmpWrongMode, match="tractor"):
                base.send_motion(0.1, 0.0)
            assert it.sent(MOTION_ID) == [], "nothing that could move it went out before TRACTOR"
            await base.request_mode(TRACTOR)
            applied = base.send_motion(5.0, 0.0)
            assert applied.v == pytest.approx(0.5)
            await asyncio.sleep(0.02)
            await drive(base, 0.3, 0.3, 0.6)
            state = base.latest
            assert state is not None
            assert (state.v, state.w) == pytest.approx((0.3, 0.3), abs=0.01)
            assert (state.target_v, state.target_w) == pytest.approx((0.3, 0.3), abs=0.01)
            assert it.model.twist == pytest.approx((0.3, 0.3), abs=0.01)
            assert state.x > 0.1
            assert state.y > 0.005
            assert 0.1 < state.yaw < 0.4
            assert state.battery_percent > 90
            assert state.warnings == ()
        assert base.link is LinkState.CLOSED
        assert it.model.state is OperationalState.STANDBY
        assert it.model.twist == pytest.approx((0.0, 0.0), abs=0.02)
        stats = base.stats
        assert (stats.lost, stats.damaged, stats.dropped, stats.watchdog_trips) == (0, 0, 0, 0)
        assert 40 < stats.rate_hz < 70


@virtual_time
async def test_odometry_is_what_the_wheels_did_and_knows_how_sure_it_is() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        start = it.model.drive.right_m, it.model.drive.left_m
        await drive(base, 0.2, -0.4, 0.4)
        await base.request_mode(STANDBY)
        await until(lambda: base.latest and base.latest.v == base.latest.w == 0)
        right, left = it.model.drive.right_m - start[0], it.model.drive.left_m - start[1]
        state = base.latest
        assert state is not None
        assert state.yaw == pytest.approx((right - left) / 0.481224, abs=1e-3)
        assert state.yaw < -0.1
        xx, _, _, yy, _, yaw_yaw = state.covariance
        assert xx > 0
        assert yy > 0
        assert 0 < yaw_yaw < 0.1


@virtual_time
async def test_a_blocked_base_is_warned_of_in_words() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.3, 0.0, 0.5)
        it.model.block()
        await drive(base, 0.3, 0.0, 0.8)
        assert base.latest is not None
        assert any("follows" in warning for warning in base.latest.warnings)


@virtual_time
async def test_states_can_be_iterated_until_the_base_is_closed() -> None:
    async with rig() as it:
        seen: list[Any] = []
        async with it.device() as base:
            await base.ready(READY_S)

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


@virtual_time
async def test_in_standby_it_polls_and_sends_nothing_else() -> None:
    async with rig() as it, it.device(dataclasses.replace(CONFIG, poll_hz=25.0)) as base:
        await base.ready(READY_S)
        it.wire.clear()
        await asyncio.sleep(1.0)
        sent = [frame for frame in it.wire if frame.to_base]
        assert 23 <= len(sent) <= 26
        assert {(frame.can_id, frame.data) for frame in sent} == {(CONFIG_ID, ZERO)}


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@virtual_time
async def test_a_velocity_that_is_no_number_is_dropped_and_counted(value: float) -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        with pytest.raises(RmpBadCommand):
            base.send_motion(value, 0.0)
        with pytest.raises(RmpBadCommand):
            base.send_motion(0.0, value)
        assert it.sent(MOTION_ID) == []
        assert base.stats.dropped == 2


@virtual_time
async def test_motion_goes_out_with_100_hz_at_most_and_zero_always() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        base.send_motion(0.2, 0.0)
        with pytest.raises(RmpTooFast, match="every 10 ms"):
            base.send_motion(0.3, 0.0)
        for _ in range(3):
            base.send_motion(0.0, 0.0)
        await asyncio.sleep(0.009)
        with pytest.raises(RmpSendDropped):
            base.send_motion(0.2, 0.0)
        await asyncio.sleep(0.001)
        base.send_motion(0.2, 0.0)
        assert len(it.sent(MOTION_ID)) == 5
        assert base.stats.dropped == 2


@virtual_time
async def test_a_command_that_nobody_renews_becomes_zero() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.15, 0.0, 0.3)
        last_ns = clock().now_ns
        await until(lambda: it.sent(MOTION_ID)[-1] == ZERO)
        assert 0.25 < (clock().now_ns - last_ns) / 1e9 < 0.35, "before the base's own 0.5 s"
        await until(lambda: it.model.twist == (0.0, 0.0))
        assert it.model.state is OperationalState.TRACTOR
        assert base.stats.watchdog_trips == 0
        base.send_motion(0.1, 0.0)


@virtual_time
async def test_a_zero_that_the_bus_did_not_take_is_said_again() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.15, 0.0, 0.1)
        it.bus.full = True
        await asyncio.sleep(0.29)
        it.bus.full = False
        await asyncio.sleep(0.1)
        assert it.sent(MOTION_ID)[-1] == ZERO


@pytest.mark.parametrize("mode", [ModeRequest.DISABLE, ModeRequest.POWERDOWN, ModeRequest.DTZ, ModeRequest.BALANCE])
@virtual_time
async def test_no_other_mode_is_ever_requested(mode: ModeRequest) -> None:
    with pytest.raises(RmpRefused, match="never requested"):
        await Rmp110(lambda: CanTransport("virtual", "x"), CONFIG).request_mode(mode)


@virtual_time
async def test_silence_ends_motion_and_comes_back_only_with_a_new_request() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.1, 0.0, 0.2)
        silent_ns = clock().now_ns
        silence = asyncio.create_task(it.silence(0.45))
        await until(lambda: base.refusal() is not None)
        assert (clock().now_ns - silent_ns) / 1e9 < 0.35
        with pytest.raises(RmpNotIdentified):
            base.send_motion(0.2, 0.0)
        await until(lambda: base.link is not LinkState.STREAMING)
        assert "no feedback for 0.3 s" in base.stats.detail
        assert base.stats.lost > 5
        await silence
        await base.ready(READY_S)
        assert base.stats.detail == ""
        assert base.stats.reconnects >= 1
        with pytest.raises(RmpWrongMode, match="nobody asked"):
            base.send_motion(0.2, 0.0)
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.2)


@virtual_time
async def test_an_interface_that_goes_down_is_told_at_once_and_mended() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.2)
        it.bus.go_down()
        await asyncio.sleep(0.01)
        assert base.link is not LinkState.STREAMING
        assert "is down" in base.stats.detail
        with pytest.raises(RmpNotIdentified, match="is down"):
            base.send_motion(0.2, 0.0)
        await asyncio.sleep(0.8)
        it.bus.step()
        assert it.model.twist == (0.0, 0.0), "the base's own timeout"
        it.bus.go_up()
        await base.ready(READY_S)
        assert isinstance(base.refusal(), RmpWrongMode)


@virtual_time
async def test_the_kill_switch_is_told_in_words_and_the_base_found_again_after_power_on() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.1, 0.0, 0.2)
        it.bus.kill_switch()
        await until(lambda: base.latest and base.latest.faults)
        assert base.latest is not None
        assert base.latest.faults == ("architecture: kill switch active",)
        assert base.latest.dynamic_response == 0x200
        with pytest.raises((RmpFaulted, RmpNotIdentified), match="kill switch"):
            base.send_motion(0.1, 0.0)
        assert it.sent(MOTION_ID)[-1] == ZERO
        await until(lambda: base.link is LinkState.BACKOFF and base.stats.reconnects >= 1)
        assert "power button" in base.stats.detail
        it.bus.power_on()
        await base.ready(READY_S)
        assert isinstance(base.refusal(), RmpWrongMode)


@virtual_time
async def test_a_latched_fault_refuses_tractor() -> None:
    async with rig() as it, it.device() as base:
        it.model.fault_words[3] = 0x20
        await base.ready(READY_S)
        with pytest.raises(RmpFaulted, match="motor controller 1 failed"):
            await base.request_mode(TRACTOR)


@virtual_time
async def test_a_base_that_leaves_tractor_by_itself_is_not_commanded_any_more() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        it.model.state = OperationalState.STANDBY
        await until(lambda: base.refusal() is not None)
        with pytest.raises(RmpWrongMode, match="the base left it and is in STANDBY"):
            base.send_motion(0.1, 0.0)
        it.model.state = OperationalState.TRACTOR
        await until(lambda: base.latest and base.latest.mode is OperationalState.TRACTOR)
        assert isinstance(base.refusal(), RmpWrongMode), "only a new request gives motion back"


@virtual_time
async def test_an_intervention_of_one_packet_is_kept_until_standby_is_requested() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.2, 0.0, 0.2)
        it.model.dynamic_response = 0x10
        await until(lambda: base.latest and base.latest.dynamic_response)
        it.model.dynamic_response = 0
        await asyncio.sleep(0.5)
        assert base.latest is not None
        assert base.latest.trouble_now is None
        assert "acts of its own accord" in str(base.latest.trouble)
        with pytest.raises(RmpFaulted, match=r"it is over, .* request STANDBY"):
            base.send_motion(0.1, 0.0)
        with pytest.raises(RmpFaulted):
            await base.request_mode(TRACTOR)
        await base.request_mode(STANDBY)
        await base.request_mode(TRACTOR)
        assert base.latest.trouble is None
        base.send_motion(0.1, 0.0)


@pytest.mark.parametrize("after_s", [0.0, 0.001, 0.01, 0.03, 0.045])
@pytest.mark.parametrize("cancelled", [False, True])
@virtual_time
async def test_whoever_leaves_while_tractor_is_requested_leaves_the_base_in_standby(
    after_s: float, cancelled: bool
) -> None:
    async with rig() as it:
        async with it.device() as base:
            await base.ready(READY_S)
            request = asyncio.create_task(base.request_mode(TRACTOR))
            await asyncio.sleep(after_s)
            if cancelled:
                request.cancel()
        await asyncio.gather(request, return_exceptions=True)
        await asyncio.sleep(0.2)
        it.bus.step()
        assert it.model.state is OperationalState.STANDBY


@virtual_time
async def test_somebody_else_commanding_takes_motion_away_until_it_stops() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        for _ in range(20):
            it.bus.foreign(motion(0.5, 0.0))
            await asyncio.sleep(0.02)
            assert base.link is not LinkState.STREAMING
        assert isinstance(base.refusal(), RmpNotIdentified)
        assert "another program or panel commands this base" in base.stats.detail
        await base.ready(READY_S)
        assert isinstance(base.refusal(), RmpWrongMode)


@virtual_time
async def test_while_somebody_else_commands_nothing_is_sent() -> None:
    async with rig() as it, it.device() as base:
        while base.stats.reconnects < 2:
            it.bus.foreign(motion(0.0, 0.0))
            await asyncio.sleep(0.02)
        assert [frame for frame in it.wire if frame.to_base] == []
        assert "another program" in base.stats.detail


@virtual_time
async def test_a_bus_without_a_base_says_what_to_check() -> None:
    async with rig() as it:
        it.bus.power_off()
        async with it.device() as base:
            with pytest.raises(RmpTimeout, match=r"switch it on .* check the CAN cable"):
                await base.ready(3.0)


@virtual_time
async def test_a_missing_interface_is_one_sentence_and_tried_again() -> None:
    async with rig() as it:
        it.bus.go_down()
        async with it.device() as base:
            with pytest.raises(RmpTimeout, match="CAN interface can0 is down"):
                await base.ready(0.3)
            await until(lambda: base.stats.reconnects >= 2)
            assert base.refusal() is not None


@virtual_time
async def test_the_factory_feedback_set_is_replaced_by_the_compact_one() -> None:
    async with rig(compact=False) as it, it.device() as base:
        await base.ready(READY_S)
        assert it.model.stored.bitmaps == COMPACT_BITMAPS
        await until(lambda: base.latest)
        assert base.latest is not None
        assert base.latest.temperature_degc is None


@virtual_time
async def test_without_permission_nothing_is_written_and_the_stored_set_is_read() -> None:
    async with rig(compact=False) as it, it.device(dataclasses.replace(CONFIG, write_feedback_set=False)) as base:
        identity = await base.ready(READY_S)
        assert it.model.stored.bitmaps == FACTORY_BITMAPS
        assert set(numbers(it)) == {0, 30}
        assert identity.firmware == "SP 1246, UIP 1279"
        state = base.latest
        assert state is not None
        assert state.temperature_degc is not None
        assert 20 < state.temperature_degc < 35
        assert {"front 1", "auxiliary"} <= {battery.name for battery in state.batteries}


@virtual_time
async def test_a_base_that_never_answers_polls_is_still_found_and_given_a_feedback_set() -> None:
    async with rig(stored={f"feedback_bitmap_{n}": 0 for n in (1, 2, 3)}) as it, it.device() as base:
        await base.ready(READY_S)
        assert it.model.stored.bitmaps == COMPACT_BITMAPS


@virtual_time
async def test_stored_limits_scale_motion_and_configured_ones_clamp_it() -> None:
    async with rig(stored={"max_velocity": 2.2352, "max_yaw_rate": 3.0}) as it, it.device() as base:
        identity = await base.ready(READY_S)
        assert set(identity.differences) == {"max_velocity", "max_yaw_rate"}
        await base.request_mode(TRACTOR)
        base.send_motion(0.5, 0.2)
        await asyncio.sleep(0.02)
        base.send_motion(2.0, -3.0)
        first, second = it.sent(MOTION_ID)[:2]
        assert first == bytes.fromhex("3E650FF2 BD888889"), "0.5 by 2.2352 as float32 has it"
        assert unpack_words(second)[0] == unpack_words(first)[0], "0.5 m/s is the configured limit"
        assert unpack_words(second)[1] == 0x3EAAAAAB, "1.0 of 3.0 rad/s, clockwise"


@pytest.mark.parametrize(
    ("name", "value"),
    [("max_decel", 0.25), ("max_accel", 1.0), ("max_yaw_accel", 1.5), ("tire_diameter", 0.4811), ("gear_ratio", 24.0)],
)
@virtual_time
async def test_a_parameter_that_nobody_configured_refuses_motion(name: str, value: float) -> None:
    async with rig(stored={name: value}) as it, it.device() as base:
        await base.ready(READY_S)
        with pytest.raises(RmpLimitsDiffer, match=rf"{name} = {value:g}.*, the configuration expects"):
            await base.request_mode(TRACTOR)


@virtual_time
async def test_what_is_expected_can_be_configured() -> None:
    expected = {**CONFIG.expected, "tire_diameter": 0.4811, "max_decel": 0.25}
    async with (
        rig(stored={"tire_diameter": 0.4811, "max_decel": 0.25}) as it,
        it.device(dataclasses.replace(CONFIG, expected=expected)) as base,
    ):
        assert (await base.ready(READY_S)).differences == {}
        await base.request_mode(TRACTOR)


@virtual_time
async def test_with_permission_differing_parameters_are_written_and_verified() -> None:
    async with (
        rig(stored={"max_decel": 3.923, "max_velocity": 2.2352}) as it,
        it.device(dataclasses.replace(CONFIG, write_parameters=True)) as base,
    ):
        identity = await base.ready(READY_S)
        assert identity.differences == {}
        assert it.model.stored.differing(CONFIG.expected) == {}
        assert sorted(number for number in numbers(it) if 1 <= number <= 20) == [1, 3], "only what differs"


@virtual_time
async def test_nothing_is_written_while_the_base_may_roll() -> None:
    async with rig(stored={"max_decel": 3.923}) as it:
        it.model.state = OperationalState.TRACTOR
        async with it.device(dataclasses.replace(CONFIG, write_parameters=True)) as base:
            identity = await base.ready(READY_S)
            assert list(identity.differences) == ["max_decel"]


@virtual_time
async def test_nothing_is_written_to_a_rolling_base_whose_reply_got_lost() -> None:
    """Each of the replies in turn is the one that never comes."""
    for lost in range(3, 40):
        async with rig(stored={"max_decel": 3.923}, compact=lost % 2 == 0) as it:
            it.model.state = OperationalState.TRACTOR
            receive, count = it.model.receive, itertools.count()

            def lossy(now_ns: int, frame: Frame, receive: Any = receive, count: Any = count, lost: int = lost) -> Any:
                replies = receive(now_ns, frame)
                return () if next(count) == lost else replies

            it.model.receive = lossy  # type: ignore[method-assign]
            async with it.device(dataclasses.replace(CONFIG, write_parameters=True)) as base:
                await base.ready(READY_S)
                assert 3 not in numbers(it), f"reply {lost} lost"


@virtual_time
async def test_what_could_not_be_written_in_tractor_is_written_in_standby() -> None:
    async with rig(stored={"max_decel": 3.923}) as it:
        it.model.state = OperationalState.TRACTOR
        async with it.device(dataclasses.replace(CONFIG, write_parameters=True)) as base:
            await base.ready(READY_S)
            with pytest.raises(RmpLimitsDiffer, match="written as soon as the base is in STANDBY"):
                await base.request_mode(TRACTOR)
            await base.request_mode(STANDBY)
            await until(lambda: base.identity is None)
            identity = await base.ready(READY_S)
            assert (identity.differences, identity.refusal) == ({}, None)
            await base.request_mode(TRACTOR)


@virtual_time
async def test_a_parameter_that_the_base_does_not_take_is_not_tried_for_ever() -> None:
    async with rig(stored={"input_bitmap": 0x103}) as it:
        it.model.unknowns = dataclasses.replace(it.model.unknowns, refused_bitmaps=frozenset({0x101}))
        async with it.device(dataclasses.replace(CONFIG, write_parameters=True)) as base:
            await base.ready(READY_S)
            with pytest.raises(RmpLimitsDiffer, match="the base did not take it"):
                await base.request_mode(TRACTOR)
            await asyncio.sleep(1.0)
            assert base.stats.reconnects == 0


@virtual_time
async def test_a_base_that_refuses_the_track_width_still_turns_as_commanded() -> None:
    async with (
        rig(stored={"track_width": 0.569976}) as it,
        it.device(dataclasses.replace(CONFIG, write_parameters=True)) as base,
    ):
        identity = await base.ready(READY_S)
        assert list(identity.differences) == ["track_width"]
        await base.request_mode(TRACTOR)
        await drive(base, 0.0, 0.4, 0.4)
        assert it.model.twist[1] == pytest.approx(0.4, abs=0.01)
        assert base.latest is not None
        assert base.latest.w == pytest.approx(0.4, abs=0.01)
        assert base.latest.target_w == pytest.approx(0.4, abs=0.01)


@virtual_time
async def test_a_base_that_drives_while_charging_is_warned_of() -> None:
    async with rig(stored={"input_bitmap": 0x109}) as it, it.device() as base:
        identity = await base.ready(READY_S)
        assert "drive while its charger is plugged in" in identity.warnings[0]
        assert base.latest is not None
        assert base.latest.warnings == identity.warnings
        await base.request_mode(TRACTOR)


@pytest.mark.parametrize(
    ("bitmap", "sentence"),
    [(0x103, "take velocity commands for accelerations"), (0x301, "filter commands"), (0x1001, "filter commands")],
)
@virtual_time
async def test_a_base_that_follows_commands_otherwise_is_not_driven(bitmap: int, sentence: str) -> None:
    async with rig(stored={"input_bitmap": bitmap}) as it:
        async with it.device() as base:
            await base.ready(READY_S)
            with pytest.raises(RmpLimitsDiffer, match=sentence):
                await base.request_mode(TRACTOR)
            assert it.model.state is OperationalState.STANDBY
        async with it.device(dataclasses.replace(CONFIG, write_parameters=True)) as base:
            await base.ready(READY_S)
            assert it.model.stored["input_bitmap"] == bitmap & 0x101
            await base.request_mode(TRACTOR)


@virtual_time
async def test_a_base_that_scales_its_yaw_rate_is_warned_of() -> None:
    async with rig(stored={"input_bitmap": 0x100}) as it, it.device() as base:
        identity = await base.ready(READY_S)
        assert "turn less than commanded" in identity.warnings[0]


@virtual_time
async def test_a_booting_base_is_read_but_not_asked_to_drive() -> None:
    async with rig(boot_s=3.0) as it, it.device() as base:
        await base.ready(READY_S)
        with pytest.raises(RmpWrongMode, match="wait until it is in STANDBY"):
            await base.request_mode(TRACTOR)
        await until(lambda: base.latest and base.latest.mode is OperationalState.STANDBY)
        await base.request_mode(TRACTOR)


@virtual_time
async def test_a_base_that_ignores_a_mode_request_is_reported() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        receive = it.model.receive

        def deaf_for_modes(now_ns: int, frame: Frame) -> tuple[Frame, ...]:
            poll = Frame(CONFIG_ID, ZERO)
            return receive(now_ns, poll if frame.data[:4] == bytes((0, 0, 0, 32)) else frame)

        it.model.receive = deaf_for_modes  # type: ignore[method-assign]
        with pytest.raises(RmpTimeout, match="did not go to TRACTOR within 1 s"):
            await base.request_mode(TRACTOR)
        assert isinstance(base.refusal(), RmpWrongMode)


@virtual_time
async def test_a_base_that_went_away_while_driving_is_brought_to_zero_by_itself() -> None:
    async with rig() as it:
        async with it.device() as base:
            await base.ready(READY_S)
            await base.request_mode(TRACTOR)
            await drive(base, 0.2, 0.0, 0.4)
            it.bus.silent = it.bus.deaf = True  # close cannot reach it either
            await until(lambda: base.link is not LinkState.STREAMING)
        await asyncio.sleep(1.0)
        it.bus.step()
        assert it.model.twist == (0.0, 0.0)


@virtual_time
async def test_losses_and_damage_are_counted_and_do_not_end_the_link() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        it.bus.plan_faults(FaultPlan(seed=3, drop=0.02, corrupt=0.02))
        before = base.stats.received
        await until(lambda: base.stats.received >= before + 100)
        stats = base.stats
        assert stats.lost > 0
        assert stats.damaged > 0
        assert stats.reconnects == 0
        assert base.latest is not None
        assert (base.latest.v, base.latest.x) == (0.0, 0.0)


@virtual_time
async def test_identification_survives_lost_frames() -> None:
    async with rig() as it:
        it.bus.plan_faults(FaultPlan(seed=11, drop=0.01))
        async with it.device() as base:
            await base.ready(20.0)


@virtual_time
async def test_a_full_bus_drops_commands_and_the_next_one_goes_out() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        it.bus.full = True
        with pytest.raises(OSError, match="transmit buffer full"):
            base.send_motion(0.2, 0.0)
        assert base.stats.dropped == 1
        it.bus.full = False
        assert base.send_motion(0.2, 0.0).v == pytest.approx(0.2)
        assert len(it.sent(MOTION_ID)) == 1, "nothing was queued"


@virtual_time
async def test_what_a_pulled_plug_leaves_in_the_kernels_queue_ends_with_zero() -> None:
    async with rig() as it, it.device() as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.3, 0.2, 0.5)
        pulled = len(it.wire)
        it.bus.silent = it.bus.deaf = True
        for _ in range(14):
            base.send_motion(0.3, 0.2)
            await asyncio.sleep(0.02)
        queued = [frame for frame in it.wire[pulled:] if frame.to_base][:10]
        motions = [frame.data for frame in queued if frame.can_id == MOTION_ID]
        assert motions.count(ZERO) >= 4
        assert ZERO not in motions[:3], "a lost reply or two stop nobody"
        assert set(motions[-4:]) == {ZERO}, "these take effect when the plug is back in"


@virtual_time
async def test_the_recorder_gets_every_frame_both_ways() -> None:
    tape: list[tuple[str, int]] = []
    async with rig() as it, it.device(hook=lambda _ns, way, can_id, _data: tape.append((way, can_id))) as base:
        await base.ready(READY_S)
        await base.request_mode(TRACTOR)
        await drive(base, 0.1, 0.0, 0.1)
    assert [can_id for way, can_id in tape if way == "tx"] == [f.can_id for f in it.wire if f.to_base]
    assert len([1 for way, _ in tape if way == "rx"]) >= 11 * base.stats.received


def test_link_errors_are_also_the_built_in_kind() -> None:
    assert issubclass(RmpForeignCommands, ConnectionError)
    assert issubclass(RmpLinkError, OSError)
    assert issubclass(RmpTooFast, OSError)
    assert issubclass(RmpTimeout, TimeoutError)
    assert issubclass(RmpBadCommand, ValueError)


@pytest.mark.parametrize(
    "change",
    [
        {"poll_hz": 10.0},
        {"poll_hz": 100.0},
        {"max_v_mps": 0.0},
        {"track_m": 5.0},
        {"expected": {"speed": 1.0}},
        {"expected": {"max_accel": 9.0}},
        {"expected": {"ip_address": 1}},
        {"expected": {"input_bitmap": 0x9}},
        {"protocol": "v4"},
        {"dialect": "B2"},
    ],
)
def test_settings_outside_of_what_a_base_can_be_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"poll_hz|max_v_mps|unknown stored|cannot store|protocol is one of"):
        Rmp110Config(**change)
