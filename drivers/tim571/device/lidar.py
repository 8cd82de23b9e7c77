"""The lidar: a link that is kept alive for ever, and scans as they come."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from types import TracebackType
from typing import Any, Self

from drivers.tim571.codec import commands
from drivers.tim571.codec.answers import DeviceState
from drivers.tim571.codec.deframer import Damage
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.telegram import Telegram
from drivers.tim571.device import startup
from drivers.tim571.device.config import TimConfig
from drivers.tim571.device.intake import Intake
from drivers.tim571.device.mailbox import Mailbox
from drivers.tim571.device.scan import DeviceStatus, Scan
from drivers.tim571.device.session import Listeners, Session
from drivers.tim571.device.stats import Identity, LinkState, Rate, TimStats
from drivers.tim571.errors import (
    TimError,
    TimRefusedError,
    TimTimeoutError,
    TimUnreachableError,
)
from drivers.tim571.geometry import SCAN_RATE_HZ
from drivers.tim571.transport import Transport

WATCH_S = 0.1  # how soon a silent or restarted device is noticed beyond its timeout
SETUP_AGAIN_S = 10.0  # a device whose ticks jump all the time, such as a player of recordings, is not asked each time
IDLE_PERIODS = 3  # a device told to send every n-th scan may stay silent for this many of its periods

OnTelegram = Callable[[int, bytes], None]


class TiM571:
    """A SICK TiM571 that reconnects until it is closed.

        async with TiM571(TcpTransport("192.168.0.1")) as lidar:
            async for scan in lidar.scans():
                ...

    `transport` is one that can be reopened, or a maker of one for each connection. `on_telegram(stamp_ns, frame)`
    gets every good frame exactly as received, from the event loop's thread.
    """

    def __init__(
        self,
        transport: Transport | Callable[[], Transport],
        config: TimConfig | None = None,
        on_telegram: OnTelegram | None = None,
    ) -> None:
        self.config = config or TimConfig()
        self._session: Session | None = None
        self._make_transport = transport if callable(transport) else lambda: transport
        self._listeners = Listeners(on_telegram or (lambda _stamp_ns, _frame: None), self._event, self._damage)
        self._mailboxes: set[Mailbox] = set()
        self._task: asyncio.Task[None] | None = None
        self._dialect = self.config.dialect or self.config.dialects[0]  # the one that worked last comes first
        self._switched = False
        self._intake = Intake(self.config.tick_marks, self.config.stamp_marks)
        self._rate = Rate()
        self._state = LinkState.CLOSED
        self._detail = "not opened yet"
        self._identity: Identity | None = None
        self._latest: Scan | None = None
        self._trouble = ""
        self._warning = ""
        self._set_up_again_ns = -round(SETUP_AGAIN_S * 1e9)
        self._fresh = False
        self._connections = self._dropped = 0

    @property
    def stats(self) -> TimStats:
        """How the link fares, now."""
        intake = self._intake
        return TimStats(
            state=self._state,
            detail=self._detail,
            identity=self._identity,
            received=intake.received,
            lost=intake.lost,
            repeated=intake.repeated,
            damaged=intake.damaged,
            implausible=intake.implausible,
            doubts=intake.doubts,
            dropped=self._dropped,
            reconnects=max(0, self._connections - 1),
            restarts=intake.restarts,
            rate_hz=self._rate.hz if self._state is LinkState.STREAMING else 0.0,
            last_ns=self._latest.arrival_ns if self._latest else None,
            status=self._latest.status if self._latest else DeviceStatus.OK,
            clock=intake.clock.state,
            warning=self._warning,
        )

    @property
    def latest(self) -> Scan | None:
        """The newest scan, or None before the first."""
        return self._latest

    async def __aenter__(self) -> Self:
        self._task = asyncio.create_task(self._keep_alive(), name="TiM571")
        self._task.add_done_callback(self._ended)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.wait({task})
            if not task.cancelled() and task.exception() is not error:
                task.result()

    async def scans(self) -> AsyncIterator[Scan]:
        """Scans from now on, until the lidar is closed. A consumer that falls behind gets the newest.

        Raises what `on_telegram` raised, for that ended the link; the lidar's own trouble never does.
        """
        mailbox = Mailbox(self.config.queued_scans)
        task = self._task
        if task is None:
            return
        if task.done():
            mailbox.end()
        self._mailboxes.add(mailbox)
        try:
            while (scan := await mailbox.take()) is not None:
                yield scan
            if not task.cancelled():
                task.result()
        finally:
            self._mailboxes.discard(mailbox)

    async def read(self, name: str) -> Any:
        """A variable of the device by its name, as `answers.understand` puts it, while scans go on coming.

        Raises TimUnreachableError if there is no link, TimRefusedError if the device does not know it, TimTimeoutError
        if it passes it over. ValueError for a name that this driver does not know.
        """
        if name not in commands.VARIABLES:
            raise ValueError(f"'{name}' is no variable of a TiM571 or its sisters")
        session = self._session
        if session is None:
            raise TimUnreachableError(f"There is no link to read {name} over: {self._detail}")
        return await session.answer(commands.read(session.dialect, name), self.config.answer_timeout_s)

    async def keep_link(self) -> None:
        """One connection, from connecting until it ends; raises the TimError that says why.

        For a single look at the device (`probe`); the context manager repeats it for ever.
        """
        self._go(LinkState.CONNECTING, f"{self._trouble} Trying now." if self._trouble else "connecting")
        while True:
            session = await startup.connect(self._make_transport, self._dialects(), self.config, self._listeners)
            self._session = session
            self._intake.connected()
            self._dialect = session.dialect
            self._connections += 1
            try:
                while await self._start(session):
                    await self._watch(session)
            except asyncio.CancelledError:
                await startup.unsubscribe(session, self.config)
                raise
            finally:
                self._session = None
                await session.close()

    async def _keep_alive(self) -> None:
        pause_s = self.config.backoff_first_s
        try:
            while True:
                self._fresh = False
                try:
                    await self.keep_link()
                except TimError as error:
                    pause_s = self.config.backoff_first_s if self._fresh else pause_s
                    self._trouble = str(error)
                    self._switched = False
                    self._go(LinkState.BACKOFF, f"{error} Trying again in {pause_s:g} s.")
                await asyncio.sleep(pause_s)
                pause_s = min(2 * pause_s, self.config.backoff_max_s)
        finally:
            self._go(LinkState.CLOSED, "closed")

    async def _start(self, session: Session) -> bool:
        """Set the device up until its scans come; False if the connection has to be opened anew for that."""
        self._intake.restarted = False
        self._rate.clear()
        self._go(LinkState.IDENTIFYING, f"{session.device} answers in {session.dialect}")
        self._identity = await startup.identify(session, self.config)
        self._go(LinkState.CONFIGURING, f"{session.device} is a {self._identity.type or 'lidar without a name'}")
        if not await self._configure(session, self._identity):
            return False
        self._intake.every = max(1, self._identity.output.every if self._identity.output else 1)
        await startup.subscribe(session, self.config)
        self._trouble = ""
        self._go(LinkState.STREAMING, f"{session.device} sends scans in {session.dialect}")
        return True

    async def _configure(self, session: Session, found: Identity) -> bool:
        """What the configuration asks for, if anything; False if the device has changed its dialect."""
        self._warning = ""
        writes = startup.changes(self.config, found)
        switching = bool(writes) and startup.switches_dialect(writes[-1])
        if switching and self._switched:
            self._warning = f"{session.device} was told to speak {self.config.switch_to} and still doesn't."
            writes, switching = writes[:-1], False
        if not writes:
            return True
        try:
            await startup.configure(session, self.config, writes)
        except TimRefusedError as error:
            if self.config.insist:
                raise
            self._warning = f"{error} Its scans come as it is set."
            return True
        if switching:
            self._switched = True
            self._dialect = session.dialect.other
            return False
        self._identity = await startup.identify(session, self.config)
        if startup.changes(self.config, self._identity):
            self._warning = f"{session.device} took its settings but still has others; a TiM571 can't have every one."
        return True

    async def _watch(self, session: Session) -> None:
        """Until the device restarts; raises when it falls silent or the connection ends."""
        started_ns = time.monotonic_ns()
        damaged = self._intake.damaged
        idle_s = max(self.config.idle_timeout_s, IDLE_PERIODS * self._intake.every / SCAN_RATE_HZ)
        first_s = max(self.config.first_scan_timeout_s, idle_s)
        woken = ""
        while True:
            await session.broken(min(WATCH_S, idle_s / 4))
            newest_ns = self._latest.arrival_ns if self._latest else 0
            began = newest_ns > started_ns
            now_ns = time.monotonic_ns()
            silent_s = (now_ns - max(newest_ns, started_ns)) / 1e9
            if self._intake.restarted and now_ns - self._set_up_again_ns > SETUP_AGAIN_S * 1e9:
                self._set_up_again_ns = now_ns
                return
            if not began and not woken and silent_s > min(self.config.wake_after_s, first_s / 2):
                woken = await startup.wake(session, self.config)
            if silent_s > (idle_s if began else first_s):
                if not began and self._intake.damaged > damaged:
                    self._dialect = session.dialect.other  # something comes that isn't in this one
                raise TimTimeoutError(self._silence(session.device, began, silent_s, woken))

    def _silence(self, device: str, began: bool, silent_s: float, woken: str) -> str:
        if began:
            return f"{device} stopped sending scans {silent_s:.1f} s ago."
        state = self._identity.state if self._identity else DeviceState.UNKNOWN
        causes = {
            DeviceState.BUSY: "it says it is busy: it is starting up, or another program is logged in, which"
            " switches the laser off",
            DeviceState.ERROR: "it says it has an error: power-cycle it, and have it serviced if that doesn't help",
        }
        cause = causes.get(state, f"{woken.rstrip('.')}; power-cycle it" if woken else "power-cycle it")
        return f"{device} answers but sent no scan for {silent_s:.1f} s; {cause}."

    def _dialects(self) -> tuple[Dialect, ...]:
        if self.config.dialect is not None:
            return (self.config.dialect,)
        return (self._dialect, self._dialect.other)

    def _go(self, state: LinkState, detail: str) -> None:
        self._state, self._detail = state, detail

    def _damage(self, _damage: Damage) -> None:
        self._intake.damaged += 1

    def _event(self, telegram: Telegram) -> None:
        """A telegram nobody asked for: a scan, or something of no concern."""
        scan = self._intake.take(telegram)
        if scan is not None:
            self._publish(scan)

    def _publish(self, scan: Scan) -> None:
        self._fresh = True
        self._rate.add(scan.arrival_ns)
        self._latest = scan
        for mailbox in self._mailboxes:
            self._dropped += mailbox.put(scan)

    def _ended(self, task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()):
            self._go(LinkState.CLOSED, f"stopped for good by {type(error).__name__}: {error}")
        for mailbox in self._mailboxes:
            mailbox.end()
