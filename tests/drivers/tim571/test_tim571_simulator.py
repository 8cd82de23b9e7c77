"""The simulated lidar answers, refuses and scans as the device does, on the wire."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

from drivers.tim571.codec import commands, scandata
from drivers.tim571.codec.access import Level
from drivers.tim571.codec.commands import OutputContent
from drivers.tim571.codec.dialect import Dialect, frame
from drivers.tim571.codec.faults import Fault
from drivers.tim571.geometry import BEAM_YAW, BEAMS
from drivers.tim571.simulator.behaviour import DeviceSettings
from drivers.tim571.simulator.faults import FaultPlan, parse_plan, strike
from drivers.tim571.simulator.recording import read_scans
from drivers.tim571.simulator.scanner import empty_room, sample
from drivers.tim571.simulator.server import Tim571Simulator

Connect = Callable[[int, Dialect], Awaitable[Any]]
QUICK = DeviceSettings(scan_rate_hz=100.0)


async def test_the_start_up_of_the_vendors_driver_gets_a_real_tim5xxs_answers(
    command_pairs: list[dict[str, Any]], terminal: Connect
) -> None:
    pairs = [pair for pair in command_pairs if "TiM5xx" in pair["device"]]
    async with Tim571Simulator(dialect="b") as simulator:
        client = await terminal(simulator.port, Dialect.B)
        for pair in pairs:
            answer = await client.ask(bytes.fromhex(pair["request"]))
            assert answer.frame.hex() == pair["answer"], pair["request_text"]
        scan = scandata.decode(await client.next("sSN"))
        assert [len(scan.channel(tag).samples) for tag in ("DIST1", "RSSI1")] == [BEAMS, BEAMS]  # type: ignore[union-attr]
    assert len(pairs) == 15


async def test_the_start_up_of_the_vendors_driver_in_text(terminal: Connect) -> None:
    dialogue = [
        (b"sRN SCdevicestate", b"sRA SCdevicestate 1"),
        (b"sMN SetAccessMode 3 F4724744", b"sAN SetAccessMode 1"),
        (b"sWN EIHstCola 0", b"sWA EIHstCola"),
        (b"sRN FirmwareVersion", b"sRA FirmwareVersion 5 V2.60"),
        (b"sRN SCdevicestate", b"sRA SCdevicestate 0"),
        (b"sRN ODoprh", b"sRA ODoprh 68C"),
        (b"sRN ODpwrc", b"sRA ODpwrc 79"),
        (b"sRN LocationName", b"sRA LocationName B not defined"),
        (b"sRN LMPoutputRange", b"sRA LMPoutputRange 1 D05 FFF92230 225510"),
        (b"sWN LMPoutputRange 1 D05 FFF92230 225510", b"sWA LMPoutputRange"),
        (b"sWN LMDscandatacfg 01 00 1 1 0 00 00 0 0 0 1 +1", b"sWA LMDscandatacfg"),
        (b"sRN LMDscandatacfg", b"sRA LMDscandatacfg 1 0 1 1 0 0 0 0 0 0 1 1"),
        (b"sMN LMCstartmeas", b"sAN LMCstartmeas 0"),
        (b"sMN Run", b"sAN Run 1"),
        (b"sEN LMDscandata 1", b"sEA LMDscandata 1"),
        (b"sRI0", b"sRA 0 6 TiM57x E V2.60-12.05.20"),
    ]
    async with Tim571Simulator(dialect="a") as simulator:
        client = await terminal(simulator.port, Dialect.A)
        for request, answer in dialogue:
            assert (await client.ask(frame(Dialect.A, request))).frame == frame(Dialect.A, answer)
        scan = scandata.decode(await client.next("sSN"))
        assert [row.tag for row in scan.channels16] == ["DIST1", "RSSI1"]


async def test_it_is_silent_in_the_wrong_dialect(dialect: Dialect, terminal: Connect) -> None:
    async with Tim571Simulator(dialect=dialect) as simulator:
        client = await terminal(simulator.port, dialect.other)
        client.writer.write(commands.read(dialect.other, "FirmwareVersion").to_wire())
        assert await client.silent()
        right = await terminal(simulator.port, dialect)
        assert (await right.ask(commands.read(dialect, "FirmwareVersion"))).kind == "sRA"


async def test_a_change_of_dialect_needs_a_login_and_is_answered_in_the_old_one(
    dialect: Dialect, terminal: Connect
) -> None:
    async with Tim571Simulator(dialect=dialect) as simulator:
        client = await terminal(simulator.port, dialect)
        change = commands.write(dialect, "EIHstCola", int(dialect is Dialect.A))
        assert commands.values_of(await client.ask(change)) == (Fault.WRITE_ACCESS_DENIED,)
        await client.login()
        assert (await client.ask(change)).kind == "sWA"
        client.writer.write(commands.read(dialect, "FirmwareVersion").to_wire())
        assert await client.silent()
        again = await terminal(simulator.port, dialect.other)
        assert (await again.ask(commands.read(dialect.other, "FirmwareVersion"))).kind == "sRA"


@pytest.mark.parametrize(
    ("request_text", "level", "fault"),
    [
        (b"sRN Nonsense", Level.RUN, Fault.UNKNOWN_VARIABLE),
        (b"sMN Nonsense", Level.RUN, Fault.UNKNOWN_METHOD),
        (b"sEN Nonsense 1", Level.RUN, Fault.UNKNOWN_EVENT),
        (b"sRA FirmwareVersion", Level.RUN, Fault.BUFFER_UNDERFLOW),
        (b"sWN FirmwareVersion 1 A", Level.SERVICE, Fault.WRITE_ACCESS_DENIED),
        (b"sWN LMDscandatacfg 1 0 1 0 0 0 0 0 0 0 0 1", Level.RUN, Fault.WRITE_ACCESS_DENIED),
        (b"sWN LMDscandatacfg 1 0 1 0 0 0 0 0 0 0 0 1", Level.MAINTENANCE, Fault.WRITE_ACCESS_DENIED),
        (b"sWN LMDscandatacfg 1 0 1 0 0 0 0 0 0 0 0", Level.AUTHORISED_CLIENT, Fault.BUFFER_UNDERFLOW),
        (b"sWN LMDscandatacfg 1 0 1 0 0 0 0 0 0 0 0 1 1", Level.AUTHORISED_CLIENT, Fault.BUFFER_OVERFLOW),
        (b"sWN LMDscandatacfg 1 0 2 0 0 0 0 0 0 0 0 1", Level.AUTHORISED_CLIENT, Fault.LOCAL_CONDITION_FAILED),
        (b"sWN LMDscandatacfg 1 0 1 0 0 0 0 0 0 0 0 0", Level.AUTHORISED_CLIENT, Fault.LOCAL_CONDITION_FAILED),
        (b"sWN LMPoutputRange 1 D05 225510 FFF92230", Level.AUTHORISED_CLIENT, Fault.LOCAL_CONDITION_FAILED),
        (b"sWN LMPoutputRange 1 D05 +0 +2250001", Level.AUTHORISED_CLIENT, Fault.LOCAL_CONDITION_FAILED),
        (b"sWN LMPoutputRange 1 682 FFF92230 225510", Level.AUTHORISED_CLIENT, Fault.LOCAL_CONDITION_FAILED),
        (b"sWN LMPscancfg 5DC 1 D05 FFF92230 225510", Level.SERVICE, Fault.WRITE_ACCESS_DENIED),
        (b"sWN LocationName 11 12345678901234567", Level.MAINTENANCE, Fault.LOCAL_CONDITION_FAILED),
        (b"sMN LMCstopmeas", Level.MAINTENANCE, Fault.METHOD_ACCESS_DENIED),
        (b"sMN mSCreboot", Level.RUN, Fault.METHOD_ACCESS_DENIED),
    ],
)
async def test_it_refuses_with_the_devices_fault(
    request_text: bytes, level: Level, fault: Fault, terminal: Connect
) -> None:
    async with Tim571Simulator(dialect="a") as simulator:
        client = await terminal(simulator.port, Dialect.A)
        if level is not Level.RUN:
            await client.login(level)
        answer = await client.ask(frame(Dialect.A, request_text))
        assert (answer.kind, commands.values_of(answer)) == ("sFA", (fault,))


@pytest.mark.parametrize("login", [b"sMN SetAccessMode 3 F4724745", b"sMN SetAccessMode 9 F4724744"])
async def test_a_wrong_password_or_level_is_not_let_in(login: bytes, terminal: Connect) -> None:
    async with Tim571Simulator(dialect="a") as simulator:
        client = await terminal(simulator.port, Dialect.A)
        assert commands.values_of(await client.ask(frame(Dialect.A, login))) == (0,)
        assert (await client.ask(b"\x02sMN LMCstopmeas\x03")).kind == "sFA"


async def test_the_laser_is_off_while_somebody_is_logged_in(terminal: Connect) -> None:
    async with Tim571Simulator(dialect="a", settings=QUICK) as simulator:
        viewer, owner = [await terminal(simulator.port, Dialect.A) for _ in range(2)]
        await viewer.ask(b"\x02sEN LMDscandata 1\x03")
        await viewer.next("sSN")
        await owner.login()
        assert (await owner.ask(b"\x02sRN SCdevicestate\x03")).body == b"0"
        while not await viewer.silent():
            pass
        assert (await owner.ask(b"\x02sMN Run\x03")).body == b"1"
        await viewer.next("sSN")
        assert (await owner.ask(b"\x02sRN SCdevicestate\x03")).body == b"1"


async def test_scans_come_to_those_who_subscribed(dialect: Dialect, terminal: Connect) -> None:
    async with Tim571Simulator(dialect=dialect, settings=QUICK) as simulator:
        one, two, none = [await terminal(simulator.port, dialect) for _ in range(3)]
        await one.ask(commands.subscribe(dialect, "LMDscandata"))
        await two.ask(commands.subscribe(dialect, "LMDscandatamon"))
        assert (await one.next("sSN")).name == "LMDscandata"
        assert (await two.next("sSN")).name == "LMDscandatamon"
        assert await none.silent()
        await one.ask(commands.subscribe(dialect, "LMDscandata", on=False))
        assert await one.silent()


async def test_counters_and_ticks_advance_with_the_revolutions(terminal: Connect) -> None:
    settings = DeviceSettings(tick_at_power_on_us=(1 << 32) - 300_000)
    async with Tim571Simulator(dialect="b", settings=settings) as simulator:
        client = await terminal(simulator.port, Dialect.B)
        await client.ask(commands.subscribe(Dialect.B, "LMDscandata"))
        scans = [scandata.decode(await client.next("sSN")) for _ in range(8)]
    for earlier, later in pairwise(scans):
        assert later.scan_counter - earlier.scan_counter == 1
        assert later.scan_counter - later.telegram_counter == 2
        assert 66_496 <= (later.scan_tick_us - earlier.scan_tick_us) % (1 << 32) <= 66_781
    assert scans[-1].scan_tick_us < scans[0].scan_tick_us
    assert all(7_000 < (s.transmit_tick_us - s.scan_tick_us) % (1 << 32) < 60_000 for s in scans)


@pytest.mark.parametrize(
    ("output", "tags16", "tags8"),
    [
        (OutputContent(), ["DIST1"], []),
        (OutputContent(rssi=True), ["DIST1"], ["RSSI1"]),
        (OutputContent(rssi=True, rssi_bits=16, name=False), ["DIST1", "RSSI1"], []),
        (OutputContent(every=3), ["DIST1"], []),
    ],
)
async def test_the_output_content_is_honoured(
    dialect: Dialect, output: OutputContent, tags16: list[str], tags8: list[str], terminal: Connect
) -> None:
    async with Tim571Simulator(dialect=dialect, settings=QUICK) as simulator:
        client = await terminal(simulator.port, dialect)
        await client.login()
        assert (await client.ask(commands.write(dialect, "LMDscandatacfg", *output.to_values()))).kind == "sWA"
        await client.ask(commands.invoke(dialect, "Run"))
        await client.ask(commands.subscribe(dialect, "LMDscandata"))
        first, second = [scandata.decode(await client.next("sSN")) for _ in range(2)]
    assert [row.tag for row in first.channels16] == tags16
    assert [row.tag for row in first.channels8] == tags8
    assert second.scan_counter - first.scan_counter == output.every
    assert first.name == ("not defined" if output.name else None)


async def test_the_output_range_cuts_the_revolution(terminal: Connect) -> None:
    async with Tim571Simulator(dialect="a", settings=QUICK) as simulator:
        client = await terminal(simulator.port, Dialect.A)
        await client.login()
        await client.ask(commands.write(Dialect.A, "LMPoutputRange", 1, 3333, 0, 1_800_000))
        await client.ask(b"\x02sMN Run\x03")
        await client.ask(b"\x02sEN LMDscandata 1\x03")
        (distance,) = scandata.decode(await client.next("sSN")).channels16
    assert (len(distance.samples), distance.start_1e4deg) == (541, 0)


async def test_polling_gives_zeros_before_the_first_scan_and_the_newest_afterwards(
    dialect: Dialect, terminal: Connect, until: Any
) -> None:
    async with Tim571Simulator(dialect=dialect, settings=DeviceSettings(scan_rate_hz=2.0)) as simulator:
        client = await terminal(simulator.port, dialect)
        poll = commands.read(dialect, "LMDscandata")
        empty = await client.ask(poll)
        assert (empty.kind, scandata.decode(empty).channels16) == ("sRA", ())
        await until(lambda: simulator.newest is not None)
        before = simulator.newest
        one, two = [scandata.decode(await client.ask(poll)) for _ in range(2)]
        after = simulator.newest
    assert before.scan_counter <= one.scan_counter <= two.scan_counter <= after.scan_counter
    same = one.scan_counter == two.scan_counter
    assert np.array_equal(one.channels16[0].samples, two.channels16[0].samples) == same


async def test_it_is_silent_while_it_starts_up(terminal: Connect) -> None:
    async with Tim571Simulator(dialect="a", settings=DeviceSettings(startup_s=0.3)) as simulator:
        client = await terminal(simulator.port, Dialect.A)
        client.writer.write(b"\x02sRN SCdevicestate\x03")
        assert await client.silent()
        async with asyncio.timeout(5):
            while await client.silent(0.05):
                client.writer.write(b"\x02sRN SCdevicestate\x03")


async def test_power_off_forgets_what_was_not_saved(terminal: Connect) -> None:
    async with Tim571Simulator(dialect="a", settings=QUICK) as simulator:
        for save in (False, True):
            client = await terminal(simulator.port, Dialect.A)
            await client.login()
            await client.ask(b"\x02sWN LocationName 5 robot\x03")
            if save:
                assert (await client.ask(b"\x02sMN mEEwriteall\x03")).body == b"1"
            assert (await client.ask(b"\x02sMN mSCreboot\x03")).kind == "sAN"
            with pytest.raises((EOFError, ConnectionError)):
                await client.next()
            again = await terminal(simulator.port, Dialect.A)
            name = commands.values_of(await again.ask(b"\x02sRN LocationName\x03"))
            assert name == (("robot",) if save else ("not defined",))


async def test_unplugged_it_refuses_and_replugged_it_takes_connections_on_the_same_port(terminal: Connect) -> None:
    async with Tim571Simulator(dialect="a") as simulator:
        client = await terminal(simulator.port, Dialect.A)
        port = simulator.port
        await client.ask(b"\x02sRN SCdevicestate\x03")
        await simulator.unplug()
        with pytest.raises((EOFError, ConnectionError)):
            await client.next()
        with pytest.raises(ConnectionRefusedError):
            await terminal(port, Dialect.A)
        await simulator.replug()
        assert simulator.port == port
        await (await terminal(port, Dialect.A)).ask(b"\x02sRN SCdevicestate\x03")


async def test_a_client_that_does_not_read_costs_no_memory(terminal: Connect, until: Any) -> None:
    async with Tim571Simulator(dialect="a", settings=DeviceSettings(scan_rate_hz=1000.0)) as simulator:
        client = await terminal(simulator.port, Dialect.A)
        await client.ask(b"\x02sEN LMDscandata 1\x03")
        (connection,) = simulator._connections
        client.writer.transport.pause_reading()
        await until(connection.outbox.full)
        assert connection.unsent < 1 << 18


@pytest.mark.parametrize("name", ["tim561_cola_a.rec", "tim781s_cola_b.rec"])
async def test_a_recording_is_sent_as_recorded_and_starts_again(
    name: str, rec: Callable[[str], Path], terminal: Connect
) -> None:
    recorded = read_scans(rec(name))
    settings = DeviceSettings(scan_rate_hz=400.0)
    async with Tim571Simulator(replay=rec(name), settings=settings) as simulator:
        client = await terminal(simulator.port, recorded[0].dialect)
        await client.ask(commands.subscribe(recorded[0].dialect, "LMDscandata"))
        received = [(await client.next("s")).frame for _ in range(2 * len(recorded))]
    at = [scan.frame for scan in recorded].index(received[0])
    assert received == [recorded[(at + i) % len(recorded)].frame for i in range(len(received))]


@pytest.mark.parametrize("content", [b"", b"\x00" * 5, b"\x00" * 8 + b"\xff\x00\x00\x00abc", b"\x00" * 12])
def test_a_file_that_is_no_recording_is_refused_with_a_sentence(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.rec"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"x\.rec"):
        read_scans(path)


def test_noise_has_the_devices_sigma_and_is_seeded() -> None:
    distances, _ = empty_room(0)
    rng = np.random.default_rng(1)
    millimetres = np.stack([sample(distances, None, rng, 0.020)[0] for _ in range(200)]).astype(float)
    seen = np.isfinite(distances)
    assert np.std(millimetres[:, seen] - 1000 * distances[seen]) == pytest.approx(20, rel=0.02)
    one, two = [sample(distances, None, np.random.default_rng((3, 4)), 0.020)[0] for _ in range(2)]
    assert np.array_equal(one, two)


def test_what_is_out_of_range_is_no_echo_and_has_no_strength() -> None:
    distances = np.full(BEAMS, 2.0)
    distances[:6] = [np.inf, np.nan, -1.0, 0.0, 0.049, 25.1]
    millimetres, rssi = sample(distances, np.full(BEAMS, 300.0), np.random.default_rng(0), 0.02)
    assert millimetres[:6].tolist() == rssi[:6].tolist() == [0] * 6
    assert (millimetres[6:] >= 16).all()
    assert (rssi[6:] == 254).all()


def test_beams_lie_a_third_of_a_degree_apart() -> None:
    assert np.degrees(BEAM_YAW[[0, 405, -1]]).tolist() == pytest.approx([-135, 0, 135], abs=1e-5)
    assert not BEAM_YAW.flags.writeable


def test_faults_come_from_the_seed_and_in_the_planned_measure() -> None:
    plan = FaultPlan(drop=0.2, corrupt=0.3, split=0.4)
    data = bytes(range(100))
    fates = [strike(plan, chance, data) for chance in [Random(5)] for _ in range(4000)]
    assert fates == [strike(plan, chance, data) for chance in [Random(5)] for _ in range(4000)]
    dropped = sum(not fate for fate in fates)
    corrupted = sum(b"".join(p.data for p in fate) != data for fate in fates if fate)
    split = sum(len(fate) > 1 for fate in fates)
    assert dropped / 4000 == pytest.approx(0.2, abs=0.03)
    assert corrupted / (4000 - dropped) == pytest.approx(0.3, abs=0.03)
    assert split / (4000 - dropped) == pytest.approx(0.4, abs=0.04)
    assert [piece.data for piece in strike(FaultPlan(), Random(0), data)] == [data]


async def test_it_survives_hostile_clients(terminal: Connect) -> None:
    rng = Random(1)
    async with Tim571Simulator(dialect="b", settings=QUICK) as simulator:
        client = await terminal(simulator.port, Dialect.B)
        for _ in range(50):
            client.writer.write(frame(Dialect.B, b"sMN SetAccessMode" + rng.randbytes(rng.randrange(9))))
            client.writer.write(rng.randbytes(rng.randrange(200)))
        good = commands.read(Dialect.B, "FirmwareVersion")
        client.writer.write(good.to_wire())
        async with asyncio.timeout(5):
            while (await client.next()).name != "FirmwareVersion":
                pass


def test_a_held_back_frame_keeps_its_bytes() -> None:
    (piece,) = strike(FaultPlan(delay=1.0, delay_s=0.5), Random(2), b"abc")
    assert piece.data == b"abc"
    assert 0 < piece.pause_s < 0.5


async def test_it_serves_alone_until_cancelled(terminal: Connect, until: Any) -> None:
    simulator = Tim571Simulator(dialect="b")
    alone = asyncio.create_task(simulator.serve_forever())
    await until(lambda: simulator.newest is not None)
    client = await terminal(simulator.port, Dialect.B)
    assert (await client.ask(commands.read(Dialect.B, "SCdevicestate"))).body == b"\x01"
    with pytest.raises(OSError, match="in use"):
        await Tim571Simulator(port=simulator.port).serve_forever()
    alone.cancel()
    with pytest.raises(asyncio.CancelledError):
        await alone
    with pytest.raises(ConnectionRefusedError):
        await terminal(simulator.port, Dialect.B)


async def test_a_world_that_fails_is_not_hidden(terminal: Connect, until: Any) -> None:
    def broken_world(_stamp_ns: int) -> Any:
        raise ZeroDivisionError("the world ends here")

    simulator = Tim571Simulator(broken_world)
    alone = asyncio.create_task(simulator.serve_forever())
    await until(lambda: simulator.newest is not None)
    client = await terminal(simulator.port, Dialect.A)
    client.writer.write(b"\x02sEN LMDscandata 1\x03")
    with pytest.raises(ZeroDivisionError, match="the world ends here"):
        async with asyncio.timeout(5):
            await alone


def test_a_fault_plan_is_read_from_a_line_or_refused_with_a_sentence() -> None:
    plan = parse_plan("drop=0.01, bytes=5e-5,jitter_s=0.0001,stall=5+2,power=20+3")
    wanted = FaultPlan(drop=0.01, byte_error=5e-5, jitter_s=1e-4, stall=(5, 2), power_cycle=(20, 3))
    assert plan == wanted
    assert parse_plan("") == FaultPlan()
    for wrong in ("fire=1", "drop", "drop=2", "drop=nan", "stall=5", "unplug=5+0", "jitter_s=-1", "power=inf+1"):
        with pytest.raises(ValueError, match="for example"):
            parse_plan(wrong)


def test_bytes_are_hit_in_the_planned_measure() -> None:
    plan, chance = FaultPlan(byte_error=0.01), Random(3)
    data = bytes(1000)
    hit = [sum(map(bool, b"".join(piece.data for piece in strike(plan, chance, data)))) for _ in range(200)]
    assert sum(hit) / 200_000 == pytest.approx(0.01, rel=0.15)


async def test_a_planned_power_cycle_begins_anew(terminal: Connect, until: Any) -> None:
    faults = FaultPlan(power_cycle=(0.8, 0.05))
    async with Tim571Simulator(dialect="a", settings=QUICK, faults=faults) as simulator:
        client = await terminal(simulator.port, Dialect.A)
        await until(lambda: simulator.newest is not None and simulator.newest.tick_us > 500_000)
        with pytest.raises((EOFError, ConnectionError)):
            await client.next()
        await until(lambda: simulator.newest is not None and simulator.newest.tick_us < 500_000)


async def test_the_time_block_is_sent_where_it_is_configured_and_the_device_has_it(terminal: Connect) -> None:
    for has_it in (True, False):
        settings = DeviceSettings(scan_rate_hz=100.0, time_block=has_it)
        async with Tim571Simulator(dialect="b", settings=settings) as simulator:
            client = await terminal(simulator.port, Dialect.B)
            await client.login()
            wanted = OutputContent(time=True)
            await client.ask(commands.write(Dialect.B, "LMDscandatacfg", *wanted.to_values()))
            await client.ask(commands.invoke(Dialect.B, "Run"))
            await client.ask(commands.subscribe(Dialect.B, "LMDscandata"))
            scan = scandata.decode(await client.next("sSN"))
        assert (scan.clock is not None) == has_it
        if scan.clock is not None:
            since_us = 1_000_000 * scan.clock.second + scan.clock.microsecond
            assert (scan.clock.year, scan.clock.microsecond % 1000) == (1970, 0)
            assert 1_000 <= since_us - scan.scan_tick_us <= 4_500


async def test_answers_take_as_long_as_a_real_device_takes(terminal: Connect) -> None:
    async with Tim571Simulator(dialect="b") as simulator:
        client = await terminal(simulator.port, Dialect.B)
        for request, least_s in (
            (commands.read(Dialect.B, "FirmwareVersion"), 0.0011),
            (commands.invoke(Dialect.B, "SetAccessMode", 3, 0xF4724744), 0.0054),
            (commands.invoke(Dialect.B, "Run"), 0.0050),
        ):
            began_s = time.monotonic()
            await client.ask(request)
            assert least_s <= time.monotonic() - began_s < least_s + 0.5


async def test_it_tells_in_words_who_asks_what(terminal: Connect) -> None:
    news: list[str] = []
    async with Tim571Simulator(dialect="a", on_news=news.append) as simulator:
        client = await terminal(simulator.port, Dialect.A)
        for request in (
            b"sRN SCdevicestate", b"sRI0", b"sMN SetAccessMode 3 F4724745", b"sWN LMPoutputRange 1 D05 0 225510",
            b"sRN LMPscancfg", b"sRN Nonsense", b"sEN LMDscandata 1", b"sRN LMDscandata",
        ):  # fmt: skip
            await client.ask(frame(Dialect.A, request))
    told = [sentence.split(" ", 1)[1] for sentence in news]
    assert told[:9] == [
        "connects",
        "reads SCdevicestate: ready",
        "reads index 0: TiM57x V2.60-12.05.20",
        "calls SetAccessMode: not done",
        "writes LMPoutputRange: refused, the variable is read-only or needs a login first (sFA A)",
        "reads LMPscancfg: 15 Hz, -135 to 135 degrees, a beam every 0.333",
        "reads Nonsense: refused, it does not know the variable (sFA 3)",
        "subscribes to LMDscandata: on",
        "reads LMDscandata: a scan",
    ]
    assert not any("F4724745" in sentence for sentence in news)
