"""The steady state: ask for feedback, turn it into states, notice when it stops."""

from __future__ import annotations

import time
from collections.abc import Callable

from drivers.rmp110.codec.assembler import Assembler, Packet
from drivers.rmp110.codec.commands import POLL
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.device.config import Rmp110Config
from drivers.rmp110.device.identify import SILENT
from drivers.rmp110.device.journal import Journal
from drivers.rmp110.device.link import Link
from drivers.rmp110.device.pilot import COMMAND_FRESH_S, SILENCE_S, Pilot
from drivers.rmp110.device.state import Identity, all_finite, read_state
from drivers.rmp110.errors import RmpSilent


class Stream:
    """Feedback of an identified base; every state goes to the pilot first, then to the journal."""

    def __init__(self, link: Link, identity: Identity, config: Rmp110Config, pilot: Pilot, journal: Journal) -> None:
        self._link = link
        self._identity = identity
        self._config = config
        self._pilot = pilot
        self._journal = journal
        self._assembler = Assembler(identity.layout.frame_count)
        self._heard_ns = 0
        self._started: Callable[[], None] | None = None

    @property
    def damaged(self) -> int:
        return self._assembler.damaged

    async def run(self, started: Callable[[], None]) -> None:
        """Until the link ends; calls `started` after the first packet. Raises RmpSilent, RmpLinkError."""
        link = self._link
        self._started = started
        link.consumer = self._feed
        link.forget_requests()
        # The first packet has the whole silence limit to arrive in.
        self._heard_ns = time.monotonic_ns()
        period_ns = int(1e9 / self._config.poll_hz)
        while True:
            now_ns = time.monotonic_ns()
            link.count_lost(now_ns)
            if now_ns - self._heard_ns > SILENCE_S * 1e9:
                raise RmpSilent(f"no feedback for {SILENCE_S:g} s: {SILENT}")
            self._pilot.keep_fresh(now_ns)
            await link.pause(self._poll(now_ns, period_ns) / 1e9)

    def _poll(self, now_ns: int, period_ns: int) -> int:
        """Ask for feedback where nothing else did; nanoseconds until the next look."""
        # Motion frames come at about the same rate and bring feedback themselves: let them go first.
        driving = now_ns - self._pilot.last_motion_ns < COMMAND_FRESH_S * 1e9
        patience_ns = period_ns * 3 // 2 if driving else period_ns
        idle_ns = now_ns - self._link.last_sent_ns
        if idle_ns < patience_ns:
            return max(patience_ns - idle_ns, 1_000_000)
        self._link.try_send(POLL)
        return period_ns

    def _feed(self, stamp_ns: int, frame: Frame) -> None:
        packet = self._assembler.feed(stamp_ns, frame)
        if packet:
            self._take(packet)

    def _take(self, packet: Packet) -> None:
        journal, track_m = self._journal, self._config.track_m
        values = self._identity.layout.decode(packet.words)
        if not all_finite(values):
            journal.damaged += 1
            return
        journal.odometry = journal.odometry.advance(
            values["right_front_pos_m"], values["left_front_pos_m"], values["operational_time"], track_m
        )
        state = read_state(packet.first_ns, values, journal.odometry, self._identity, track_m)
        self._heard_ns = packet.last_ns
        self._pilot.watch(state, packet.last_ns)
        journal.publish(state, packet.last_ns)
        self._link.answered()
        started, self._started = self._started, None
        if started:
            started()
