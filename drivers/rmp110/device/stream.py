"""The steady state: ask for feedback, turn it into states, notice when it stops."""

from __future__ import annotations

from collections.abc import Callable

from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.journal import Journal
from drivers.rmp110.device.language import Report
from drivers.rmp110.device.link import Link
from drivers.rmp110.device.odometry import ulp32
from drivers.rmp110.device.pilot import SILENCE_S, Pilot
from drivers.rmp110.device.slip import SlipWatch
from drivers.rmp110.device.state import Identity, all_finite, read_state
from drivers.rmp110.errors import RmpLinkError, RmpSilent

STREAM_PERIOD_S = 0.01
"""A base that sends by itself does so in every control tick."""
NUDGE_S = 0.1
"""A stream that pauses for ten packets is asked for again."""
STALL_S = 0.1
"""The loop looks every `LOOK_S`; later than this it was stuck itself, and silence says nothing of the base."""
LOOK_S = 0.04
"""Longest pause between two looks at what did not come."""
AGAIN = "the base is in STANDBY now: its parameters can be written on a new connection"
LONGEST_GAP = 100
"""Missing packets counted at most for one gap: what the base's own time says may be nonsense."""


class Stream:
    """Feedback of an identified base; every state goes to the pilot first, then to the journal."""

    def __init__(self, link: Link, identity: Identity, config: Rmp110Config, pilot: Pilot, journal: Journal) -> None:
        self._link = link
        self._identity = identity
        self._language = identity.language
        self._config = config
        self._pilot = pilot
        self._journal = journal
        self._listener = identity.language.listener()
        self._slip = SlipWatch.of(identity.stored)
        self._heard_ns = 0
        self._time_s: float | None = None
        self._started: Callable[[], None] | None = None

    @property
    def damaged(self) -> int:
        return self._listener.damaged

    async def run(self, started: Callable[[], None]) -> None:
        """Until the link ends; calls `started` after the first packet. Raises RmpSilent, RmpLinkError."""
        link = self._link
        self._started = started
        link.consumer = self._feed
        link.forget_requests()
        link.expects_replies = not self._language.unsolicited
        # The first packet has the whole silence limit to arrive in.
        self._heard_ns = looked_ns = link.clock()
        while True:
            now_ns = link.clock()
            link.count_lost(now_ns)
            if now_ns - looked_ns > STALL_S * 1e9:
                self._heard_ns = now_ns
            looked_ns = now_ns
            if now_ns - self._heard_ns > SILENCE_S * 1e9:
                raise RmpSilent(f"no feedback for {SILENCE_S:g} s: {self._language.silence}")
            if self._identity.postponed and self._pilot.in_standby:
                raise RmpLinkError(AGAIN)
            self._pilot.keep_fresh(now_ns)
            await link.pause(min(self._ask(now_ns) / 1e9, LOOK_S))

    def _ask(self, now_ns: int) -> int:
        """Ask for feedback where nothing else did; nanoseconds until the next look."""
        period_ns = int(1e9 / self._config.poll_hz)
        patience_ns = period_ns
        if self._language.unsolicited:
            patience_ns = int(NUDGE_S * 1e9)
        elif self._pilot.driving:
            # Motion frames come at about the same rate and bring feedback themselves: let them go first.
            patience_ns = period_ns * 3 // 2
        last_ns = self._link.last_sent_ns
        if self._language.unsolicited:
            last_ns = max(last_ns, self._heard_ns)
        idle_ns = now_ns - last_ns
        if idle_ns < patience_ns:
            return max(patience_ns - idle_ns, 1_000_000)
        self._link.try_send(self._language.nudge)
        return period_ns

    def _feed(self, stamp_ns: int, frame: Frame) -> None:
        report = self._listener.feed(stamp_ns, frame)
        if report:
            self._take(report)

    def _take(self, report: Report) -> None:
        journal, track_m, values = self._journal, self._config.track_m, report.values
        if not all_finite(values):
            journal.damaged += 1
            return
        time_s = values["operational_time"]
        journal.odometry = journal.odometry.advance(
            values["right_front_pos_m"],
            values["left_front_pos_m"],
            time_s,
            track_m,
            stamp_ns=report.first_ns,
            speeds_mps=(values["right_front_vel_mps"], values["left_front_vel_mps"]),
        )
        self._slip = self._slip.step(values)
        if self._language.unsolicited and self._time_s is not None:
            journal.lost += missing(self._time_s, time_s)
        self._time_s = time_s
        state = read_state(report.first_ns, values, journal.odometry, self._identity, track_m, self._slip)
        self._heard_ns = report.last_ns
        state = self._pilot.watch(state, report.last_ns)
        journal.publish(state, report.last_ns)
        self._link.answered()
        started, self._started = self._started, None
        if started:
            started()


def missing(before_s: float, now_s: float) -> int:
    """How many packets a stream lacks between these two times of the base; in doubt fewer.

    Time is a float32: after some hours its steps are nearly as long as the period.
    """
    periods = (now_s - before_s - ulp32(now_s)) / STREAM_PERIOD_S
    return min(max(round(periods) - 1, 0), LONGEST_GAP)
