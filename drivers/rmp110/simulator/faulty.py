"""A base that fails by plan, in anybody's time: no clock, no I/O; what it sends comes with the time it is due."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol

from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.simulator.faults import FaultInjector, FaultPlan, Message, within
from drivers.rmp110.simulator.wire_time import schedule_ns

FOREIGN_PERIOD_NS = 100_000_000
"""Somebody else's panel commands with 10 Hz, the slowest that keeps a base moving."""
LONGEST_FRAME_NS = 135_000
"""What a frame of eight bytes takes at most (fact sheet 3.4)."""
OUTBOX = 4096
"""Replies held back at most; nothing here grows without end."""


class Model(Protocol[Message]):
    """What a plan can happen to."""

    powered: bool
    modes_stuck: bool

    def step(self, now_ns: int) -> None: ...
    def receive(self, now_ns: int, message: Message, /) -> tuple[Message, ...]: ...
    def take_unsolicited(self) -> Sequence[tuple[int, tuple[Message, ...]]]: ...
    def power_on(self, now_ns: int) -> None: ...
    def power_off(self) -> None: ...
    def restart(self, now_ns: int) -> None: ...
    def kill_switch(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Burst(Generic[Message]):
    """Messages that follow each other on the wire."""

    begin_ns: int
    messages: tuple[Message, ...]

    def stamps_ns(self) -> tuple[int, ...]:
        """When each message is complete: CAN frames after their bits, packets all at once."""
        frames = [message for message in self.messages if isinstance(message, Frame)]
        offsets = schedule_ns(frames) if frames else (0,) * len(self.messages)
        return tuple(self.begin_ns + offset for offset in offsets)


class FaultyBase(Generic[Message]):
    """Model and plan; the plan's seconds count from `start_ns`. Same plan and same input give the same output.

    `foreign` is what somebody else on the same bus sends while the plan says so; on other wires nobody else is.
    """

    def __init__(
        self, model: Model[Message], plan: FaultPlan, start_ns: int, foreign: tuple[Message, ...] = ()
    ) -> None:
        self.model = model
        self._foreign = foreign
        self.injector = FaultInjector(plan)
        self.plugged = True
        self.heard: dict[int, int] = {}
        """Frames that reached the base, by CAN id."""
        self._start_ns = start_ns
        self._outbox: list[tuple[int, int, Burst[Message]]] = []
        self._sent = 0
        self._bus_free_ns = 0
        self._silent_until_ns = start_ns
        self._killed = False
        self._cycled = self._restarted = 0
        self._next_foreign_ns = 0

    def start(self, now_ns: int) -> None:
        """The plan's seconds count from now."""
        self._start_ns = now_ns

    def silence(self, until_ns: int) -> None:
        """Neither hear nor say anything until then."""
        self._silent_until_ns = until_ns

    def receive(self, now_ns: int, message: Message) -> None:
        """One message from the bus; the reply goes to the outbox."""
        elapsed_s = (now_ns - self._start_ns) / 1e9
        deaf = now_ns < self._silent_until_ns or within(self.injector.plan.silences, elapsed_s)
        if deaf or not self.plugged:
            return
        can_id = message.can_id if isinstance(message, Frame) else int.from_bytes(message[:2], "big")
        if can_id in self.heard or len(self.heard) < OUTBOX:
            self.heard[can_id] = self.heard.get(can_id, 0) + 1
        self._post(now_ns, self.model.receive(now_ns, message))

    def step(self, now_ns: int) -> None:
        """Advance model and plan."""
        self.model.step(now_ns)
        self._follow_plan(now_ns)
        silent = now_ns < self._silent_until_ns
        for stamp_ns, messages in self.model.take_unsolicited():
            if not silent and not within(self.injector.plan.silences, (stamp_ns - self._start_ns) / 1e9):
                self._post(stamp_ns, messages)

    def due(self, now_ns: int) -> list[Burst[Message]]:
        """Bursts that begin no later than now, in order; what was due while unplugged is lost."""
        ready: list[Burst[Message]] = []
        while self._outbox and self._outbox[0][0] <= now_ns:
            burst = heapq.heappop(self._outbox)[2]
            if self.plugged:
                ready.append(burst)
        return ready

    @property
    def next_due_ns(self) -> int | None:
        """When the next burst begins; None where nothing waits."""
        return self._outbox[0][0] if self._outbox else None

    def _post(self, now_ns: int, messages: Sequence[Message]) -> None:
        kept = self.injector.mangle(messages)
        if not kept or len(self._outbox) >= OUTBOX:
            return
        delay_s = self.injector.delay_s(alone=len(kept) == 1)
        # The base's replies queue up behind each other, but not behind one that a fault holds back.
        begin_ns = now_ns + round(delay_s * 1e9) if delay_s else max(now_ns, self._bus_free_ns)
        if not delay_s and isinstance(kept[0], Frame):
            self._bus_free_ns = begin_ns + len(kept) * LONGEST_FRAME_NS
        self._put(Burst(begin_ns, tuple(kept)))

    def _put(self, burst: Burst[Message]) -> None:
        self._sent += 1
        heapq.heappush(self._outbox, (burst.begin_ns, self._sent, burst))

    def _follow_plan(self, now_ns: int) -> None:
        plan, model = self.injector.plan, self.model
        elapsed_s = (now_ns - self._start_ns) / 1e9
        if plan.unplugs:
            self.plugged = not within(plan.unplugs, elapsed_s)
        if plan.stuck_modes:
            model.modes_stuck = within(plan.stuck_modes, elapsed_s)
        if plan.kill_at_s is not None and elapsed_s >= plan.kill_at_s and not self._killed:
            self._killed = True
            model.kill_switch()
        if self._restarted < len(plan.restarts) and elapsed_s >= plan.restarts[self._restarted]:
            self._restarted += 1
            model.restart(now_ns)
        if self._cycled < len(plan.power_cycles):
            begin, length = plan.power_cycles[self._cycled]
            if elapsed_s >= begin + length:
                self._cycled += 1
                model.power_on(now_ns)
            elif elapsed_s >= begin and model.powered:
                model.power_off()
        if plan.foreign and now_ns >= self._next_foreign_ns and within(plan.foreign, elapsed_s):
            self._next_foreign_ns = now_ns + FOREIGN_PERIOD_NS
            for message in self._foreign:
                self._put(Burst(now_ns, (message,)))
                self.receive(now_ns, message)
