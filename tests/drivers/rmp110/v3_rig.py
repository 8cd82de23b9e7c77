"""The same with a V3 base: packets instead of frames, and a stream that nobody asks for twice."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from drivers.rmp110 import Rmp110, Rmp110Config
from drivers.rmp110.codec.bytestream import pack_command
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import Stored
from drivers.rmp110.codec.v3.packets import POWER_DOWN, POWERING_DOWN, parse_packet
from drivers.rmp110.codec.v3.whitelist import forbidden
from drivers.rmp110.codec.v3.words import PARAMETERS
from drivers.rmp110.device.watchdog import Watchdog
from drivers.rmp110.errors import RmpForbiddenFrame
from drivers.rmp110.simulator.v3_model import V3Model
from tests.drivers.rmp110.virtual_rig import BRISK, clock

CONFIG_V3 = Rmp110Config(expected=BRISK, backoff_s=(0.05, 0.1), protocol="v3")


@dataclass
class V3Rig:
    """A V3 base and the way to it: packets both ways, 1 ms late; the attributes are the faults."""

    model: V3Model
    sent: list[Frame] = field(default_factory=list)
    silent: bool = False

    def __post_init__(self) -> None:
        self._clock = clock()
        self._loop = asyncio.get_running_loop()
        self._open: V3Transport | None = None
        self._tick()

    def device(self, config: Rmp110Config = CONFIG_V3, hook: Any = None) -> Rmp110:
        return Rmp110(lambda: V3Transport(self), config, hook, clock=clock().read, watchdog=Watchdog)

    def attach(self, transport: V3Transport | None) -> None:
        self._open = transport

    def take(self, frame: Frame) -> None:
        reason = forbidden(frame)
        if reason:
            raise RmpForbiddenFrame(reason)
        self.sent.append(frame)
        if not self.silent:
            self._deliver(self.model.receive(self._clock.now_ns, pack_command(frame)))

    def _tick(self) -> None:
        self.model.step(self._clock.now_ns)
        for _, packets in self.model.take_unsolicited():
            self._deliver(packets)
        for _ in range(self.model.take_notices()):
            self._loop.call_later(0.001, self._hand_over, Frame(POWERING_DOWN, POWER_DOWN))
        self._loop.call_later(0.01, self._tick)

    def _deliver(self, packets: tuple[bytes, ...]) -> None:
        for packet in packets:
            frame = parse_packet(packet)
            assert frame is not None
            self._loop.call_later(0.001, self._hand_over, frame)

    def _hand_over(self, frame: Frame) -> None:
        if self._open and not self.silent:
            self._open.on_frame(self._clock.now_ns, frame)


class V3Transport:
    """A `Transport` of the driver to that base."""

    damaged = 0

    def __init__(self, rig: V3Rig) -> None:
        self._rig = rig

    async def open(self, on_frame: Callable[[int, Frame], None], on_lost: Callable[[str], None]) -> None:
        self.on_frame = on_frame
        self._rig.attach(self)

    def send(self, frame: Frame) -> None:
        self._rig.take(frame)

    async def close(self) -> None:
        self._rig.attach(None)


def v3_rig(values: dict[str, float] | None = None, **options: Any) -> V3Rig:
    known = {parameter.name for parameter in PARAMETERS}
    named = {n: v for n, v in {**BRISK, "input_bitmap": 0, **(values or {})}.items() if n in known}
    return V3Rig(V3Model(clock().now_ns, Stored.of(named, parameters=PARAMETERS), boot_s=0.0, **options))
