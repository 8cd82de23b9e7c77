"""The simulated lidar on a TCP port."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from random import Random
from types import TracebackType
from typing import Self

from drivers.tim571.codec import scandata
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.fields import pack
from drivers.tim571.codec.scandata import SCAN_NAMES, Clock, ScanData
from drivers.tim571.codec.telegram import Telegram
from drivers.tim571.simulator.behaviour import Behaviour, Client, DeviceSettings
from drivers.tim571.simulator.connection import Connection
from drivers.tim571.simulator.faults import FaultPlan, Line
from drivers.tim571.simulator.recording import read_scans
from drivers.tim571.simulator.scanner import Revolution, Scanner, ScanSource, empty_room
from drivers.tim571.simulator.timing import SCAN_CLOCK_LAG_S, DeviceTime, Motor, answer_delay_s, transmit_delay_s
from drivers.tim571.simulator.words import in_words

SCAN_COUNTER_LEAD = 2  # the scan counter runs ahead of the telegram counter by 2 to 5
LAST_TOUCH_S = 0.0003  # what the head of a telegram takes on a processor that has just woken
MOST_WAITING = 0.01  # of a period: a simulator run many times faster than the device has no time for that
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
BEHIND_S = 1.0  # an event loop held up for longer than this loses revolutions, as a real network would
REMEMBERED_REQUESTS = 256
REMEMBERED_TURNS = 100


class Tim571Simulator:
    """A TiM571 that any SOPAS client can talk to.

        async with Tim571Simulator(source) as simulator:
            ... connect to simulator.port ...

    `source` is the world (see `ScanSource`); `replay` is a `.rec` file to send instead, in its own dialect. `port`
    0 takes a free one. The same seed gives the same noise and the same faults. `on_news` gets a sentence for
    everything that a person at the device might want to know: who connects, what they ask and are told.
    """

    def __init__(
        self,
        source: ScanSource = empty_room,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        dialect: Dialect | str = Dialect.A,
        settings: DeviceSettings | None = None,
        faults: FaultPlan | None = None,
        seed: int = 0,
        replay: Path | None = None,
        on_news: Callable[[str], None] | None = None,
    ) -> None:
        self.settings = settings or DeviceSettings()
        self.host = host
        self.port = port
        self.requests: deque[Telegram] = deque(maxlen=REMEMBERED_REQUESTS)
        """The newest requests understood, whoever sent them."""
        self.faults = faults or FaultPlan()
        self._recorded = read_scans(replay) if replay else []
        if self._recorded:
            dialect = self._recorded[0].dialect
        self.behaviour = Behaviour(self.settings, Dialect(dialect), fixed_dialect=bool(self._recorded))
        self._news = on_news or (lambda _sentence: None)
        self._chance = Random(seed)  # noqa: S311 - latencies, not secrets
        self._motor = Motor(self.settings.scan_rate_hz, seed)
        self._scanner = Scanner(source, seed)
        self._line = Line(self.faults, seed)
        self._connections: set[Connection] = set()
        self._server: asyncio.Server | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._power_on_s = 0.0
        self._turn: Revolution | None = None
        self._turns: deque[Revolution] = deque(maxlen=REMEMBERED_TURNS)
        self._sent = 0

    @property
    def clients(self) -> int:
        """Connections open now."""
        return len(self._connections)

    @property
    def newest(self) -> Revolution | None:
        """The revolution finished last, or None before the first."""
        return self._turn

    def finished(self, scan_counter: int) -> Revolution | None:
        """The revolution of that number if it is one of the last hundred: what a client's stamp is to be held to."""
        return next((turn for turn in self._turns if turn.scan_counter == scan_counter), None)

    async def __aenter__(self) -> Self:
        self._line.begin()
        self._power_on()
        await self.replug()
        self._tasks = [asyncio.create_task(self._rotate(), name="simulated TiM571")]
        if self.faults.unplug is not None:
            self._tasks.append(asyncio.create_task(self._unplug_for(*self.faults.unplug)))
        if self.faults.power_cycle is not None:
            self._tasks.append(asyncio.create_task(self._unplug_for(*self.faults.power_cycle, power=True)))
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        tasks, self._tasks = self._tasks, []
        for task in tasks:
            task.cancel()
        await self.unplug()
        for outcome in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(outcome, Exception):
                raise outcome

    async def serve_forever(self) -> None:
        """Be a lidar until cancelled; raises OSError if the port is taken."""
        async with self:
            await asyncio.gather(*self._tasks)

    async def unplug(self) -> None:
        """Close all connections and refuse new ones; the device stays powered."""
        server, self._server = self._server, None
        if server is not None:
            server.close()
        self.hang_up()
        if server is not None:
            await server.wait_closed()

    def hang_up(self) -> None:
        """Break all connections; new ones are taken."""
        for connection in list(self._connections):
            connection.abort()

    async def replug(self) -> None:
        """Take connections again, on the same port."""
        if self._server is None:
            loop = asyncio.get_running_loop()
            self._server = await loop.create_server(self._connection, self.host, self.port, start_serving=False)
            self.port = self._server.sockets[0].getsockname()[1]
            await self._server.start_serving()

    async def power_cycle(self) -> None:
        """Off and on: connections break, unsaved settings and counters are gone, and start-up begins."""
        await self.unplug()
        self._power_on()
        await self.replug()

    def _connection(self) -> Connection:
        return Connection(self, Client(self.behaviour.dialect), self._line)

    def _power_on(self) -> None:
        self._power_on_s = time.monotonic()
        self._turn = None
        self.behaviour.power_on(self._power_on_s)

    async def _unplug_for(self, at_s: float, for_s: float, power: bool = False) -> None:
        await asyncio.sleep(at_s)
        await self.unplug()
        await asyncio.sleep(for_s)
        if power:
            self._power_on()
        await self.replug()

    async def _rotate(self) -> None:
        """Finish a revolution every period and send it."""
        end_s = time.monotonic() + self._motor.period_s()
        while True:
            await _wake_at(end_s)
            sent_s = end_s + transmit_delay_s(self._chance)
            if self.behaviour.reboot_wanted:
                await self.power_cycle()
            now_s = time.monotonic()
            clients = [connection.client for connection in self._connections]
            if self.behaviour.scanning(clients, now_s) and end_s > self._power_on_s:
                self._turn = self._finish(end_s)
                self._turns.append(self._turn)
                prepared = self._prepare(self._turn)
                await _wake_at(sent_s)
                self._send(prepared)
            end_s += self._motor.period_s()
            if now_s - end_s > BEHIND_S:
                missed = int((now_s - end_s) * self.settings.scan_rate_hz)
                end_s += missed / self.settings.scan_rate_hz
                self._turn = self._turn and self._turn.after(missed)

    def _finish(self, end_s: float) -> Revolution:
        before = self._turn or Revolution(0, 0, SCAN_COUNTER_LEAD - 1, -1)
        return replace(before.after(1), end_ns=round(end_s * 1e9), tick_us=self._tick_us(end_s))

    def _tick_us(self, now_s: float) -> int:
        settings = self.settings
        return DeviceTime(self._power_on_s, settings.drift_ppm, settings.tick_at_power_on_us).tick_us(now_s)

    def _prepare(self, turn: Revolution) -> _Prepared:
        """All of a revolution's telegram but its head: that takes milliseconds, and none in a real device."""
        self._sent += 1
        if self._recorded:
            return _Prepared(None, recorded=self._recorded[(self._sent - 1) % len(self._recorded)].frame)
        if turn.scan_counter % self.behaviour.output.every:
            return _Prepared(None)
        wanted = {connection.client.dialect for connection in self._connections if connection.client.events}
        scan = self._scan(turn) if wanted else None
        return _Prepared(scan, {dialect: scandata.encode_samples(scan, dialect) for dialect in wanted if scan})

    def _send(self, prepared: _Prepared) -> None:
        """At the very moment that the transmission tick says."""
        made: dict[tuple[Dialect, str], bytes] = {}
        sent_s = time.monotonic() + min(LAST_TOUCH_S, MOST_WAITING / self.settings.scan_rate_hz)
        outgoing: list[tuple[Connection, bytes]] = []
        for connection in list(self._connections):
            dialect = connection.client.dialect
            for name in connection.client.events:
                if prepared.recorded:
                    outgoing.append((connection, prepared.recorded))
                elif prepared.scan is not None and dialect in prepared.samples:
                    if (dialect, name) not in made:
                        scan = replace(prepared.scan, transmit_tick_us=self._tick_us(sent_s))
                        telegram = scandata.put_together(scan, prepared.samples[dialect], dialect, "sSN", name)
                        made[dialect, name] = telegram.to_wire()
                    outgoing.append((connection, made[dialect, name]))
        while outgoing and time.monotonic() < sent_s:
            pass
        for connection, frame in outgoing:
            connection.send(frame)

    def _scan(self, turn: Revolution) -> ScanData:
        """As measured, with the content that the device is set to."""
        behaviour = self.behaviour
        scan = self._scanner.scan(
            turn,
            self.settings.serial,
            self.settings.scan_rate_hz,
            behaviour.output,
            behaviour.sector,
            behaviour.name,
            (1, 0) if behaviour.failed else (0, 0),
        )
        return replace(scan, clock=self._clock(turn) if self.settings.time_block and behaviour.output.time else None)

    def _clock(self, turn: Revolution) -> Clock:
        """The wall clock of a device that nobody has set: from 1970 at power-on, in whole milliseconds."""
        since_s = turn.end_ns / 1e9 - self._power_on_s + self._chance.uniform(*SCAN_CLOCK_LAG_S)
        now = EPOCH + timedelta(milliseconds=round(1000 * since_s))
        return Clock(now.year, now.month, now.day, now.hour, now.minute, now.second, now.microsecond)

    def _polled(self, dialect: Dialect, name: str) -> Telegram:
        """The newest finished scan; all zeros before the first."""
        if self._turn is None:
            return Telegram(dialect, "sRA", name, _empty_scan(dialect))
        if self._recorded:
            return replace(self._recorded[(self._sent - 1) % len(self._recorded)], kind="sRA", name=name)
        scan = replace(self._scan(self._turn), transmit_tick_us=self._tick_us(time.monotonic()))
        return scandata.encode(scan, dialect, "sRA", name)

    def joined(self, connection: Connection) -> None:
        """A connection was opened."""
        self._connections.add(connection)
        self._news(f"{connection.peer} connects")
        if self._server is None:  # accepted in the very moment the plug was pulled
            connection.abort()

    def left(self, connection: Connection) -> None:
        """A connection has closed; whoever was logged in on it is no longer."""
        self._connections.discard(connection)
        self._news(f"{connection.peer} has gone")

    def delay_s(self, request: Telegram) -> float:
        """How long the answer takes."""
        return answer_delay_s(request.kind, request.name, self._chance)

    def heard(self, request: Telegram, connection: Connection) -> None:
        """Answer a request."""
        now_s = time.monotonic()
        if not self.behaviour.awake(now_s) or self._line.dead:
            return
        self.requests.append(request)
        if request.kind == "sRN" and request.name in SCAN_NAMES and not request.body:
            answer = self._polled(request.dialect, request.name)
        else:
            clients = [other.client for other in self._connections]
            answer = self.behaviour.answer(request, connection.client, clients, now_s)
        self._news(f"{connection.peer} {in_words(request, answer)}")
        connection.send(answer.to_wire())


@dataclass(frozen=True, slots=True)
class _Prepared:
    """A telegram that needs its head only, or a recorded one."""

    scan: ScanData | None
    samples: dict[Dialect, bytes] = field(default_factory=dict)
    recorded: bytes = b""


async def _wake_at(then_s: float) -> None:
    await asyncio.sleep(max(0.0, then_s - time.monotonic()))


def _empty_scan(dialect: Dialect) -> bytes:
    return pack(dialect, "HHIBBHHIIBBBBHIIHHHHHHHH", *[0] * 24)
