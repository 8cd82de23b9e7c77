"""The driver against the simulated lidar: every way a link begins, breaks and comes back."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from itertools import pairwise
from random import Random
from typing import Any

import numpy as np
import pytest

from drivers.tim571 import Scan, TcpTransport, TiM571, Tim571Simulator, TimConfig, TimError, probe
from drivers.tim571.codec.answers import DeviceState
from drivers.tim571.codec.commands import OutputContent
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.scandata import ScanData
from drivers.tim571.codec.telegram import Receiver
from drivers.tim571.device.continuity import Continuity, Step
from drivers.tim571.device.scan import scan_of
from drivers.tim571.device.stats import LinkState
from drivers.tim571.errors import TimRefusedError, TimTimeoutError, TimUnreachableError
from drivers.tim571.geometry import BEAM_YAW, BEAMS
from drivers.tim571.simulator.behaviour import DeviceSettings
from drivers.tim571.simulator.faults import FaultPlan

Until = Callable[[Callable[[], bool]], Awaitable[None]]
QUICK = DeviceSettings(scan_rate_hz=100.0)
# Impatient, so that tests needn't wait; the defaults have the reasons.
HASTY = TimConfig(
    answer_timeout_s=0.5,
    dialect_timeout_s=0.15,
    first_scan_timeout_s=0.6,
    idle_timeout_s=0.25,
    backoff_first_s=0.02,
    backoff_max_s=0.1,
)


def lidar_at(simulator: Tim571Simulator, config: TimConfig = HASTY, **more: Any) -> TiM571:
    return TiM571(TcpTransport(simulator.host, simulator.port), config, **more)


async def take(lidar: TiM571, count: int) -> list[Scan]:
    scans: list[Scan] = []
    async with asyncio.timeout(10):
        async for scan in lidar.scans():
            scans.append(scan)
            if len(scans) == count:
                return scans
    raise AssertionError("the scans ended")


async def test_scans_come_in_whichever_dialect_the_device_speaks(dialect: Dialect) -> None:
    async with Tim571Simulator(dialect=dialect) as simulator, lidar_at(simulator) as lidar:
        scans = await take(lidar, 10)
        stats = lidar.stats
    assert stats.state is LinkState.STREAMING
    assert stats.identity is not None
    assert (stats.identity.dialect, stats.identity.type) == (dialect, "TiM57x")
    assert (stats.identity.firmware, stats.identity.serial) == ("V2.60", "17461662")
    assert stats.identity.state is DeviceState.READY
    assert stats.identity.operating_hours == pytest.approx(167.6)
    assert (stats.lost, stats.damaged, stats.dropped, stats.reconnects) == (0, 0, 0, 0)
    assert stats.rate_hz == pytest.approx(15, rel=0.2)
    assert [later.scan_counter - earlier.scan_counter for earlier, later in pairwise(scans)] == [1] * 9
    for scan in scans:
        assert scan.ranges.shape == scan.yaw.shape == scan.codes.shape == (BEAMS,)
        assert scan.ranges.dtype == scan.yaw.dtype == np.float32
        assert np.array_equal(np.isnan(scan.ranges), scan.codes < 16)
        assert np.isnan(scan.ranges).any()
        assert scan.rssi is None
        assert scan.device_ok


async def test_a_plain_start_changes_nothing_and_logs_nobody_in() -> None:
    async with Tim571Simulator() as simulator, lidar_at(simulator) as lidar:
        await take(lidar, 1)
        kinds = {(request.kind, request.name) for request in simulator.requests}
    assert {kind for kind, _ in kinds} == {"sRN", "sEN"}
    assert ("sEN", "LMDscandata") in kinds


async def test_the_stamp_is_the_last_beam_on_our_clock() -> None:
    stamps: dict[int, int] = {}
    async with Tim571Simulator(dialect="b") as simulator, lidar_at(simulator) as lidar:
        async with asyncio.timeout(10):
            async for scan in lidar.scans():
                assert simulator.newest is not None
                stamps[simulator.newest.end_ns] = scan.stamp_ns - simulator.newest.end_ns
                if len(stamps) == 15:
                    break
    # The median shrugs off a busy machine; the arrival alone would be 7 ms late.
    assert abs(float(np.median(list(stamps.values())))) < 3e6


async def test_the_world_is_seen_where_it_is() -> None:
    world = np.full(BEAMS, np.inf)
    world[np.abs(BEAM_YAW - 1.0) < 0.1] = 2.5

    async with (
        Tim571Simulator(lambda _stamp_ns: (world, None)) as simulator,
        lidar_at(simulator) as lidar,
    ):
        (scan,) = await take(lidar, 1)
    seen = np.isfinite(scan.ranges)
    assert np.array_equal(seen, np.isfinite(world))
    assert scan.yaw[seen].mean() == pytest.approx(1.0, abs=0.01)
    assert scan.ranges[seen] == pytest.approx(2.5, abs=0.12)


@pytest.mark.parametrize("bits", [8, 16])
async def test_signal_strength_is_switched_on_by_login_and_the_laser_back_on(dialect: Dialect, bits: int) -> None:
    config = replace(HASTY, output=OutputContent(rssi=True, rssi_bits=bits))
    async with Tim571Simulator(dialect=dialect) as simulator:
        for expect_login in (True, False):
            simulator.requests.clear()
            async with lidar_at(simulator, config) as lidar:
                (scan,) = await take(lidar, 1)
            assert scan.rssi is not None
            assert np.array_equal(scan.rssi == 0, np.isnan(scan.ranges))
            assert (np.nanmax(scan.rssi) > 255) == (bits == 16)
            assert any(r.name == "SetAccessMode" for r in simulator.requests) == expect_login


async def test_it_comes_back_after_the_plug_was_pulled(dialect: Dialect, until: Until) -> None:
    async with Tim571Simulator(dialect=dialect) as simulator, lidar_at(simulator) as lidar:
        await take(lidar, 3)
        await simulator.unplug()
        await until(lambda: lidar.stats.state is LinkState.BACKOFF and "refuses" in lidar.stats.detail)
        assert "Trying again" in lidar.stats.detail
        missed = simulator.newest.scan_counter + 3  # type: ignore[union-attr]
        await until(lambda: simulator.newest.scan_counter > missed)  # type: ignore[union-attr]
        await simulator.replug()
        await take(lidar, 3)
        stats = lidar.stats
    assert (stats.reconnects, stats.restarts) == (1, 0)
    assert stats.lost >= 3
    assert stats.state is LinkState.STREAMING


async def test_it_notices_that_the_device_was_switched_off_and_on(until: Until) -> None:
    settings = DeviceSettings(tick_at_power_on_us=0)
    async with Tim571Simulator(settings=settings) as simulator, lidar_at(simulator) as lidar:
        simulator._power_on_s -= 60.0  # a device that has run for a minute
        await take(lidar, 3)
        await simulator.power_cycle()
        await until(lambda: lidar.stats.restarts == 1)
        await take(lidar, 3)
        assert lidar.stats.lost == 0


async def test_a_restarted_stream_on_the_same_connection_is_set_up_anew(until: Until) -> None:
    async with Tim571Simulator(settings=QUICK) as simulator, lidar_at(simulator) as lidar:
        await take(lidar, 3)
        simulator.requests.clear()
        simulator._power_on_s -= 100.0
        await until(lambda: any(r.kind == "sEN" for r in simulator.requests))
        assert (lidar.stats.restarts, lidar.stats.reconnects) == (1, 0)


async def test_the_ticks_may_wrap() -> None:
    settings = DeviceSettings(tick_at_power_on_us=(1 << 32) - 400_000, scan_rate_hz=50.0)
    async with Tim571Simulator(settings=settings) as simulator, lidar_at(simulator) as lidar:
        scans = await take(lidar, 40)
        assert (lidar.stats.restarts, lidar.stats.lost) == (0, 0)
    assert scans[-1].device_time_us < scans[0].device_time_us
    assert all(later.stamp_ns > earlier.stamp_ns for earlier, later in pairwise(scans))


async def test_a_stalled_link_is_noticed_and_opened_again(until: Until) -> None:
    faults = FaultPlan(stall=(0.4, 0.9))
    async with Tim571Simulator(faults=faults) as simulator, lidar_at(simulator) as lidar:
        await take(lidar, 2)
        await until(lambda: lidar.stats.state is not LinkState.STREAMING)
        details = set()
        while lidar.stats.state is not LinkState.STREAMING:
            details.add(lidar.stats.detail)
            await asyncio.sleep(0.005)
        await take(lidar, 2)
        assert lidar.stats.reconnects >= 1
    assert any("stopped sending scans" in detail for detail in details)
    assert any("stays silent in CoLa-A and CoLa-B" in detail for detail in details)


async def test_a_planned_unplug_is_survived(until: Until) -> None:
    faults = FaultPlan(unplug=(0.3, 0.2))
    async with Tim571Simulator(faults=faults) as simulator, lidar_at(simulator) as lidar:
        await until(lambda: lidar.stats.reconnects == 1)
        await take(lidar, 2)


@pytest.mark.parametrize("seed", range(2))
async def test_damage_on_the_way_is_counted_and_the_rest_delivered(dialect: Dialect, seed: int, until: Until) -> None:
    faults = FaultPlan(drop=0.02, corrupt=0.05, split=0.5)
    settings = DeviceSettings(scan_rate_hz=200.0)
    patient = TimConfig(answer_timeout_s=0.3, dialect_timeout_s=0.2, backoff_first_s=0.01, backoff_max_s=0.02)
    async with (
        Tim571Simulator(dialect=dialect, faults=faults, settings=settings, seed=seed) as simulator,
        lidar_at(simulator, patient) as lidar,
    ):
        await until(lambda: lidar.stats.received > 120)
        stats = lidar.stats
    # CoLa-A has no checksum: a changed digit there is a wrong sample, which nothing can tell.
    assert stats.damaged > 0
    assert stats.lost > 0


async def test_a_slow_consumer_gets_the_newest_and_the_rest_is_counted(until: Until) -> None:
    async with Tim571Simulator(settings=QUICK) as simulator, lidar_at(simulator) as lidar:
        stream = lidar.scans()
        first = await anext(stream)
        await until(lambda: lidar.stats.received >= 50)
        kept = [await anext(stream) for _ in range(lidar.config.queued_scans)]
        stats = lidar.stats
        assert stats.dropped >= 50 - 1 - 2 * lidar.config.queued_scans
        assert kept[0].scan_counter - first.scan_counter > 30
        assert lidar.latest is not None
        await stream.aclose()  # type: ignore[attr-defined]


async def test_two_consumers_each_get_every_scan() -> None:
    async with Tim571Simulator() as simulator, lidar_at(simulator) as lidar:
        one, two = await asyncio.gather(take(lidar, 5), take(lidar, 5))
    assert [scan.scan_counter for scan in one] == [scan.scan_counter for scan in two]


async def test_the_recorder_gets_every_frame_exactly_as_received(dialect: Dialect) -> None:
    class Tapped(TcpTransport):
        async def read(self) -> tuple[int, bytes]:
            stamp_ns, data = await super().read()
            wire.append(data)
            return stamp_ns, data

    wire: list[bytes] = []
    frames: list[tuple[int, bytes]] = []
    config = replace(HASTY, dialect=dialect)
    async with Tim571Simulator(dialect=dialect) as simulator:
        tapped = Tapped(simulator.host, simulator.port)
        async with TiM571(tapped, config, lambda stamp_ns, frame: frames.append((stamp_ns, frame))) as lidar:
            scans = await take(lidar, 3)
    assert b"".join(frame for _, frame in frames) == b"".join(wire)
    assert [stamp for stamp, _ in frames] == sorted(stamp for stamp, _ in frames)
    assert {(scan.arrival_ns, scan.frame) for scan in scans} <= set(frames)


async def test_closing_ends_the_scans_and_stops_the_device_sending(until: Until) -> None:
    async with Tim571Simulator() as simulator:
        async with lidar_at(simulator) as lidar:
            await take(lidar, 1)
            consumer = asyncio.create_task(take(lidar, 10_000))
            await asyncio.sleep(0)
        with pytest.raises(AssertionError, match="the scans ended"):
            await consumer
        assert lidar.stats.state is LinkState.CLOSED
        assert (simulator.requests[-1].name, simulator.requests[-1].body) == ("LMDscandata", b"0")
        await until(lambda: simulator.clients == 0)


async def test_a_probe_tells_who_is_there(dialect: Dialect) -> None:
    async with Tim571Simulator(dialect=dialect) as simulator:
        report = await probe(TcpTransport(simulator.host, simulator.port), HASTY, seconds=0.3)
    assert report.stats.identity is not None
    assert report.stats.identity.firmware == "V2.60"
    assert report.stats.received >= 4
    assert report.scan.ranges.shape == (BEAMS,)


def free_port() -> int:
    with socket.socket() as probe_socket:
        probe_socket.bind(("127.0.0.1", 0))
        port: int = probe_socket.getsockname()[1]
        return port


async def test_a_probe_of_a_closed_port_says_so() -> None:
    port = free_port()
    with pytest.raises(TimUnreachableError, match=f"TiM571 at 127.0.0.1:{port} refuses the connection"):
        await probe(TcpTransport("127.0.0.1", port), HASTY)


async def test_a_probe_of_no_host_says_so() -> None:
    with pytest.raises(TimUnreachableError, match="not a known host name"):
        await probe(TcpTransport("no-such-lidar.invalid"), HASTY)


async def test_a_probe_without_a_route_says_so() -> None:
    with pytest.raises(TimError, match=r"TiM571 at 255\.255\.255\.255:2112 cannot be reached"):
        await probe(TcpTransport("255.255.255.255"), HASTY)


async def test_a_probe_of_a_silent_device_says_so() -> None:
    async with Tim571Simulator(settings=DeviceSettings(startup_s=60.0)) as simulator:
        with pytest.raises(TimTimeoutError, match="stays silent in CoLa-A and CoLa-B: after power-on"):
            await probe(TcpTransport(simulator.host, simulator.port), HASTY)


async def test_a_probe_in_the_wrong_dialect_says_so(dialect: Dialect) -> None:
    async with Tim571Simulator(dialect=dialect) as simulator:
        with pytest.raises(TimTimeoutError, match=f"stays silent in {dialect.other}"):
            await probe(
                TcpTransport(simulator.host, simulator.port),
                TimConfig(dialect=dialect.other, dialect_timeout_s=0.1),
            )


async def test_a_probe_of_a_lidar_whose_laser_is_off_says_why(terminal: Any) -> None:
    async with Tim571Simulator() as simulator:
        owner = await terminal(simulator.port, Dialect.A)
        await owner.login()
        with pytest.raises(TimTimeoutError, match="another program is logged in"):
            await probe(TcpTransport(simulator.host, simulator.port), HASTY)


async def test_a_refused_login_says_what_to_do_and_is_tried_again_if_we_insist(until: Until) -> None:
    settings = DeviceSettings(user_levels_enabled=False)
    config = replace(HASTY, output=OutputContent(rssi=True), insist=True)
    async with Tim571Simulator(settings=settings) as simulator:
        with pytest.raises(TimRefusedError, match="enable the level with SOPAS"):
            await probe(TcpTransport(simulator.host, simulator.port), config)
        async with lidar_at(simulator, config) as lidar:
            await until(lambda: lidar.stats.reconnects >= 2 and "refused the login" in lidar.stats.detail)


async def test_scans_come_although_the_login_is_refused_and_a_warning_says_what_to_do() -> None:
    settings = DeviceSettings(user_levels_enabled=False)
    config = replace(HASTY, output=OutputContent(rssi=True))
    async with Tim571Simulator(settings=settings) as simulator, lidar_at(simulator, config) as lidar:
        (scan,) = await take(lidar, 1)
        assert scan.rssi is None
        assert "enable the level with SOPAS" in lidar.stats.warning


async def test_the_password_is_never_shown() -> None:
    config = TimConfig(password="open sesame")  # noqa: S106
    assert "sesame" not in f"{config!r} {config}"
    async with Tim571Simulator() as simulator:
        wrong = replace(config, output=OutputContent(rssi=True), insist=True)
        with pytest.raises(TimRefusedError) as caught:
            await probe(TcpTransport(simulator.host, simulator.port), wrong)
        assert "sesame" not in repr(caught.value)
        assert not any(b"sesame" in request.frame for request in simulator.requests)


async def test_a_failed_device_is_reported_with_its_scans() -> None:
    async with Tim571Simulator() as simulator, lidar_at(simulator) as lidar:
        simulator.behaviour.failed = True
        (scan,) = await take(lidar, 1)
        assert not scan.device_ok
        assert lidar.stats.identity is not None
        assert lidar.stats.identity.state is DeviceState.ERROR


async def test_every_third_scan_is_not_a_loss() -> None:
    config = replace(HASTY, output=OutputContent(every=3))
    async with Tim571Simulator(settings=QUICK) as simulator, lidar_at(simulator, config) as lidar:
        scans = await take(lidar, 5)
        assert lidar.stats.lost == 0
    assert scans[-1].scan_counter - scans[-2].scan_counter == 3


async def test_recordings_are_played_through_the_whole_driver(rec: Any, until: Until) -> None:
    for name, missing in (("tim561_cola_a.rec", True), ("tim781s_cola_b.rec", False)):
        settings = DeviceSettings(scan_rate_hz=60.0)
        async with Tim571Simulator(replay=rec(name), settings=settings) as simulator, lidar_at(simulator) as lidar:
            await until(lambda lidar=lidar: lidar.stats.received >= 30)  # type: ignore[misc]
            assert lidar.latest is not None
            assert (lidar.latest.rssi is None) == (name == "tim561_cola_a.rec")
            assert (lidar.stats.lost > 0) == missing


class Babbler:
    """A transport on which anything may arrive."""

    name = "babbler"

    def __init__(self, rng: Random) -> None:
        self.rng = rng
        self.opened = 0

    async def open(self) -> None:
        self.opened += 1

    async def read(self) -> tuple[int, bytes]:
        await asyncio.sleep(0)
        if self.rng.random() < 0.05:
            return time.monotonic_ns(), b""
        words = [b"\x02", b"\x03", b"\x02\x02\x02\x02\x00\x00", b"sRA SCdevicestate 1", b"sFA", b"sSN LMDscandata "]
        return time.monotonic_ns(), b"".join(self.rng.choices([*words, self.rng.randbytes(9)], k=20))

    async def write(self, data: bytes) -> None:
        assert data

    async def close(self) -> None:
        pass


async def test_whatever_arrives_the_driver_goes_on(until: Until) -> None:
    babbler = Babbler(Random(3))
    config = TimConfig(dialect_timeout_s=0.05, answer_timeout_s=0.05, backoff_first_s=0.001, backoff_max_s=0.001)
    async with TiM571(babbler, config) as lidar:
        await until(lambda: babbler.opened > 100)
        assert lidar.stats.damaged > 100


async def test_a_maker_of_transports_is_asked_for_each_connection(until: Until) -> None:
    made: list[TcpTransport] = []
    async with Tim571Simulator() as simulator:

        def make() -> TcpTransport:
            made.append(TcpTransport(simulator.host, simulator.port))
            return made[-1]

        async with TiM571(make, HASTY) as lidar:
            await take(lidar, 1)
            await simulator.unplug()
            await simulator.replug()
            await until(lambda: lidar.stats.reconnects == 1)
    assert len(made) >= 2


async def test_an_error_of_the_recorder_is_not_swallowed() -> None:
    def full_disk(_stamp_ns: int, _frame: bytes) -> None:
        raise OSError(28, "No space left on device")

    async with Tim571Simulator() as simulator:
        lidar = lidar_at(simulator, on_telegram=full_disk)
        await lidar.__aenter__()
        with pytest.raises(OSError, match="No space") as caught:
            await take(lidar, 1)
        assert "No space left on device" in lidar.stats.detail
        await lidar.__aexit__(OSError, caught.value, None)


@pytest.mark.parametrize(
    ("scan_counter", "tick_us", "arrival_s", "step"),
    [
        (11, 66_667, 0.067, Step()),
        (14, 266_667, 0.267, Step(lost=3)),
        (10, 0, 0.001, Step(repeated=True)),
        (9, 0, 0.001, Step(repeated=True)),
        (0, 5_000_000, 0.067, Step(restarted=True)),
        (9, (1 << 32) - 5_000_000, 0.067, Step(restarted=True)),
        (11, 66_667, 1.5, Step()),
        (460, 30_000_000, 30.0, Step(lost=449)),
    ],
)
def test_what_happened_between_two_telegrams(scan_counter: int, tick_us: int, arrival_s: float, step: Step) -> None:
    for start, first_tick in ((10, 0), (65530, (1 << 32) - 30_000)):
        continuity = Continuity()
        assert continuity.observe(start, first_tick, 0) == Step()
        later = ((start + scan_counter - 10) % 65536, (first_tick + tick_us) % (1 << 32), round(arrival_s * 1e9))
        assert continuity.observe(*later) == step


def test_receiving_and_decoding_take_any_stream_without_raising() -> None:
    rng = Random(9)
    for dialect in Dialect:
        receiver = Receiver(dialect)
        for _ in range(500):
            receiver.feed(rng.randbytes(rng.randrange(300)))


@pytest.mark.parametrize("scale", [0.0, -1.0, float("inf"), float("nan"), 3e38])
def test_a_damaged_scale_gives_no_ranges_rather_than_wrong_ones(
    make_scan: Callable[..., ScanData], scale: float
) -> None:
    distance = make_scan().channels16[0]
    scan = scan_of(make_scan(channels16=(replace(distance, scale=scale),)), 0, 0, b"")
    assert not np.isinf(scan.ranges).any()
    assert not (scan.ranges <= 0).any()


def test_a_part_of_the_revolution_points_where_its_beams_do(make_scan: Callable[..., ScanData]) -> None:
    distance = make_scan(beams=541).channels16[0]
    part = scan_of(make_scan(channels16=(replace(distance, start_1e4deg=0),)), 0, 0, b"")
    assert np.array_equal(part.yaw, BEAM_YAW[135:676])
    coarse = scan_of(make_scan(channels16=(replace(distance, step_1e4deg=5000),)), 0, 0, b"")
    assert np.degrees(coarse.yaw[[0, -1]]).tolist() == pytest.approx([-135, 135])
