"""A simulated base that runs: model, bus and faults brought to life by a clock.

async with serve("socketcand") as base:
    ...  # clients reach it at 127.0.0.1, port base.port, channel can0
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.simulator.bus import PythonCanBus, SimulatorBus
from drivers.rmp110.simulator.dynamics import DT
from drivers.rmp110.simulator.faults import FaultInjector, FaultPlan, within
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.socketcand_server import SocketcandServer


class SimulatedRmp:
    """A base on a bus. The world reads `model.twist` and may `model.block()`; faults come from the plan or by call."""

    def __init__(self, bus: SimulatorBus, model: RmpModel, plan: FaultPlan) -> None:
        self.model = model
        self._bus = bus
        self._faults = FaultInjector(plan)
        self._started = time.monotonic()
        self._silent_until = 0.0
        self._plugged = True
        self._killed = False
        self._cycled = 0
        self.received: dict[int, int] = {}
        """Frames heard, by CAN id."""

    @property
    def port(self) -> int:
        """TCP port of the socketcand server; 0 on other buses."""
        return self._bus.port if isinstance(self._bus, SocketcandServer) else 0

    def silence(self, for_s: float) -> None:
        """Hear and say nothing for a while."""
        self._silent_until = time.monotonic() + for_s

    def unplug(self) -> None:
        self._plugged = False
        self._bus.plug(plugged=False)

    def plug(self) -> None:
        self._plugged = True
        self._bus.plug(plugged=True)

    def kill_switch(self) -> None:
        self.model.kill_switch()

    def power_off(self) -> None:
        self.model.power_off()

    def power_on(self) -> None:
        self.model.power_on(time.monotonic_ns())

    async def open(self) -> None:
        """Join the bus; the plan's seconds count from here."""
        await self._bus.open(self._receive)
        self._started = time.monotonic()

    async def close(self) -> None:
        await self._bus.close()

    async def run(self) -> None:
        """Tick until cancelled."""
        while True:
            self.model.step(time.monotonic_ns())
            self._follow_plan(time.monotonic() - self._started)
            await asyncio.sleep(DT)

    def _follow_plan(self, elapsed_s: float) -> None:
        plan = self._faults.plan
        if plan.unplugs:
            unplugged = within(plan.unplugs, elapsed_s)
            if unplugged is self._plugged:
                (self.unplug if unplugged else self.plug)()
        if plan.kill_at_s is not None and elapsed_s >= plan.kill_at_s and not self._killed:
            self._killed = True
            self.kill_switch()
        if self._cycled < len(plan.power_cycles):
            begin, length = plan.power_cycles[self._cycled]
            if elapsed_s >= begin + length:
                self._cycled += 1
                self.power_on()
            elif elapsed_s >= begin and self.model.powered:
                self.power_off()

    def _receive(self, stamp_ns: int, frame: Frame) -> None:
        now = time.monotonic()
        if now < self._silent_until or within(self._faults.plan.silences, now - self._started):
            return
        self.received[frame.can_id] = self.received.get(frame.can_id, 0) + 1
        frames = self._faults.mangle(self.model.receive(stamp_ns, frame))
        delay_s = self._faults.delay_s()
        if delay_s:
            asyncio.get_running_loop().call_later(delay_s, self._bus.send, frames)
        else:
            self._bus.send(frames)


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
    bus: SimulatorBus
    if interface == "socketcand":
        bus = SocketcandServer(channel, host, port)
    else:
        bus = PythonCanBus(interface, channel, options)
    base = SimulatedRmp(bus, model or RmpModel(time.monotonic_ns()), plan or FaultPlan())
    await base.open()
    ticking = asyncio.create_task(base.run(), name="simulated-rmp110")
    try:
        yield base
    finally:
        ticking.cancel()
        await asyncio.wait({ticking})
        await base.close()
        if not ticking.cancelled():
            ticking.result()
