"""Who may drive, and when: modes, motion, and what takes the permission away again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from drivers.rmp110.codec.motion import Normalised
from drivers.rmp110.codec.parameters import ModeRequest, OperationalState
from drivers.rmp110.device.link import Clock, Link
from drivers.rmp110.device.state import Identity, State
from drivers.rmp110.device.watchdog import LIMIT_S, Watchdog
from drivers.rmp110.errors import (
    RmpBadCommand,
    RmpFaulted,
    RmpHeld,
    RmpLimitsDiffer,
    RmpLinkError,
    RmpNotIdentified,
    RmpRefused,
    RmpSendDropped,
    RmpTimeout,
    RmpTooFast,
    RmpUnacknowledged,
    RmpWrongMode,
)

SILENCE_S = 0.3
"""Feedback missing for so long ends the link (fact sheet 13.5); the base stops by itself at 0.5 s."""
UNANSWERED_S = 0.1
"""Every command is answered within 10 ms. After five at 50 Hz that were not, a bus that holds frames back may have
them in its queue of ten: from then on only zero follows, so that what comes last there, and is obeyed, is zero."""
COMMAND_FRESH_S = 0.3
"""A motion command not renewed for so long is replaced by zero (fact sheet 13.5)."""
MIN_PERIOD_S = 0.01
"""The base takes a command per control tick, 100 Hz (fact sheet 3.5)."""
MODE_TIMEOUT_S = 1.0
"""A mode change takes 40 to 50 ms; after a second it was refused."""
MODE_LATENCY_S = 0.1
"""Twice what a mode change takes: a state reported later than this after a request is the final one."""
MODE_RETRY_S = 0.2
"""A lost mode request is repeated; asking twice does no harm."""
SLOW_MPS, SLOW_RPS = 0.02, 0.05
"""Below this the base may go to STANDBY (fact sheet section 5)."""
STOP_MARGIN_S = 1.0
"""On top of speed over deceleration: latency, first-order approach, a few lost frames."""
ZERO_PERIOD_S = 0.02
"""Zero motion is sent with 50 Hz while the base is brought to a stop."""

WatchdogFactory = Callable[[Callable[[], bool], Clock], Watchdog]

HELD = (
    f"the program was stuck for more than {LIMIT_S:g} s while driving and the watchdog stopped the base: "
    "command zero first, then it may move again"
)


class Pilot:
    """Drives an identified base over one link. Not armed until TRACTOR was asked for and reached."""

    def __init__(self, link: Link, identity: Identity, watchdog: WatchdogFactory = Watchdog) -> None:
        self._link = link
        self._clock = link.clock
        self._identity = identity
        self._language = identity.language
        self._watchdog = watchdog(lambda: link.send_aside(identity.language.zero), link.clock)
        self._state: State | None = None
        self._seen_ns = 0
        self._moving = False
        self._latched: str | None = None
        self._disarmed_because = "nobody asked for it since the link was made"
        self.armed = False
        self.tractor_asked = False
        """Whether TRACTOR was asked for since the last STANDBY: the base may be in it, or get there any moment."""
        self.last_motion_ns: int | None = None

    @property
    def watchdog_trips(self) -> int:
        return self._watchdog.trips

    def start(self) -> None:
        """Let the watchdog out."""
        self._watchdog.start()

    def stop(self) -> None:
        """The link is over."""
        self._watchdog.stop()

    def watch(self, state: State, arrived_ns: int) -> State:
        """A new state: anything unusual takes the permission to drive away, and says zero once.

        Returns the state with what was unusual since, be it for one packet, until STANDBY is requested.
        """
        if self.tractor_asked and state.trouble_now:
            self._latched = state.trouble_now
        if self._latched:
            state = replace(state, latched=self._latched)
        self._state, self._seen_ns = state, arrived_ns
        if self.armed and (state.trouble or state.mode is not OperationalState.TRACTOR):
            self._disarm(state.trouble or f"the base left it and is in {state.mode.name}")
            self._say_zero()
        return state

    def keep_fresh(self, now_ns: int) -> None:
        """Replace a command that nobody renews by zero, before the base's own timeout does."""
        if not self._moving:
            return
        if self._older_than(COMMAND_FRESH_S, now_ns):
            self._moving = not self._say_zero()
        else:
            self._watchdog.renew()

    @property
    def in_standby(self) -> bool:
        """Whether the base was, when it was last heard."""
        return self._mode is OperationalState.STANDBY

    @property
    def driving(self) -> bool:
        """Whether motion commands come, and with them feedback."""
        return not self._older_than(COMMAND_FRESH_S, self._clock())

    def refusal(self) -> RmpRefused | None:
        """Why motion would be refused now; None where the base may be driven."""
        state = self._state
        age_s = (self._clock() - self._seen_ns) / 1e9
        if state is None or age_s > SILENCE_S:
            return RmpNotIdentified(f"no feedback from the base for {SILENCE_S:g} s: nothing may move without")
        if self._identity.refusal:
            return RmpLimitsDiffer(self._identity.refusal)
        if state.trouble_now:
            return RmpFaulted(f"{state.trouble_now}; look after the base, then switch it off and on")
        if self._latched:
            return RmpFaulted(f"it is over, but {self._latched}: look after the base, then request STANDBY")
        if not self.armed:
            return RmpWrongMode(f"the base was not put into tractor mode: {self._disarmed_because}")
        if self._watchdog.tripped:
            return RmpHeld(HELD)
        return None

    def send_motion(self, v: float, w: float) -> Normalised:
        """See `Rmp110.send_motion`."""
        try:
            frame, command = self._language.motion(v, w)
        except RmpBadCommand:
            self._link.dropped += 1
            raise
        moving = wanted = command.velocity != 0 or command.yaw_rate != 0
        refusal = self.refusal()
        if refusal and (moving or not isinstance(refusal, RmpHeld)):
            raise refusal
        if moving and not self._older_than(MIN_PERIOD_S, self._clock()):
            self._link.dropped += 1
            raise RmpTooFast("the base takes a motion command every 10 ms at most; this one was not sent")
        if moving and self._clock() - self._seen_ns > UNANSWERED_S * 1e9:
            frame, command = self._language.motion(0.0, 0.0)
            moving = False
        try:
            passed = self._watchdog.pass_on(lambda: self._link.send(frame), moving=moving)
        except RmpUnacknowledged:
            # What was sent before may wait in a queue: zero comes after it.
            self._moving = not self._say_zero()
            raise
        if not passed:
            raise RmpHeld(HELD)
        if not wanted:
            self._watchdog.release()
        self._moving = moving
        self.last_motion_ns = self._clock()
        return command

    async def enter_tractor(self) -> None:
        """TRACTOR, and the permission to drive. Raises RmpRefused (and its kinds), RmpTimeout, RmpLinkError."""
        refusal = self.refusal()
        if refusal and not isinstance(refusal, (RmpWrongMode, RmpHeld)):
            raise refusal
        if self._mode not in (OperationalState.STANDBY, OperationalState.TRACTOR):
            raise RmpWrongMode(f"the base is in {self._mode.name}: wait until it is in STANDBY")
        held = self._watchdog.tripped
        self.tractor_asked = True
        await self._reach(ModeRequest.TRACTOR, OperationalState.TRACTOR)
        if held and self._say_zero():
            # Whoever asks for TRACTOR again wants it to drive on; the zero is what the watchdog waits for.
            self._watchdog.release()
        self.armed = True

    async def enter_standby(self) -> None:
        """Zero motion until slow, then STANDBY. Raises RmpTimeout, RmpLinkError."""
        self._disarm("STANDBY was requested")
        # Whatever was commanded last may not have taken effect yet: feedback lags by 40 ms.
        self._say_zero()
        stored, state = self._identity.stored, self._state
        longest_s = STOP_MARGIN_S
        if state:
            longest_s += abs(state.v) / max(stored["max_decel"], 0.1)
            longest_s += abs(state.w) / max(stored["max_yaw_accel"], 0.1)
        deadline_ns = self._clock() + round(longest_s * 1e9)
        while not self._slow:
            if self._clock() > deadline_ns:
                raise RmpTimeout("the base does not come to a stop: press its kill switch")
            self._say_zero()
            await self._link.pause(ZERO_PERIOD_S)
        await self._reach(ModeRequest.STANDBY, OperationalState.STANDBY)
        self.tractor_asked = False
        self._latched = None
        self._watchdog.release()

    async def _reach(self, request: ModeRequest, wanted: OperationalState) -> None:
        began_ns = self._clock()
        # Where the base seems to be there already, what was asked for before this may be still to come.
        since_ns = began_ns + (round(MODE_LATENCY_S * 1e9) if self._mode is wanted else 0)
        while self._clock() < began_ns + MODE_TIMEOUT_S * 1e9:
            self._link.try_send(self._language.mode(request))
            if await self._link.wait(lambda: self._mode is wanted and self._seen_ns >= since_ns, MODE_RETRY_S):
                return
        raise RmpTimeout(
            f"the base did not go to {request.name} within {MODE_TIMEOUT_S:g} s (it is in {self._mode.name}): "
            "look for a fault light, a pressed switch or a plugged charger"
        )

    def _say_zero(self) -> bool:
        """Zero of the driver's own accord; whether the bus took it."""
        try:
            self._watchdog.pass_on(lambda: self._link.send(self._language.zero), moving=False)
        except (RmpSendDropped, RmpLinkError):
            return False
        return True

    def _older_than(self, limit_s: float, now_ns: int) -> bool:
        """Whether the last motion command, if any, is."""
        return self.last_motion_ns is None or now_ns - self.last_motion_ns >= limit_s * 1e9

    @property
    def _mode(self) -> OperationalState:
        return self._state.mode if self._state else OperationalState.UNKNOWN

    @property
    def _slow(self) -> bool:
        state = self._state
        return state is not None and abs(state.v) < SLOW_MPS and abs(state.w) < SLOW_RPS

    def _disarm(self, because: str) -> None:
        self.armed = self._moving = False
        self._disarmed_because = because
