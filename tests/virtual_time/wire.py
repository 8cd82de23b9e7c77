"""A bus between the driver and the simulated base in simulated time, with everything that can go wrong on it.

Every frame is put down with its stamp as it is on the wire: commands as the base's transceiver sees them,
feedback as it leaves the base. Nothing here refuses a frame for what it says: that is the driver's duty,
and the checker's to find.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.errors import RmpInterfaceError, RmpLinkError, RmpSendDropped
from drivers.rmp110.simulator.faults import FaultInjector, FaultPlan
from drivers.rmp110.simulator.model import RmpModel
from tests.virtual_time.clock import Clock

FRAME_NS = 120_000
"""One frame of eight bytes at 1 Mbit/s."""
REPLY_S = 0.002
"""From a command to the end of the compact set on the bus."""


class OnWire(NamedTuple):
    """One frame with its time; `to_base` is what the host sent."""

    stamp_ns: int
    to_base: bool
    can_id: int
    data: bytes


@dataclass
class VirtualBus:
    """One bus with one base on it, made inside the loop that it lives in.

    The attributes below the model are the faults; change them at any time."""

    clock: Clock
    model: RmpModel
    on_wire: Callable[[OnWire], None]
    plan: FaultPlan = field(default_factory=FaultPlan)
    """`drop` and `corrupt`, per feedback frame."""
    reply_s: float = REPLY_S
    jitter_s: float = 0.0
    """Replies come up to so much later."""
    silent: bool = False
    """The base hears and says nothing."""
    deaf: bool = False
    """The base hears nothing."""
    full: bool = False
    """The bus takes no frames from us."""
    down: bool = False
    snapshot: Callable[[], Callable[[], None]] | None = None
    """Called when the base makes a reply; what it returns is called when that reply was delivered."""

    def __post_init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self._transports: list[VirtualTransport] = []
        self._random = random.Random(self.plan.seed)
        self._injector = FaultInjector(self.plan)
        self._reply_due_s = 0.0
        self.opened = 0

    def transport(self) -> VirtualTransport:
        """A fresh connection; what `Rmp110` takes as its factory."""
        return VirtualTransport(self)

    @property
    def connections(self) -> int:
        return len(self._transports)

    def plan_faults(self, plan: FaultPlan) -> None:
        self.plan, self._injector = plan, FaultInjector(plan)

    def go_down(self) -> None:
        """The interface dies under whoever has it open."""
        self.down = True
        for transport in tuple(self._transports):
            transport.lose("CAN interface can0 is down: the rig pulled it")

    def go_up(self) -> None:
        self.down = False

    def disconnect(self) -> None:
        """Whoever has the bus open is gone without a word: nothing of theirs gets through any more."""
        for transport in tuple(self._transports):
            transport.cut()

    def step(self) -> None:
        """Bring the base up to now; it lives on while nobody talks to it."""
        self.model.step(self.clock.now_ns)

    def power_off(self) -> None:
        self.step()
        self.model.power_off()

    def power_on(self) -> None:
        self.step()
        self.model.power_on(self.clock.now_ns)

    def kill_switch(self) -> None:
        self.step()
        self.model.kill_switch()

    def foreign(self, frame: Frame) -> None:
        """Somebody else commands the base: the base obeys, and we hear it."""
        self.step()
        if self.down:
            return
        replies = () if self.deaf else self.model.receive(self.clock.now_ns, frame)
        for transport in tuple(self._transports):
            transport.deliver(self.clock.now_ns, [frame])
        self._reply(replies)

    def take(self, frame: Frame) -> None:
        """A frame of ours. Raises RmpSendDropped, RmpLinkError."""
        if self.down:
            raise RmpLinkError("CAN interface can0 is down: the rig pulled it")
        if self.full:
            raise RmpSendDropped("CAN interface can0 did not take a frame (transmit buffer full)")
        now_ns = self.clock.now_ns
        self.on_wire(OnWire(now_ns, True, frame.can_id, frame.data))
        self.step()
        if not self.deaf:
            self._reply(self.model.receive(now_ns, frame))

    def attach(self, transport: VirtualTransport) -> None:
        if self.down:
            raise RmpInterfaceError("CAN interface can0 is down: run 'ip link set can0 up type can bitrate 1000000'")
        self.opened += 1
        self._transports.append(transport)

    def detach(self, transport: VirtualTransport) -> None:
        if transport in self._transports:
            self._transports.remove(transport)

    def _reply(self, frames: tuple[Frame, ...]) -> None:
        if self.silent or not frames:
            return
        mangled = self._injector.mangle(frames)
        delay_s = self.reply_s + (self._random.random() * self.jitter_s if self.jitter_s else 0.0)
        # A bus keeps its order: a late reply holds up those behind it.
        self._reply_due_s = max(self.loop.time() + delay_s, self._reply_due_s + FRAME_NS * len(frames) / 1e9)
        self.loop.call_at(self._reply_due_s, self._deliver, mangled, self.snapshot and self.snapshot())

    def _deliver(self, frames: list[Frame], delivered: Callable[[], None] | None) -> None:
        if self.down:
            return
        now_ns = self.clock.now_ns
        first_ns = now_ns - FRAME_NS * (len(frames) - 1)
        for k, frame in enumerate(frames):
            self.on_wire(OnWire(first_ns + FRAME_NS * k, False, frame.can_id, frame.data))
        for transport in tuple(self._transports):
            transport.deliver(first_ns, frames)
        if delivered:
            delivered()


class VirtualTransport:
    """A `Transport` of the driver on a virtual bus."""

    def __init__(self, bus: VirtualBus) -> None:
        self._bus = bus
        self._open = False
        self.damaged = 0

    async def open(
        self, on_frame: Callable[[int, Frame], None], on_lost: Callable[[str], None], *_more: Any, **_named: Any
    ) -> None:
        await asyncio.sleep(0.001)
        self._on_frame, self._on_lost = on_frame, on_lost
        self._bus.attach(self)
        self._open = True

    def send(self, frame: Frame) -> None:
        if not self._open:
            raise RmpLinkError("CAN interface can0 is not open")
        self._bus.take(frame)

    async def close(self) -> None:
        self._open = False
        self._bus.detach(self)

    def deliver(self, first_ns: int, frames: list[Frame]) -> None:
        for k, frame in enumerate(frames):
            if self._open:
                self._on_frame(first_ns + FRAME_NS * k, frame)

    def cut(self) -> None:
        self._open = False
        self._bus.detach(self)

    def lose(self, reason: str) -> None:
        if self._open:
            self._bus.loop.call_soon(self._on_lost, reason)
