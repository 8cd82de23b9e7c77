"""A simulated base that runs: model, wire and faults brought to life by a clock.

async with serve("socketcand") as base:
    ...  # clients reach it at 127.0.0.1, port base.port, channel can0

The frames of a reply go out together: no event loop can time the 0.1 ms between them. Where that spacing
matters, `FaultyBase` gives it in anybody's time.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Generic

from drivers.rmp110.codec.commands import motion
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.simulator.bus import PythonCanBus, SimulatorBus
from drivers.rmp110.simulator.dynamics import DT
from drivers.rmp110.simulator.faults import FaultInjector, FaultPlan, Message
from drivers.rmp110.simulator.faulty import FaultyBase, Model
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.packet_wires import PtyWire, UdpWire
from drivers.rmp110.simulator.socketcand_server import SocketcandServer
from drivers.rmp110.simulator.v3_model import V3Model

FOREIGN = (motion(0.1, 0.0),)
"""What somebody else's panel would send."""


class SimulatedBase(Generic[Message]):
    """A base on a wire; faults come from the plan or by call."""

    def __init__(
        self,
        bus: SimulatorBus[Message],
        model: Model[Message],
        plan: FaultPlan,
        foreign: tuple[Message, ...] = (),
    ) -> None:
        self._bus = bus
        self._base = FaultyBase(model, plan, time.monotonic_ns(), foreign)
        self._timer: asyncio.TimerHandle | None = None

    @property
    def received(self) -> dict[int, int]:
        """Messages heard, by id."""
        return self._base.heard

    @property
    def _faults(self) -> FaultInjector:
        return self._base.injector

    @_faults.setter
    def _faults(self, injector: FaultInjector) -> None:
        self._base.injector = injector

    def silence(self, for_s: float) -> None:
        """Neither hear nor say anything for a while."""
        self._base.silence(time.monotonic_ns() + round(for_s * 1e9))

    def unplug(self) -> None:
        self._base.plugged = False
        self._bus.plug(plugged=False)

    def plug(self) -> None:
        self._base.plugged = True
        self._bus.plug(plugged=True)

    def kill_switch(self) -> None:
        self._base.model.kill_switch()

    def power_off(self) -> None:
        self._base.model.power_off()

    def power_on(self) -> None:
        self._base.model.power_on(time.monotonic_ns())

    async def open(self) -> None:
        """Join the wire; the plan's seconds count from here."""
        await self._bus.open(self._receive)
        self._base.start(time.monotonic_ns())

    async def close(self) -> None:
        if self._timer:
            self._timer.cancel()
        await self._bus.close()

    async def run(self) -> None:
        """Tick until cancelled."""
        while True:
            self._advance(time.monotonic_ns())
            await asyncio.sleep(DT)

    def _advance(self, now_ns: int) -> None:
        plugged = self._base.plugged
        self._base.step(now_ns)
        if self._base.plugged is not plugged:
            self._bus.plug(plugged=self._base.plugged)
        self._send_due(now_ns)

    def _receive(self, stamp_ns: int, message: Message) -> None:
        self._base.receive(stamp_ns, message)
        self._send_due(stamp_ns)

    def _send_due(self, now_ns: int) -> None:
        for burst in self._base.due(now_ns):
            self._bus.send(burst.messages)
        due_ns = self._base.next_due_ns
        if self._timer:
            self._timer.cancel()
            self._timer = None
        if due_ns is not None:
            loop = asyncio.get_running_loop()
            self._timer = loop.call_later(max(0.0, (due_ns - now_ns) / 1e9), self._send_later)

    def _send_later(self) -> None:
        self._timer = None
        self._send_due(time.monotonic_ns())


class SimulatedRmp(SimulatedBase[Frame]):
    """A base on CAN. The world reads `model.twist` and may `model.block()`."""

    def __init__(self, bus: SimulatorBus[Frame], model: RmpModel, plan: FaultPlan) -> None:
        super().__init__(bus, model, plan, FOREIGN)
        self.model = model

    @property
    def port(self) -> int:
        """TCP port of the socketcand server; 0 on other buses."""
        return self._bus.port if isinstance(self._bus, SocketcandServer) else 0


@asynccontextmanager
async def serve(
    interface: str = "socketcand",
    channel: str = "can0",
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    model: RmpModel | None = None,
    plan: FaultPlan | None = None,
    **options: Any,
) -> AsyncIterator[SimulatedRmp]:
    """A running simulated base; with `socketcand` it is itself the server, on `host`:`port` (0: a free one).

    Raises RmpInterfaceError or OSError where the bus cannot be had.
    """
    bus: SimulatorBus[Frame]
    if interface == "socketcand":
        bus = SocketcandServer(channel, host, port)
    else:
        bus = PythonCanBus(interface, channel, options)
    base = SimulatedRmp(bus, model or RmpModel(time.monotonic_ns()), plan or FaultPlan())
    async with running(base):
        yield base


class SimulatedV3(SimulatedBase[bytes]):
    """A base with V3 firmware on Ethernet or USB."""

    def __init__(self, wire: UdpWire | PtyWire, model: V3Model, plan: FaultPlan) -> None:
        super().__init__(wire, model, plan)
        self._wire = wire
        self.model = model

    @property
    def port(self) -> int:
        """UDP port; 0 on a serial device."""
        return self._wire.port if isinstance(self._wire, UdpWire) else 0

    def _advance(self, now_ns: int) -> None:
        super()._advance(now_ns)
        if self.model.take_notices() and isinstance(self._wire, UdpWire):
            self._wire.give_notice()


@asynccontextmanager
async def serve_v3(
    wire: UdpWire | PtyWire, *, model: V3Model | None = None, plan: FaultPlan | None = None
) -> AsyncIterator[SimulatedV3]:
    """A running simulated base with V3 firmware. Raises OSError where the wire cannot be had."""
    base = SimulatedV3(wire, model or V3Model(time.monotonic_ns()), plan or FaultPlan())
    async with running(base):
        yield base


@asynccontextmanager
async def running(base: SimulatedBase[Message]) -> AsyncIterator[None]:
    """A base on its wire, ticking."""
    await base.open()
    ticking = asyncio.create_task(base.run(), name="simulated-rmp110")
    try:
        yield
    finally:
        ticking.cancel()
        await asyncio.wait({ticking})
        await base.close()
        if not ticking.cancelled():
            ticking.result()
