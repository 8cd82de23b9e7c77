"""A simulated base on a bus, and transports that reach it."""

from __future__ import annotations

import asyncio
import itertools
import os
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from drivers.rmp110 import CanTransport, Rmp110Config
from drivers.rmp110.codec.dialect import Dialect
from drivers.rmp110.codec.feedback import COMPACT_BITMAPS
from drivers.rmp110.codec.parameters import RMP110_STORED, Stored
from drivers.rmp110.device import identify
from drivers.rmp110.simulator.faults import FaultPlan
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.serve import SimulatedRmp, serve
from drivers.rmp110.transport import bus_lock

_channels = itertools.count()
BRISK = {**RMP110_STORED, "max_accel": 4.0, "max_decel": 4.0, "max_yaw_accel": 8.0}
"""An RMP 110 that needs no second to get going, so that the tests do not either."""
COMPACT_STORED = {f"feedback_bitmap_{n}": word for n, word in enumerate(COMPACT_BITMAPS, start=1)}


@dataclass
class Rig:
    """A running simulated base and the way to it."""

    sim: SimulatedRmp
    interface: str
    channel: str

    def transport(self, *, exclusive: bool = True) -> CanTransport:
        """A way to the base; not `exclusive` for somebody who does not care who else drives."""
        options = {"host": "127.0.0.1", "port": self.sim.port} if self.interface == "socketcand" else {}
        return CanTransport(self.interface, self.channel, exclusive=exclusive, **options)  # type: ignore[arg-type]


@pytest.fixture(autouse=True)
def own_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Locks of this test only: other programs on this machine may use the same names."""
    monkeypatch.setattr(bus_lock, "lock_directories", lambda: (tmp_path,))


@asynccontextmanager
async def make_rig(
    interface: str = "virtual",
    *,
    stored: dict[str, float] | None = None,
    compact: bool = True,
    boot_s: float = 0.0,
    dialect: Dialect = Dialect.B2,
    plan: FaultPlan | None = None,
) -> AsyncIterator[Rig]:
    channel = f"rmp110-test-{os.getpid()}-{next(_channels)}"
    values = {**BRISK, **(COMPACT_STORED if compact else {}), **(stored or {})}
    model = RmpModel(time.monotonic_ns(), Stored.of(values), boot_s=boot_s, dialect=dialect)
    async with serve(interface, channel, model=model, plan=plan) as sim:
        yield Rig(sim, interface, channel)


@pytest.fixture(name="rig")
def rig_maker() -> object:
    """`async with rig(...) as it:` with a bus of its own for every test."""
    return make_rig


@pytest.fixture
def config() -> Rmp110Config:
    return Rmp110Config(expected=BRISK, backoff_s=(0.05, 0.1))


@pytest.fixture
def short_listening(monkeypatch: pytest.MonkeyPatch) -> None:
    """Most tests have nobody else on the bus."""
    monkeypatch.setattr(identify, "LISTEN_S", 0.05)


async def until(condition: Callable[[], object], timeout_s: float = 5.0) -> None:
    """Wait for a condition; fails the test where it does not come true."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f"not within {timeout_s} s")
        await asyncio.sleep(0.005)


@pytest.fixture(name="until")
def until_fixture() -> object:
    return until
