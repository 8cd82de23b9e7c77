"""Devices other than our simulator: emulators, sisters, and whatever answers on that port."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from drivers.tim571 import Scan, TcpTransport, TiM571, TimConfig
from drivers.tim571.codec import scandata
from drivers.tim571.codec.commands import OutputContent, OutputRange
from drivers.tim571.codec.dialect import Dialect, frame
from drivers.tim571.codec.scandata import Clock, ScanData
from drivers.tim571.codec.telegram import Receiver, Telegram
from drivers.tim571.device.stats import LinkState
from drivers.tim571.simulator.behaviour import DeviceSettings
from drivers.tim571.simulator.server import Tim571Simulator

Until = Callable[[Callable[[], bool]], Awaitable[None]]
HASTY = TimConfig(
    answer_timeout_s=0.1, dialect_timeout_s=0.1, first_scan_timeout_s=0.8, idle_timeout_s=0.3, backoff_first_s=0.02,
    backoff_max_s=0.1, wake_after_s=0.15,
)  # fmt: skip


@dataclass
class Stranger:
    """A device made of canned answers: request payload to answer payload; None is silence."""

    answers: dict[bytes, bytes | None] = field(default_factory=dict)
    otherwise: Callable[[bytes], bytes | None] = lambda _request: None
    scans: list[bytes] = field(default_factory=list)
    starts_with: bytes = b"sEN LMDscandata"
    one_client: bool = False
    heard: list[bytes] = field(default_factory=list)
    port: int = 0
    clients: int = 0

    @asynccontextmanager
    async def serving(self) -> AsyncIterator[Stranger]:
        server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        try:
            yield self
        finally:
            server.close()
            await server.wait_closed()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.clients += 1
        tasks: set[asyncio.Task[None]] = set()
        receivers = {dialect: Receiver(dialect) for dialect in Dialect}
        while data := await reader.read(4096):
            dialect = Dialect.B if data.startswith(b"\x02\x02") else Dialect.A
            for event in receivers[dialect].feed(data):
                if isinstance(event, Telegram):
                    payload = event.frame[8:-1] if dialect is Dialect.B else event.frame[1:-1]
                    self.heard.append(payload)
                    answer = self.answers.get(payload) or self.otherwise(payload)
                    if answer is not None:
                        writer.write(frame(dialect, answer))
                    if payload.startswith(self.starts_with) and not tasks:
                        tasks.add(asyncio.create_task(self._stream(writer)))
        for task in tasks:
            task.cancel()
        writer.close()

    async def _stream(self, writer: asyncio.StreamWriter) -> None:
        for scan in self.scans * 100:
            writer.write(scan)
            await asyncio.sleep(0.01)


def lidar_at(stranger: Stranger, config: TimConfig = HASTY) -> TiM571:
    return TiM571(TcpTransport("127.0.0.1", stranger.port), config)


async def take(lidar: TiM571, count: int) -> list[Scan]:
    scans: list[Scan] = []
    async with asyncio.timeout(10):
        async for scan in lidar.scans():
            scans.append(scan)
            if len(scans) == count:
                return scans
    raise AssertionError("the scans ended")


@pytest.fixture
def tim7xx_answers(command_pairs: list[dict[str, Any]]) -> dict[bytes, bytes | None]:
    """What a real TiM781S answered in CoLa-B, request by request; anything else it passes over."""
    return {
        bytes.fromhex(pair["request"])[8:-1]: bytes.fromhex(pair["answer"])[8:-1]
        for pair in command_pairs
        if "TiM781S" in pair["device"]
    }


def streams(make_scan: Callable[..., ScanData], dialect: Dialect, **changes: Any) -> list[bytes]:
    return [scandata.encode(make_scan(number, **changes), dialect).to_wire() for number in range(200)]


async def test_a_tim7xx_that_passes_over_unknown_requests_streams(
    tim7xx_answers: dict[bytes, bytes | None], cola_b_scans: list[bytes]
) -> None:
    async with Stranger(tim7xx_answers, scans=cola_b_scans).serving() as stranger, lidar_at(stranger) as lidar:
        scans = await take(lidar, 60)
        assert lidar.stats.identity is not None
        assert (lidar.stats.identity.firmware, lidar.stats.identity.name) == ("V3.13", "not defined")
        assert (lidar.stats.damaged, lidar.stats.reconnects) == (0, 0)
    assert all(scan.rssi is not None and len(scan.ranges) == 811 for scan in scans)


def emulated(request: bytes) -> bytes:
    """An emulator's answer to what it has no answer for: `sAN` and the name, whatever was asked."""
    return b"sAN " + request.split(b" ")[1]


async def test_an_emulator_that_answers_everything_with_san_and_waits_to_be_started_streams(
    make_scan: Callable[..., ScanData],
) -> None:
    clock = Clock(1970, 1, 1, 0, 0, 0, 0)
    answers: dict[bytes, bytes | None] = {
        b"sRN SCdevicestate": b"sRA SCdevicestate \x01",
        b"sRN DeviceIdent": b"sRA DeviceIdent \x00\x08MRS1xxxx\x00\x081.0.0.0R",
        b"sRN FirmwareVersion": b"sRA FirmwareVersion \x00\x05V3.13",
        b"sEN LMDscandata \x01": b"sEA LMDscandata \x01",
        b"sMN LMCstartmeas": b"sAN LMCstartmeas \x00",
    }
    stranger = Stranger(answers, emulated, streams(make_scan, Dialect.B, clock=clock), b"sMN LMCstartmeas")
    async with stranger.serving(), lidar_at(stranger) as lidar:
        await take(lidar, 20)
        assert lidar.stats.state is LinkState.STREAMING
        assert lidar.stats.identity is not None
        assert (lidar.stats.identity.type, lidar.stats.identity.serial) == ("MRS1xxxx", "")
    assert not any(payload.startswith((b"sMN SetAccessMode", b"sMN Run", b"sWN")) for payload in stranger.heard)


async def test_a_player_that_plays_forth_and_back_keeps_streaming(make_scan: Callable[..., ScanData]) -> None:
    forth = streams(make_scan, Dialect.B)[:60]
    stranger = Stranger(otherwise=emulated, scans=forth + forth[-2:0:-1])
    stranger.answers[b"sEN LMDscandata \x01"] = b"sEA LMDscandata \x01"
    async with stranger.serving(), lidar_at(stranger) as lidar:
        await take(lidar, 170)
        stats = lidar.stats
    assert stats.reconnects == 0
    assert stats.damaged < 15
    assert stats.restarts > 20


async def test_a_device_that_answers_in_both_dialects_and_streams_in_the_other_is_understood_at_last(
    make_scan: Callable[..., ScanData], until: Until
) -> None:
    stranger = Stranger(otherwise=lambda request: request.replace(b"sEN", b"sEA").replace(b"sRN", b"sRA"))
    stranger.scans = streams(make_scan, Dialect.A)
    async with stranger.serving(), lidar_at(stranger) as lidar:
        await until(lambda: lidar.stats.received >= 5)
        assert lidar.stats.identity is not None
        assert lidar.stats.identity.dialect is Dialect.A
        assert lidar.stats.reconnects >= 1


async def test_scans_by_index_polled_scans_in_the_stream_and_foreign_events_are_served(
    make_scan: Callable[..., ScanData],
) -> None:
    def disguised(number: int, scan: bytes) -> list[bytes]:
        match number % 4:
            case 0:
                return [frame(Dialect.A, b"sSI 18 " + scan[17:-1])]
            case 1:
                return [scan.replace(b"sSN", b"sRA")]
            case 2:
                return [frame(Dialect.A, b"sSN LFErec 1 2 3"), frame(Dialect.A, b"sFA 3"), scan]
        return [frame(Dialect.A, b"sSI 5A 1 2"), frame(Dialect.A, b"sRA LMDscandata" + b" 0" * 24), scan]

    stranger = Stranger(otherwise=lambda request: b"sFA 3" if request[:3] != b"sEN" else b"sEA LMDscandata 1")
    plain = streams(make_scan, Dialect.A)
    stranger.scans = [b"".join(disguised(number, scan)) for number, scan in enumerate(plain)]
    config = replace(HASTY, dialect=Dialect.A)
    async with stranger.serving(), lidar_at(stranger, config) as lidar:
        scans = await take(lidar, 40)
        assert (lidar.stats.lost, lidar.stats.damaged) == (0, 0)
    assert len(scans) == 40


async def test_a_method_accepted_first_and_answered_later_is_waited_for() -> None:
    slow: list[str] = []

    class Slow(Tim571Simulator):
        def heard(self, request: Telegram, connection: Any) -> None:
            if request.name == "SetAccessMode":
                slow.append(request.name)
                connection.send(Telegram(request.dialect, "sMA", request.name, b"").to_wire())
            super().heard(request, connection)

    config = replace(HASTY, output=OutputContent(rssi=True))
    async with (
        Slow(settings=DeviceSettings(scan_rate_hz=60.0)) as simulator,
        TiM571(TcpTransport(simulator.host, simulator.port), config) as lidar,
    ):
        (scan,) = await take(lidar, 1)
    assert scan.rssi is not None
    assert slow


async def test_a_late_refusal_is_not_taken_for_the_next_answer() -> None:
    """`sFA` names nothing: one that comes after its request was given up must not answer another."""

    class Late(Tim571Simulator):
        def heard(self, request: Telegram, connection: Any) -> None:
            if request.name == "DeviceIdent":
                late = Telegram(request.dialect, "sFA", "", b"3" if request.dialect is Dialect.A else b"\x00\x03")
                asyncio.get_running_loop().call_later(0.12, connection.send, late.to_wire())
            elif request.name == "0":
                asyncio.get_running_loop().call_later(0.05, super().heard, request, connection)
            else:
                super().heard(request, connection)

    async with Late() as simulator, TiM571(TcpTransport(simulator.host, simulator.port), HASTY) as lidar:
        await take(lidar, 1)
        assert lidar.stats.identity is not None
        assert lidar.stats.identity.type == "TiM57x"


@pytest.mark.parametrize("dialect", list(Dialect), ids=str)
async def test_the_dialect_is_switched_if_asked_and_once_only(dialect: Dialect, until: Until) -> None:
    config = replace(HASTY, switch_to=dialect.other)
    async with Tim571Simulator(dialect=dialect, settings=DeviceSettings(scan_rate_hz=60.0)) as simulator:
        async with TiM571(TcpTransport(simulator.host, simulator.port), config) as lidar:
            await take(lidar, 3)
            assert lidar.stats.identity is not None
            assert lidar.stats.identity.dialect is dialect.other
            assert lidar.stats.warning == ""
            await simulator.power_cycle()  # it was not saved
            await until(lambda: lidar.stats.state is not LinkState.STREAMING)
            received = lidar.stats.received
            await until(lambda: lidar.stats.received > received)
            assert lidar.stats.identity.dialect is dialect.other
        writes = [request for request in simulator.requests if request.name == "EIHstCola"]
    assert len(writes) == 2


async def test_a_device_that_cannot_switch_its_dialect_streams_with_a_warning(rec: Any) -> None:
    config = replace(HASTY, switch_to=Dialect.A)
    replay = rec("tim781s_cola_b.rec")
    async with (
        Tim571Simulator(replay=replay) as simulator,
        TiM571(TcpTransport(simulator.host, simulator.port), config) as lidar,
    ):
        await take(lidar, 2)
        assert "outside its limits" in lidar.stats.warning


async def test_the_output_range_is_written_only_if_it_differs() -> None:
    wanted = OutputRange.from_yaw(-60, 60)
    config = replace(HASTY, output_range=wanted)
    async with Tim571Simulator(settings=DeviceSettings(scan_rate_hz=60.0)) as simulator:
        for logins in (1, 0):
            simulator.requests.clear()
            async with TiM571(TcpTransport(simulator.host, simulator.port), config) as lidar:
                (scan,) = await take(lidar, 1)
                assert lidar.stats.identity is not None
                assert lidar.stats.identity.output_range == wanted
            assert sum(request.name == "SetAccessMode" for request in simulator.requests) == logins
    assert len(scan.ranges) == 361
    assert scan.yaw[[0, -1]] == pytest.approx([-1.0472, 1.0472], abs=1e-3)


async def test_reconnects_in_a_row_succeed_and_leave_nothing_behind(until: Until) -> None:
    settings = DeviceSettings(scan_rate_hz=200.0)
    config = replace(HASTY, backoff_first_s=0.001, backoff_max_s=0.005)
    async with Tim571Simulator(dialect="b", settings=settings) as simulator:
        async with TiM571(TcpTransport(simulator.host, simulator.port), config) as lidar:
            for reconnect in range(20):  # the hundred are in benchmarks/lidar_soak.py
                await until(lambda: lidar.stats.state is LinkState.STREAMING)
                received = lidar.stats.received
                await until(lambda received=received: lidar.stats.received > received)  # type: ignore[misc]
                for connection in list(simulator._connections):
                    connection.abort()
                await until(lambda n=reconnect: lidar.stats.reconnects > n)  # type: ignore[misc]
            assert len(asyncio.all_tasks()) < 10
        await until(lambda: simulator.clients == 0)
