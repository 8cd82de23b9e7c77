"""The page's server with a film for a camera and made-up states for a robot: for what needs no robot to be tested."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from ghal360_robot.messages import (
    STILL,
    Applied,
    ArmState,
    BaseMode,
    BaseState,
    Cue,
    Decision,
    Freshness,
    Inputs,
    LinkStats,
    Pose2,
)
from ghal360_robot.simulation.encoder import ThetaEncoder
from ghal360_robot.telepresence.frames import Frame
from ghal360_robot.telepresence.hub import Hub
from ghal360_robot.telepresence.page_process import BUILT
from ghal360_robot.telepresence.server import PageServer
from ghal360_robot.telepresence.settings import PageSettings
from ghal360_robot.telepresence.state import STEPS, state
from ghal360_robot.telepresence.streams import Streams

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from ghal360_robot.bench.browser import Tab
    from ghal360_robot.telepresence.access import Sessions

FRESH = Freshness(alive=True, rate_ok=True, valid=True, age_s=0.02)
DEVICES = ("theta", "tim571", "rmp110")
SMALL = (640, 360)
"""Of a tab in which nothing has to be read."""
CALM = Decision(Cue.NONE, None, (0,) * 8, None, (0.125,) * 8, None, STILL, ())
REST = Applied(STILL, ArmState.DISARMED, ("not armed yet",))


@cache
def film(width: int, height: int, rate_hz: float, bit_rate: int) -> list[bytes]:
    """One second that may be shown again and again; noise makes it as heavy as it is told to be."""
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (height, width, 3), np.uint8)
    with ThetaEncoder(width, height, rate_hz, bit_rate) as encoder:
        units = []
        for k in range(round(rate_hz)):
            picture = np.roll(noise, 7 * k, axis=1) if bit_rate > 10**7 else np.full_like(noise, 60)
            cv2.circle(picture, (width // 2 + 3 * k, height // 2), height // 10, (0, 200, 255), -1)
            units.append(encoder.encode(picture))
    return units


@dataclass
class PageStand:
    """What the pages asked for is in `told`; `decision` and `applied` are what they are shown."""

    server: PageServer
    streams: Streams
    told: list[tuple[str, Any]] = field(default_factory=list)
    decision: Decision = CALM
    applied: Applied = REST
    blockers: tuple[str, ...] = ()
    sequence: int = 0
    frozen: bool = False
    yaw: float = 0.0
    """The base's."""
    approaching: tuple[float, ...] = ()
    links: dict[str, LinkStats] = field(default_factory=lambda: dict.fromkeys(DEVICES, LinkStats("streaming")))

    @property
    def url(self) -> str:
        scheme = "https" if self.server.settings.tls else "http"
        return f"{scheme}://127.0.0.1:{self.server.port}/"

    @property
    def wish(self) -> dict[str, Any]:
        """The newest that counted."""
        return next((value for kind, value in reversed(self.told) if kind == "operator"), {})

    def said(self, kind: str) -> list[Any]:
        return [value for said, value in self.told if said == kind]

    async def until(self, condition: Any, what: str, timeout_s: float = 10.0) -> None:
        deadline = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline, f"waited {timeout_s} s for: {what}"
            await asyncio.sleep(0.01)

    def arm(self, *, twist: Any = STILL, reasons: tuple[str, ...] = ()) -> None:
        self.applied = Applied(twist, ArmState.ARMED, reasons)

    async def show(self, units: list[bytes], size: tuple[int, int], rate_hz: float) -> None:
        """The camera."""
        due = time.monotonic()
        while True:
            unit = units[self.sequence % len(units)]
            frame = Frame(unit, time.monotonic_ns(), self.sequence, *size, self.sequence % len(units) == 0)
            self.sequence += 1
            if not self.frozen:
                self.streams.feed(frame)
            due = max(due + 1.0 / rate_hz, time.monotonic() - 0.1)
            await asyncio.sleep(max(0.0, due - time.monotonic()))

    async def live(self) -> None:
        """The robot."""
        tick, before, cue_ns = 0, Cue.NONE, 0
        while True:
            now_ns = time.monotonic_ns()
            base = BaseState(now_ns, BaseMode.STANDBY, Pose2(0.0, 0.0, self.yaw), STILL, 80.0)
            inputs = Inputs(now_ns, tick, base, None, None, None, dict.fromkeys(DEVICES, FRESH))
            cue_ns, before = (now_ns if self.decision.cue is not before else cue_ns), self.decision.cue
            told = state(
                inputs, self.decision, self.applied, blockers=self.blockers,
                links=self.links, found=False, cue_ns=cue_ns, target="backpack",
                approaching=self.approaching,
            )  # fmt: skip
            self.server.hub.broadcast("state", json.dumps({"kind": "state", **told}))
            if tick % 3 == 0:
                ring = {"kind": "scan", "t_us": now_ns // 1000, "first": -3.14159, "step": 6.28318 / STEPS}
                self.server.hub.broadcast("scan", json.dumps({**ring, "cm": [150] * STEPS}))
            tick += 1
            await asyncio.sleep(0.05)


@asynccontextmanager
async def page_stand(
    settings: PageSettings | None = None,
    *,
    sessions: Sessions | None = None,
    size: tuple[int, int] = (640, 320),
    rate_hz: float = 15.0,
    bit_rate: int = 1_000_000,
) -> AsyncIterator[PageStand]:
    """A server that listens, a camera that films, a robot that stands."""
    settings = replace(settings or PageSettings(), port=0)
    told: list[tuple[str, Any]] = []
    hub = Hub(settings, lambda kind, value: told.append((kind, value)), time.monotonic_ns)
    streams = Streams(settings)
    server = PageServer(settings, hub, streams, sessions, BUILT)
    stand = PageStand(server, streams, told)
    units = film(*size, rate_hz, bit_rate)
    await server.start()
    works = (server.beat(), stand.show(units, size, rate_hz), stand.live())
    tasks = [asyncio.create_task(work) for work in works]
    try:
        with streams:
            yield stand
            for task in tasks:
                assert not task.done(), task.exception()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(OSError):
            await server.close()


def text(selector: str) -> str:
    return f"document.querySelector({json.dumps(selector)}).innerText"


def visible(selector: str) -> str:
    return f"!document.querySelector({json.dumps(selector)}).hidden"


async def takes_the_controls(tab: Tab) -> None:
    await tab.click("#take")
    await tab.until("telepresence.right.yours", "the controls")


async def holds(tab: Tab, stand: PageStand, key: str = "f") -> None:
    """Press until it counts: a picture that is late on a busy machine makes every press void."""
    for _ in range(10):
        await tab.key("down", key)
        with contextlib.suppress(AssertionError):
            await stand.until(lambda: stand.wish.get("deadman"), "driving", 2.0)
            return
        await tab.key("up", key)
        await asyncio.sleep(0.2)
    raise AssertionError(f"it never counted: {await tab.evaluate('telepresence.quality')}")
