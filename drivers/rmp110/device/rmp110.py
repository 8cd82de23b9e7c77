"""The RMP 110 as the robot sees it.

    async with Rmp110(lambda: CanTransport("socketcan", "can0"), Rmp110Config()) as base:
        await base.ready(timeout_s=5)
        await base.request_mode(TRACTOR)
        base.send_motion(0.2, 0.0)

The base moves only after it was identified and TRACTOR was asked for on this very link. The stream of
commands is its heartbeat: it stops by itself 0.5 s after the last one.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from typing import Self

from drivers.rmp110.codec.motion import Normalised
from drivers.rmp110.codec.parameters import ModeRequest, OperationalState
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.identify import identify
from drivers.rmp110.device.identify_v3 import identify as identify_v3
from drivers.rmp110.device.journal import Journal
from drivers.rmp110.device.link import Clock, FrameHook, Link
from drivers.rmp110.device.pilot import Pilot, WatchdogFactory
from drivers.rmp110.device.state import Identity, LinkState, State, Stats
from drivers.rmp110.device.stream import Stream
from drivers.rmp110.device.watchdog import ThreadWatchdog
from drivers.rmp110.errors import RmpError, RmpNotIdentified, RmpPoweringDown, RmpRefused, RmpTimeout
from drivers.rmp110.transport.base import Transport

log = logging.getLogger(__name__)

STANDBY, TRACTOR = ModeRequest.STANDBY, ModeRequest.TRACTOR

Identify = Callable[[Link, Rmp110Config, Callable[[LinkState], None]], Awaitable[Identity]]
POWER_GONE_S = 35.0
"""A base that announced it is off some 30 s later (fact sheet section 11); until then it answers, and is let alone."""
IDENTIFY: Mapping[str, Identify] = {"can": identify, "v3": identify_v3}
"""By configured protocol: never one by trial, V3 packets may ruin an older base (fact sheet section 2)."""


class Rmp110:
    """One base. `transport` makes a fresh transport for every attempt to connect; `hook` sees every frame.

    `clock` and the event loop have to live in the same time; where that is not the machine's own, `watchdog`
    is `Watchdog`, which has no thread.
    """

    def __init__(
        self,
        transport: Callable[[], Transport],
        config: Rmp110Config | None = None,
        hook: FrameHook | None = None,
        *,
        clock: Clock = time.monotonic_ns,
        watchdog: WatchdogFactory = ThreadWatchdog,
    ) -> None:
        self.config = config or Rmp110Config()
        self._transport = transport
        self._hook = hook
        self._clock = clock
        self._watchdog = watchdog
        self._journal = Journal()
        self._link: Link | None = None
        self._identity: Identity | None = None
        self._pilot: Pilot | None = None
        self._stream: Stream | None = None
        self._link_state = LinkState.CLOSED
        self._detail = ""
        self._news = asyncio.Event()
        self._mode_change = asyncio.Lock()
        self._supervisor: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._supervisor = asyncio.create_task(self._supervise(), name="rmp110")
        return self

    async def __aexit__(self, *exception: object) -> None:
        """Zero motion, STANDBY once slow, then close; the reason why it could not be so is logged."""
        try:
            async with self._mode_change:
                # Only now: a request for TRACTOR may just have gone out, and show in no state yet.
                pilot, latest = self._pilot, self.latest
                tractor = latest is not None and latest.mode is OperationalState.TRACTOR
                if pilot and (tractor or pilot.tractor_asked) and not self.config.observe_only:
                    await pilot.enter_standby()
        except RmpError as error:
            log.warning("the base was not put to standby before closing: %s", error)
        finally:
            if self._supervisor:
                self._supervisor.cancel()
                await asyncio.wait({self._supervisor})
                if not self._supervisor.cancelled():
                    self._supervisor.result()

    @property
    def link(self) -> LinkState:
        return self._link_state

    @property
    def identity(self) -> Identity | None:
        """Dialect, stored parameters, limits; None until known, and again after the link was lost."""
        return self._identity

    @property
    def latest(self) -> State | None:
        """The newest state, however old; compare `stamp_ns`."""
        return self._journal.latest

    @property
    def stats(self) -> Stats:
        journal, link, stream = self._journal, self._link, self._stream
        return Stats(
            link=self._link_state,
            detail=self._detail,
            received=journal.received,
            lost=journal.lost + (link.lost if link else 0),
            damaged=journal.damaged + (link.damaged if link else 0) + (stream.damaged if stream else 0),
            reconnects=journal.reconnects,
            dropped=journal.dropped + (link.dropped if link else 0),
            rate_hz=journal.rate_hz,
            last_ns=journal.last_ns,
            watchdog_trips=journal.watchdog_trips + (self._pilot.watchdog_trips if self._pilot else 0),
        )

    async def ready(self, timeout_s: float) -> Identity:
        """Wait until the base is identified and its state streams. Raises RmpTimeout with the last reason."""
        try:
            async with asyncio.timeout(timeout_s):
                while self._link_state is not LinkState.STREAMING or self._identity is None:
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            reason = self._detail or f"still {self._link_state.value}"
            raise RmpTimeout(f"no RMP 110 within {timeout_s:g} s: {reason}") from None
        return self._identity

    def states(self) -> AsyncIterator[State]:
        """Every state from now on, until the base is closed; nothing while the link is down."""
        return self._journal.states()

    def refusal(self) -> RmpRefused | None:
        """Why motion would be refused now; None where the base may be driven."""
        if self._pilot is None or self._link_state is not LinkState.STREAMING:
            because = f": {self._detail}" if self._detail else ""
            return RmpNotIdentified(f"the base is not identified (link {self._link_state.value}){because}")
        return self._pilot.refusal()

    def send_motion(self, v: float, w: float) -> Normalised:
        """Drive with `v` m/s and `w` rad/s (counter-clockwise), clamped to configured and stored limits.

        Goes out at once or not at all, and as zero while the base does not answer. Returns what was applied.
        Raises RmpRefused (and its kinds; RmpHeld after the watchdog stopped the base, until zero was commanded),
        RmpBadCommand (not a finite number), RmpTooFast (less than 10 ms after the last one, and not zero),
        RmpSendDropped (bus full, or nobody acknowledges), RmpLinkError.
        """
        return self._identified().send_motion(v, w)

    async def request_mode(self, mode: ModeRequest) -> None:
        """Put the base into TRACTOR or STANDBY; for STANDBY it is first brought to a stop.

        Raises RmpRefused (and its kinds), RmpTimeout, RmpLinkError.
        """
        if mode not in (STANDBY, TRACTOR):
            raise RmpRefused(f"mode {mode.name} is never requested by this driver: use TRACTOR or STANDBY")
        async with self._mode_change:
            pilot = self._identified()
            await (pilot.enter_tractor() if mode is TRACTOR else pilot.enter_standby())

    def _identified(self) -> Pilot:
        if self.config.observe_only:
            raise RmpRefused("this connection only observes the base (observe_only)")
        if self._pilot is None or self._link_state is not LinkState.STREAMING:
            raise self.refusal() or RmpNotIdentified("the base is not identified")
        return self._pilot

    async def _supervise(self) -> None:
        pause_s, longest_s = self.config.backoff_s
        try:
            while True:
                self._link = link = Link(self._transport(), self._hook, self._clock)
                received = self._journal.received
                failure: RmpError | None = None
                try:
                    await self._converse(link)
                except RmpError as error:
                    failure, self._detail = error, str(error)
                finally:
                    await self._hang_up(link)
                if self._journal.received > received:
                    pause_s = self.config.backoff_s[0]
                wait_s = POWER_GONE_S if isinstance(failure, RmpPoweringDown) else pause_s
                self._enter(LinkState.BACKOFF)
                log.warning("%s; trying again in %.1f s", self._detail, wait_s)
                await asyncio.sleep(wait_s)
                pause_s = min(pause_s * 2, longest_s)
                self._journal.reconnects += 1
        finally:
            self._enter(LinkState.CLOSED)
            self._journal.close()

    async def _converse(self, link: Link) -> None:
        """One connection from opening to its end, which is always an RmpError."""
        self._enter(LinkState.CONNECTING)
        await link.open()
        self._enter(LinkState.PROBING)
        self._identity = identity = await IDENTIFY[self.config.protocol](link, self.config, self._enter)
        for warning in identity.warnings:
            log.warning("%s", warning)
        self._pilot = pilot = Pilot(link, identity, self._watchdog)
        self._stream = Stream(link, identity, self.config, pilot, self._journal)
        pilot.start()
        await self._stream.run(self._streaming)

    def _streaming(self) -> None:
        self._detail = ""
        self._enter(LinkState.STREAMING)

    async def _hang_up(self, link: Link) -> None:
        """Whoever drove stops; what was counted is kept; nothing is known of the base any more."""
        journal, pilot, stream, identity = self._journal, self._pilot, self._stream, self._identity
        self._enter(LinkState.BACKOFF)
        if pilot:
            pilot.stop()
            journal.watchdog_trips += pilot.watchdog_trips
        if identity:
            if pilot and pilot.armed:
                link.farewell(identity.language.zero)
            if identity.language.goodbye:
                link.farewell(identity.language.goodbye)
        journal.lost += link.lost
        journal.dropped += link.dropped
        journal.damaged += link.damaged + (stream.damaged if stream else 0)
        self._link = self._identity = self._pilot = self._stream = None
        await link.close()

    def _enter(self, state: LinkState) -> None:
        """The reason of the last failure stays visible while the next attempt is under way."""
        self._link_state = state
        self._news.set()
