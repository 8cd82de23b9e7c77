"""The driver against the simulated camera, attached directly and over USB/IP."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import replace

import pytest
import usb1

from drivers.theta_v import AccessUnit, Mode, ThetaConfig, ThetaV
from drivers.theta_v.codec.ptp import Property
from drivers.theta_v.device import bringup, ptp_session, watch
from drivers.theta_v.device import camera as device
from drivers.theta_v.device.camera import TransportFactory
from drivers.theta_v.device.ladder import Ladder
from drivers.theta_v.device.stats import Link
from drivers.theta_v.errors import ThetaGone, ThetaNotFound, ThetaRefused, ThetaTimeout, ThetaWrongDevice
from drivers.theta_v.simulator.attached import AttachedTransport
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.descriptors import Composition
from drivers.theta_v.simulator.faults import Cure, FaultPlan, FirstSession, Overheat, PowerCycle, Stall, Unplug
from drivers.theta_v.simulator.usbip_server import UsbIpServer
from drivers.theta_v.transport.base import GoneSink
from drivers.theta_v.transport.libusb import LibUsbTransport
from drivers.theta_v.transport.usbip import UsbIpTransport
from tests.drivers.theta_v.fake_usb1 import FakeDevice, FakeHandle, Machine
from tests.drivers.theta_v.pictures import KEY_INTERVAL, Feeder, stream, until

PICTURES = stream(30, 192, 96)
QUICK = ThetaConfig(stall_s=0.25, first_picture_s=0.3, backoff_min_s=0.02, backoff_max_s=0.1)
PATIENT = ThetaConfig(stall_s=20.0, first_picture_s=20.0, queue_units=90)


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between two looks at the same thing; what is waited for stays as it is."""
    monkeypatch.setattr(ptp_session, "OPEN_PAUSE_S", 0.01)
    monkeypatch.setattr(bringup, "WAKE_PAUSE_S", 0.01)
    monkeypatch.setattr(device, "WATCH_S", 0.02)
    monkeypatch.setattr(device, "RETURN_PAUSE_S", 0.02)


Front = Callable[[SimulatedThetaV], AbstractAsyncContextManager[TransportFactory]]


@asynccontextmanager
async def attached(camera: SimulatedThetaV) -> AsyncIterator[TransportFactory]:
    yield lambda: AttachedTransport(camera)


@asynccontextmanager
async def over_usbip(camera: SimulatedThetaV) -> AsyncIterator[TransportFactory]:
    with UsbIpServer(camera) as server:
        yield lambda: UsbIpTransport(server.host, server.port)


@asynccontextmanager
async def over_libusb(camera: SimulatedThetaV) -> AsyncIterator[TransportFactory]:
    machine = Machine(camera)
    yield lambda: LibUsbTransport(open_context=machine.context)
    assert (machine.offences, machine.contexts) == ([], 0)


fronts = pytest.mark.parametrize("front", [attached, over_usbip, over_libusb])


async def take(camera: ThetaV, count: int, timeout_s: float = 30.0) -> list[AccessUnit]:
    units: list[AccessUnit] = []
    async with asyncio.timeout(timeout_s):
        async for unit in camera.access_units():
            units.append(unit)
            if len(units) == count:
                break
    return units


@fronts
async def test_pictures_arrive_byte_for_byte_and_in_order(front: Front) -> None:
    simulated = SimulatedThetaV()
    recorded: list[AccessUnit] = []
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES):
            async with ThetaV(factory, PATIENT, on_access_unit=recorded.append) as camera:
                units = await take(camera, 45)
                stats = camera.stats
    start = PICTURES.index(units[0].raw)
    assert [u.raw for u in units] == [PICTURES[(start + i) % 30] for i in range(45)]
    assert not any(u.tainted for u in units)
    assert all(u.first_ns <= u.stamp_ns for u in units)
    assert [u.stamp_ns for u in units] == sorted(u.stamp_ns for u in units)
    assert recorded[0].raw == PICTURES[0], "the very first picture of the camera is not lost"
    assert (stats.link, stats.detail, stats.lost, stats.damaged) == (Link.STREAMING, "", 0, 0)
    assert (stats.model, stats.serial, stats.firmware) == ("RICOH THETA V", "00105377", "3.50.1")
    assert (stats.usb_id, stats.width, stats.height) == ("05ca:2712", 192, 96)
    assert 0 < stats.rate_hz < 110
    assert camera.stats.link is Link.CLOSED
    assert simulated.demand is None, "the camera does not go on streaming to nobody"


@fronts
async def test_the_configured_size_is_what_the_camera_is_asked_for(front: Front) -> None:
    for mode in Mode:
        simulated = SimulatedThetaV(probe_bytes=34)
        async with front(simulated) as factory, ThetaV(factory, ThetaConfig(mode=mode)):
            await until(lambda: simulated.demand is not None)  # noqa: B023 awaited in this very turn
            demand = simulated.demand
        assert demand is not None
        assert (demand.width, demand.height) == mode.value


@fronts
async def test_a_camera_in_mtp_mode_is_woken_and_switched_to_live(front: Front) -> None:
    simulated = SimulatedThetaV(composition=Composition.MTP, asleep=True, reenumeration_s=0.2)
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES):
            async with ThetaV(factory, QUICK) as camera:
                units = await take(camera, 3)
    assert units[0].keyframe
    assert simulated.composition is Composition.LIVE
    assert simulated.ptp.properties[0xD803].current == 0
    assert simulated.ptp.properties[0xD81B].current == 0


@fronts
async def test_an_unplugged_camera_is_taken_up_again(front: Front) -> None:
    simulated = SimulatedThetaV()
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES):
            async with ThetaV(factory, QUICK) as camera:
                first = await take(camera, 5)
                simulated.unplug()
                await until(lambda: camera.stats.link is not Link.STREAMING)
                assert any(why in camera.stats.detail for why in ("left the bus", "no THETA", "broke"))
                await until(lambda: "no THETA" in camera.stats.detail)
                simulated.replug()
                again = await take(camera, 15)
                await until(lambda: camera.stats.detail == "")
                assert camera.stats.reconnects > 0
    assert again[0].keyframe
    assert again[0].sequence > first[-1].sequence
    assert not any(u.tainted for u in again)


@fronts
@pytest.mark.parametrize("event", [Unplug(0.3, 0.2), PowerCycle(0.3, 0.2)])
async def test_a_planned_absence_is_survived(front: Front, event: Unplug | PowerCycle) -> None:
    simulated = SimulatedThetaV(plan=FaultPlan(events=(event,)), reenumeration_s=0.1)
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES):
            async with ThetaV(factory, QUICK) as camera:
                await until(lambda: camera.stats.reconnects > 0)
                await until(lambda: camera.stats.link is Link.STREAMING)
                assert len(await take(camera, 12)) == 12


@fronts
async def test_joining_in_the_middle_of_a_group_waits_for_its_key_picture(front: Front) -> None:
    simulated = SimulatedThetaV()
    seen: list[AccessUnit] = []
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES, start=4):
            async with ThetaV(factory, QUICK, on_access_unit=seen.append) as camera:
                units = await take(camera, 3)
    assert units[0].raw == PICTURES[KEY_INTERVAL]
    assert seen[0].taint == "no key picture yet"
    assert not seen[0].decodable


@pytest.mark.parametrize(
    ("front", "cure"),
    [
        (attached, Cure.RESTART),
        (attached, Cure.NEGOTIATE),
        (attached, Cure.TOGGLE),
        (over_usbip, Cure.RESET),
        (over_libusb, Cure.RESET),
        (over_libusb, Cure.TOGGLE),
    ],
)
async def test_a_stalled_stream_is_brought_back_by_the_mildest_means(front: Front, cure: Cure) -> None:
    simulated = SimulatedThetaV(plan=FaultPlan(events=(Stall(0.1, cure),)), reenumeration_s=0.1)
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES):
            async with ThetaV(factory, QUICK) as camera:
                await until(lambda: camera.stats.restarts > 0)
                await until(lambda: camera.stats.detail == "" and camera.stats.link is Link.STREAMING)
                assert (
                    camera.stats.restarts == {Cure.RESTART: 1, Cure.NEGOTIATE: 3, Cure.RESET: 4, Cure.TOGGLE: 5}[cure]
                )
                assert (camera.stats.reconnects > 0) == (cure is Cure.TOGGLE)
                assert not any(u.tainted for u in await take(camera, 3))


async def test_a_camera_sent_to_still_mode_is_fetched_back_by_its_serial_number() -> None:
    asked: list[str | None] = []

    class Listening(AttachedTransport):
        async def open(self, serial: str | None, on_gone: GoneSink) -> None:
            asked.append(serial)
            await super().open(serial, on_gone)

    plan = FaultPlan(events=(Stall(0.1, Cure.TOGGLE),))
    simulated = SimulatedThetaV(plan=plan, reenumeration_s=0.1)
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: Listening(simulated), QUICK) as camera:
            await until(lambda: camera.stats.reconnects > 0 and camera.stats.link is Link.STREAMING)
    assert asked[0] is None
    assert set(asked[1:]) == {"00105377"}


@fronts
async def test_under_packet_loss_every_clean_picture_is_as_the_camera_made_it(front: Front) -> None:
    plan = FaultPlan(seed=3, lost_packets=0.01, error_packets=0.01, missing_ends=0.03, lost_pictures=0.03)
    simulated = SimulatedThetaV(plan=plan)
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES, rate_hz=150):
            async with ThetaV(factory, QUICK) as camera:
                units = await take(camera, 120)
                stats = camera.stats
    clean = [u for u in units if not u.tainted]
    assert all(u.raw in PICTURES for u in clean)
    assert 0 < len(clean) < len(units)
    assert stats.damaged > 0
    assert stats.lost > 0
    assert stats.tainted > stats.damaged


@fronts
async def test_video_through_a_bulk_endpoint_is_the_same_video(front: Front) -> None:
    simulated = SimulatedThetaV(bulk_video=True)
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES):
            async with ThetaV(factory, QUICK) as camera:
                units = await take(camera, 15)
                simulated.stall(Cure.RESTART)
                await until(lambda: camera.stats.restarts > 0)
                again = await take(camera, 5)
    start = PICTURES.index(units[0].raw)
    assert [u.raw for u in units] == [PICTURES[(start + i) % 30] for i in range(15)]
    assert not any(u.tainted for u in [*units, *again])
    assert simulated.demand is None


@fronts
async def test_a_live_camera_is_kept_awake_and_asked_how_it_is(front: Front) -> None:
    simulated = SimulatedThetaV()
    simulated.ptp.busy = 5
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES):
            async with ThetaV(factory, replace(QUICK, health_s=0.05)) as camera:
                await until(lambda: camera.stats.battery_percent == 98)
                assert (camera.stats.charging, camera.stats.faults) == ("charging", ())
                assert simulated.ptp.properties[Property.SLEEP_DELAY_S].current == 0
                assert simulated.ptp.properties[Property.AUTO_POWER_OFF_S].current == 0
                simulated.ptp.set(Property.ERROR_INFO, 0x80100008)
                await until(lambda: len(camera.stats.faults) == 2)
                assert "too hot" in camera.stats.faults[0]
                assert camera.stats.tainted == 0


async def test_a_camera_that_sleeps_in_live_mode_is_woken() -> None:
    """As one that waited for the robot to be switched on."""
    simulated = SimulatedThetaV(asleep=True)
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: AttachedTransport(simulated), QUICK) as camera:
            assert (await take(camera, 3))[0].keyframe
            assert camera.stats.restarts == 0


@pytest.mark.parametrize("first_session", FirstSession)
async def test_however_a_sleeping_camera_fails_the_first_session_the_next_one_does(
    first_session: FirstSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ptp_session, "ANSWER_S", 0.1)
    plan = FaultPlan(first_session=first_session)
    simulated = SimulatedThetaV(composition=Composition.MTP, asleep=True, reenumeration_s=0.1, plan=plan)
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: AttachedTransport(simulated), QUICK, once=True) as camera:
            assert (await take(camera, 3))[0].keyframe


async def test_a_camera_that_leaves_for_live_mode_before_it_answers_is_waited_for() -> None:
    simulated = SimulatedThetaV(composition=Composition.MTP, reenumeration_s=0.1, reply_s=0.0)
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: AttachedTransport(simulated), QUICK, once=True) as camera:
            assert (await take(camera, 3))[0].keyframe


async def test_a_camera_that_belongs_to_root_until_udev_has_seen_its_new_face_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulated = SimulatedThetaV(composition=Composition.MTP, reenumeration_s=0.05)
    machine = Machine(simulated)
    refused: list[str] = []
    opened = FakeDevice.open

    def as_udev_lets(device: FakeDevice) -> FakeHandle:
        if device.port.connected and simulated.composition is Composition.LIVE and len(refused) < 2:
            refused.append("open")
            raise usb1.USBErrorAccess
        return opened(device)

    monkeypatch.setattr(FakeDevice, "open", as_udev_lets)
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: LibUsbTransport(open_context=machine.context), QUICK, once=True) as camera:
            assert (await take(camera, 3))[0].keyframe
    assert len(refused) == 2


async def test_damage_is_not_carried_for_ever_where_key_pictures_never_come_by_themselves() -> None:
    """The film has one key picture and a hole; a new start is the only way to another key picture."""
    film = stream(120, 64, 32, key_interval=1000)
    simulated = SimulatedThetaV()
    seen: list[AccessUnit] = []
    with Feeder(simulated, film[:20] + film[21:]):
        quick = replace(QUICK, key_picture_s=0.3)
        async with ThetaV(lambda: AttachedTransport(simulated), quick, on_access_unit=seen.append) as camera:
            await until(lambda: camera.stats.restarts > 0)
            assert any(u.tainted for u in seen)
            damaged = len(seen)
            await until(lambda: any(u.keyframe and not u.tainted for u in seen[damaged:]))
            assert camera.stats.reconnects == 0


async def test_a_stream_without_any_key_picture_is_restarted_less_and_less_often() -> None:
    simulated = SimulatedThetaV()
    with Feeder(simulated, stream(120, 64, 32, key_interval=1000)[1:]):
        quick = replace(QUICK, key_picture_s=0.1)
        async with ThetaV(lambda: AttachedTransport(simulated), quick) as camera:
            await until(lambda: camera.stats.received > 0)
            began = time.monotonic()
            await until(lambda: camera.stats.restarts == 3)
            assert time.monotonic() - began > 0.1 + 0.2 + 0.4 - 0.05


async def test_a_mistake_of_the_driver_ends_the_pictures_instead_of_leaving_the_reader_waiting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulated = SimulatedThetaV()
    camera = ThetaV(lambda: AttachedTransport(simulated), QUICK, once=True)
    with Feeder(simulated, PICTURES):
        await camera.__aenter__()
        units = camera.access_units()
        await anext(units)
        monkeypatch.setattr(Ladder, "due", lambda *_: 1 / 0)
        await asyncio.wait_for(exhaust(units), 30)
    with pytest.raises(ZeroDivisionError):
        await camera.close()


async def test_one_error_on_the_ptp_pipe_does_not_end_the_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "RETRY_S", 0.02)
    errors: list[str] = []

    class Flaky(AttachedTransport):
        async def bulk_in(self, endpoint: int, length: int, timeout_s: float = 3.0) -> bytes:
            if camera.stats.battery_percent is not None and not errors:
                errors.append("once")
                raise ThetaGone("USB error 1 during endpoint 0x81")
            return await super().bulk_in(endpoint, length, timeout_s)

    simulated = SimulatedThetaV()
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: Flaky(simulated), replace(QUICK, health_s=0.02)) as camera:
            await until(lambda: bool(errors))
            simulated.ptp.set(Property.BATTERY_LEVEL, 42)
            await until(lambda: camera.stats.battery_percent == 42)
            assert camera.stats.reconnects == 0


@fronts
async def test_what_the_camera_says_unasked_is_heard_long_before_it_would_be_asked(
    front: Front, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "LULL_S", 0.02)
    simulated = SimulatedThetaV()
    async with front(simulated) as factory, ThetaV(factory, replace(QUICK, health_s=1000)) as camera:
        await until(lambda: camera.stats.battery_percent == 98)
        simulated.ptp.set(Property.CAPTURE_MODE, 0x8005)  # of no interest
        simulated.ptp.set(Property.ERROR_INFO, 0x80000000)
        await until(lambda: bool(camera.stats.faults))


async def test_a_camera_that_overheats_says_so_goes_and_is_taken_up_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "LULL_S", 0.02)
    plan = FaultPlan(events=(Overheat(0.2, 0.3, 0.2),))
    simulated = SimulatedThetaV(plan=plan, reenumeration_s=0.1)
    told: list[tuple[str, ...]] = []
    with Feeder(simulated, PICTURES):
        async with ThetaV(
            lambda: AttachedTransport(simulated), QUICK, on_health=lambda health: told.append(health.faults)
        ) as camera:
            await until(lambda: camera.stats.reconnects > 0 and camera.stats.link is Link.STREAMING)
            await until(lambda: camera.stats.faults == ())
    said = list(dict.fromkeys(told))
    assert said[:2] == [(), ("its board gets hot",)]
    assert "its board is too hot, it will switch off" in said[2]


@pytest.mark.parametrize(("keep_awake", "timers"), [(True, (0, 0)), (False, (180, 64800))])
async def test_the_sleep_timers_are_set_to_never_or_as_delivered(keep_awake: bool, timers: tuple[int, int]) -> None:
    simulated = SimulatedThetaV()
    simulated.ptp.set(Property.SLEEP_DELAY_S, 77)
    async with ThetaV(lambda: AttachedTransport(simulated), replace(QUICK, keep_awake=keep_awake, health_s=0)):
        await until(lambda: simulated.demand is not None)
    properties = simulated.ptp.properties
    assert (properties[Property.SLEEP_DELAY_S].current, properties[Property.AUTO_POWER_OFF_S].current) == timers


async def test_a_camera_whose_ptp_pipe_is_broken_streams_all_the_same() -> None:
    class Broken(AttachedTransport):
        async def bulk_in(self, endpoint: int, length: int, timeout_s: float = 3.0) -> bytes:
            raise ThetaGone("USB error 1 during endpoint 0x81")

    simulated = SimulatedThetaV()
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: Broken(simulated), QUICK, once=True) as camera:
            assert len(await take(camera, 3)) == 3


async def test_a_camera_that_is_busy_for_ever_streams_without_being_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ptp_session, "BUSY_S", 0.1)
    simulated = SimulatedThetaV()
    simulated.ptp.busy = 10**9
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: AttachedTransport(simulated), QUICK) as camera:
            assert len(await take(camera, 12)) == 12
            assert camera.stats.battery_percent is None


async def test_a_recorder_that_fails_does_not_stop_the_pictures() -> None:
    def fail(_: AccessUnit) -> None:
        raise OSError("disk full")

    simulated = SimulatedThetaV()
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: AttachedTransport(simulated), QUICK, on_access_unit=fail) as camera:
            assert len(await take(camera, 5)) == 5


async def test_a_reader_that_stalls_gets_the_newest_pictures_and_the_rest_is_counted() -> None:
    """150 pictures pass meanwhile, as many as in five seconds of the camera's own rate."""
    simulated = SimulatedThetaV()
    recorded: list[AccessUnit] = []
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: AttachedTransport(simulated), QUICK, on_access_unit=recorded.append) as camera:
            units = camera.access_units()
            first = await anext(units)
            await until(lambda: camera.stats.received >= first.sequence + 150)
            second = await anext(units)
            third = await anext(units)
            newest, dropped = recorded[-1].sequence, camera.stats.dropped
            assert len(camera._collector._mailboxes[0]._units) <= QUICK.queue_units
            assert camera.stats.link is Link.STREAMING
    assert second.keyframe, "what was built upon dropped pictures is dropped as well"
    assert newest - second.sequence < QUICK.queue_units + KEY_INTERVAL
    assert third.sequence == second.sequence + 1
    assert dropped == second.sequence - first.sequence - 1
    assert [u.sequence for u in recorded] == list(range(1, len(recorded) + 1)), "the recorder misses none"


async def test_two_readers_each_get_every_picture() -> None:
    simulated = SimulatedThetaV()
    with Feeder(simulated, PICTURES):
        async with ThetaV(lambda: AttachedTransport(simulated), QUICK) as camera:
            one, two = await asyncio.gather(take(camera, 12), take(camera, 12))
    assert [u.sequence for u in one] == [u.sequence for u in two]


@fronts
async def test_asked_once_a_missing_camera_is_an_error_in_words(front: Front) -> None:
    simulated = SimulatedThetaV()
    simulated.unplug()
    async with front(simulated) as factory:
        with pytest.raises(ThetaNotFound, match="plugged in"):
            async with ThetaV(factory, once=True):
                pass


@fronts
async def test_asked_once_a_held_camera_and_a_wrong_serial_are_told_apart(front: Front) -> None:
    simulated = SimulatedThetaV()
    async with front(simulated) as factory:
        with pytest.raises(ThetaWrongDevice, match="00105377"):
            async with ThetaV(factory, ThetaConfig(serial="12345678"), once=True):
                pass
        async with ThetaV(factory, once=True):
            with pytest.raises(ThetaRefused, match="another program"):
                async with ThetaV(factory, once=True):
                    pass


@fronts
async def test_asked_once_a_lost_camera_ends_the_pictures_with_an_error(front: Front) -> None:
    simulated = SimulatedThetaV()
    async with front(simulated) as factory:
        with Feeder(simulated, PICTURES):
            async with ThetaV(factory, QUICK, once=True) as camera:
                units = camera.access_units()
                assert (await anext(units)).keyframe
                simulated.unplug()
                # A USB/IP server that hangs up may be heard before the last it said.
                with pytest.raises(ThetaGone, match=r"left the bus|connection to the USB/IP server .* broke"):
                    await asyncio.wait_for(exhaust(units), 30)


async def test_asked_once_a_camera_without_pictures_is_not_left_in_still_mode() -> None:
    simulated = SimulatedThetaV()
    with pytest.raises(ThetaTimeout, match="sends no pictures"):
        async with ThetaV(lambda: AttachedTransport(simulated), QUICK, once=True) as camera:
            await asyncio.wait_for(exhaust(camera.access_units()), 30)
    assert simulated.composition is Composition.LIVE


async def exhaust(units: AsyncIterator[AccessUnit]) -> None:
    async for _ in units:
        pass


async def test_nobody_listening_is_an_error_in_words() -> None:
    with UsbIpServer(SimulatedThetaV()) as server:
        port = server.port
    with pytest.raises(ThetaNotFound, match="start it, or check the address"):
        async with ThetaV(lambda: UsbIpTransport("127.0.0.1", port), once=True):
            pass
