"""The lidar: a link that is kept alive for ever, and scans as they come."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from types import TracebackType
from typing import Self

from drivers.tim571.codec import scandata
from drivers.tim571.codec.deframer import Damage
from drivers.tim571.codec.dialect import Dialect
from drivers.tim571.codec.telegram import Telegram
from drivers.tim571.device import startup
from drivers.tim571.device.clock import ArrivalClock
from drivers.tim571.device.config import TimConfig
from drivers.tim571.device.continuity import Continuity
from drivers.tim571.device.scan import Scan, has_ranges, scan_of
from drivers.tim571.device.session import Listeners, Session
from drivers.tim571.device.stats import DeviceState, Identity, LinkState, Rate, TimStats
from drivers.tim571.errors import TimError, TimMalformedError, TimTimeoutError
from drivers.tim571.geometry import SCAN_RATE_HZ
from drivers.tim571.transport import Transport

WATCH_S = 0.1  # how soon a silent or restarted device is noticed beyond its timeout
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
        self._make_transport = transport if callable(transport) else lambda: transport
        self._listeners = Listeners(on_telegram or (lambda _stamp_ns, _frame: None), self._event, self._damage)
        self._mailboxes: set[_Mailbox] = set()
        self._task: asyncio.Task[None] | None = None
        self._dialect = self.config.dialect or Dialect.A  # as delivered; the one that worked last comes first
        self._clock = ArrivalClock()
        self._continuity = Continuity()
        self._rate = Rate()
        self._state = LinkState.CLOSED
        self._detail = "not opened yet"
        self._identity: Identity | None = None
        self._latest: Scan | None = None
        self._trouble = ""
        self._restarted = False
        self._fresh = False
        self._connections = 0
        self._received = self._lost = self._repeated = self._damaged = self._dropped = self._restarts = 0

    @property
    def stats(self) -> TimStats:
        """How the link fares, now."""
        return TimStats(
            state=self._state,
            detail=self._detail,
            identity=self._identity,
            received=self._received,
            lost=self._lost,
            repeated=self._repeated,
            damaged=self._damaged,
            dropped=self._dropped,
            reconnects=max(0, self._connections - 1),
            restarts=self._restarts,
            rate_hz=self._rate.hz if self._state is LinkState.STREAMING else 0.0,
            last_ns=self._latest.arrival_ns if self._latest else None,
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
        mailbox = _Mailbox(self.config.queued_scans)
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

    async def keep_link(self) -> None:
        """One connection, from connecting until it ends; raises the TimError that says why.

        For a single look at the device (`probe`); the context manager repeats it for ever.
        """
        self._go(LinkState.CONNECTING, f"{self._trouble} Trying now." if self._trouble else "connecting")
        session = await startup.connect(self._make_transport, self._dialects(), self.config, self._listeners)
        try:
            self._dialect = session.dialect
            self._connections += 1
            while True:
                await self._start(session)
                await self._watch(session)
        except asyncio.CancelledError:
            await startup.unsubscribe(session, self.config)
            raise
        finally:
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
                    self._go(LinkState.BACKOFF, f"{error} Trying again in {pause_s:g} s.")
                await asyncio.sleep(pause_s)
                pause_s = min(2 * pause_s, self.config.backoff_max_s)
        finally:
            self._go(LinkState.CLOSED, "closed")

    async def _start(self, session: Session) -> None:
        self._restarted = False
        self._rate.clear()
        self._go(LinkState.IDENTIFYING, f"{session.device} answers in {session.dialect}")
        self._identity = await startup.identify(session, self.config)
        wanted, found = self.config.output, self._identity.output
        self._go(LinkState.CONFIGURING, f"{session.device} is a {self._identity.type or 'lidar without a name'}")
        if wanted is not None and wanted != found:
            await startup.configure(session, self.config, wanted)
            self._identity = await startup.identify(session, self.config)
        self._continuity.every = max(1, self._identity.output.every if self._identity.output else 1)
        await startup.subscribe(session, self.config)
        self._trouble = ""
        self._go(LinkState.STREAMING, f"{session.device} sends scans in {session.dialect}")

    async def _watch(self, session: Session) -> None:
        """Until the device restarts; raises when it falls silent or the connection ends."""
        started_ns = time.monotonic_ns()
        idle_s = max(self.config.idle_timeout_s, IDLE_PERIODS * self._continuity.every / SCAN_RATE_HZ)
        first_s = max(self.config.first_scan_timeout_s, idle_s)
        while not self._restarted:
            await session.broken(min(WATCH_S, idle_s / 4))
            newest_ns = self._latest.arrival_ns if self._latest else 0
            began = newest_ns > started_ns
            silent_s = (time.monotonic_ns() - max(newest_ns, started_ns)) / 1e9
            if silent_s > (idle_s if began else first_s):
                raise TimTimeoutError(self._silence(session.device, began, silent_s))

    def _silence(self, device: str, began: bool, silent_s: float) -> str:
        if began:
            return f"{device} stopped sending scans {silent_s:.1f} s ago."
        state = self._identity.state if self._identity else DeviceState.UNKNOWN
        causes = {
            DeviceState.BUSY: "it says it is busy: it is starting up, or another program is logged in, which"
            " switches the laser off",
            DeviceState.ERROR: "it says it has an error: power-cycle it, and have it serviced if that doesn't help",
        }
        return f"{device} answers but sent no scan for {silent_s:.1f} s; {causes.get(state, 'power-cycle it')}."

    def _dialects(self) -> tuple[Dialect, ...]:
        if self.config.dialect is not None:
            return (self.config.dialect,)
        return (self._dialect, self._dialect.other)

    def _go(self, state: LinkState, detail: str) -> None:
        self._state, self._detail = state, detail

    def _damage(self, _damage: Damage) -> None:
        self._damaged += 1

    def _event(self, telegram: Telegram) -> None:
        """A telegram nobody asked for: a scan, or something of no concern."""
        by_index = telegram.kind == "sSI"  # some TiMs send their scans as an event with a number
        if not by_index and not scandata.is_scan(telegram):
            return
        try:
            data = scandata.decode(telegram)
        except TimMalformedError:
            self._damaged += not by_index
            return
        if not has_ranges(data):
            return  # polled before the first revolution: all zero, counters and ticks included
        step = self._continuity.observe(data.scan_counter, data.scan_tick_us, telegram.stamp_ns)
        if step.repeated:
            self._repeated += 1
            return
        if step.restarted:
            self._restarts += 1
            self._restarted = True
            self._clock.reset()
        self._lost += step.lost
        stamp_ns = self._clock.last_beam_ns(telegram.stamp_ns, data.scan_tick_us, data.transmit_tick_us)
        self._publish(scan_of(data, stamp_ns, telegram.stamp_ns, telegram.frame))

    def _publish(self, scan: Scan) -> None:
        self._received += 1
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


class _Mailbox:
    """A few scans for one consumer; the oldest makes room for the newest."""

    def __init__(self, size: int) -> None:
        self._scans: deque[Scan] = deque(maxlen=size)
        self._news = asyncio.Event()
        self._ended = False

    def put(self, scan: Scan) -> bool:
        """Add a scan; True if another had to go for it."""
        full = len(self._scans) == self._scans.maxlen
        self._scans.append(scan)
        self._news.set()
        return full

    def end(self) -> None:
        """No more scans will come."""
        self._ended = True
        self._news.set()

    async def take(self) -> Scan | None:
        """The oldest kept scan; None after the end."""
        while not self._scans:
            if self._ended:
                return None
            self._news.clear()
            await self._news.wait()
        return self._scans.popleft()
