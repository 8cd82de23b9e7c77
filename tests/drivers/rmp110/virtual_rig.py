"""A driver and a simulated base in simulated time: a test of minutes takes milliseconds, and luck has no part."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, cast

import pytest

from drivers.rmp110 import Rmp110, Rmp110Config
from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.frames import Frame
from drivers.rmp110.codec.parameters import RMP110_STORED, Stored
from drivers.rmp110.codec.vocabulary import VOCABULARIES
from drivers.rmp110.codec.whitelist import forbidden
from drivers.rmp110.device.watchdog import Watchdog
from drivers.rmp110.errors import RmpForbiddenFrame
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.transport.base import Guard
from tests.virtual_time.clock import Clock, VirtualLoop, run
from tests.virtual_time.wire import OnWire, VirtualBus, VirtualTransport

READY_S = 5.0
BRISK = {**RMP110_STORED, "max_accel": 4.0, "max_decel": 4.0, "max_yaw_accel": 8.0}
CONFIG = Rmp110Config(expected=BRISK, backoff_s=(0.05, 0.1))


def virtual_time(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Run a coroutine test in a loop whose time is simulated."""

    @functools.wraps(test)
    def wrapper(*args: Any, **named: Any) -> None:
        run(test(*args, **named))

    return wrapper


def clock() -> Clock:
    """Of the running loop."""
    return cast(VirtualLoop, asyncio.get_running_loop()).clock


async def until(condition: Callable[[], object], timeout_s: float = 5.0) -> None:
    """Wait for a condition; fails the test where it does not come true."""
    end_ns = clock().now_ns + round(timeout_s * 1e9)
    while not condition():
        if clock().now_ns > end_ns:
            pytest.fail(f"not within {timeout_s} s")
        await asyncio.sleep(0.002)


async def drive(base: Rmp110, v: float, w: float, seconds: float) -> None:
    """Motion with 50 Hz, as the control loop sends it."""
    for _ in range(round(seconds / 0.02)):
        base.send_motion(v, w)
        await asyncio.sleep(0.02)


class GuardedTransport(VirtualTransport):
    """With the whitelist that a real one has."""

    def __init__(self, bus: VirtualBus) -> None:
        super().__init__(bus)
        self.guard: Guard = forbidden

    def send(self, frame: Frame) -> None:
        reason = self.guard(frame)
        if reason:
            raise RmpForbiddenFrame(reason)
        super().send(frame)


@dataclass
class Rig:
    """A base on a bus of one's own; `wire` is what really was on it."""

    bus: VirtualBus
    wire: list[OnWire]

    def device(self, config: Rmp110Config = CONFIG, hook: Any = None) -> Rmp110:
        return Rmp110(lambda: GuardedTransport(self.bus), config, hook, clock=clock().read, watchdog=Watchdog)

    @property
    def model(self) -> RmpModel:
        return self.bus.model

    def sent(self, can_id: int, since_ns: int = 0) -> list[bytes]:
        """Data of our frames with this id, as the base saw them."""
        return [f.data for f in self.wire if f.to_base and f.can_id == can_id and f.stamp_ns >= since_ns]

    async def silence(self, seconds: float) -> None:
        """The base neither hears nor says anything for a while."""
        self.bus.silent = self.bus.deaf = True
        await asyncio.sleep(seconds)
        self.bus.silent = self.bus.deaf = False


@asynccontextmanager
async def rig(
    *,
    stored: dict[str, float] | None = None,
    compact: bool = True,
    boot_s: float = 0.0,
    dialect: Dialect = Dialect.B2,
) -> AsyncIterator[Rig]:
    book = VOCABULARIES[dialect]
    bitmaps = book.compact_bitmaps if compact else book.factory_bitmaps
    values = {**BRISK, **{f"feedback_bitmap_{n}": word for n, word in enumerate(bitmaps, start=1)}, **(stored or {})}
    known = {parameter.name for parameter in book.parameters}
    words = Stored.of({n: v for n, v in values.items() if n in known}, parameters=book.parameters)
    wire: list[OnWire] = []
    model = RmpModel(clock().now_ns, words, boot_s=boot_s, dialect=dialect)
    yield Rig(VirtualBus(clock(), model, wire.append), wire)
