"""How late the telepresence page is: a whole robot with a THETA's own bit rate, and real browsers, on this machine.

The devices are simulated at their wires, the robot and its page are the processes they always are, the browser is a
Chromium that draws without a GPU. All of them share this machine's cores, which a robot and its operator do not.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ghal360_robot.bench.browser import Browser, BrowserError, Tab, chromium
from ghal360_robot.bench.processor_time import cores_between, seconds_used
from ghal360_robot.bench.stand import CAMERA_HZ, Stand
from ghal360_robot.errors import GhalError
from ghal360_robot.simulation.encoder import ThetaEncoder

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Sequence

    from numpy.typing import NDArray

SIZES = {"2k": (1920, 960, 42_000_000), "4k": (3840, 1920, 120_000_000)}
"""Width, height and bits a second of the camera's two modes (fact sheet on telepresence, finding 2)."""

NOISE = 42
"""Of 255 levels; enough for the encoder to need all the bits it is given."""

DECODED_MS = (40.0, 80.0)
"""Budget from an access unit's arrival at the robot to its decoded frame on the page: p50 and p95."""
ROUND_TRIP_MS = 30.0
"""Budget of the control round trip, p95."""
TICK_MS = 5.0
"""Budget of the control tick's lateness, p99."""

START_S = 60.0
WARM_S = 4.0
"""Browsers compile their shaders and the clock is estimated."""
END_S = 30.0


class PageBenchError(GhalError):
    """There was nothing to measure."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Milliseconds of many samples."""

    count: int
    p50: float
    p95: float
    p99: float
    max: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        if not values:
            raise PageBenchError("the page showed no picture, or heard nothing of the robot: nothing was measured")
        p50, p95, p99 = np.percentile(values, (50, 95, 99)).tolist()
        return cls(len(values), round(p50, 1), round(p95, 1), round(p99, 1), round(max(values), 1))

    def to_json(self) -> dict[str, float]:
        return {"count": self.count, "p50": self.p50, "p95": self.p95, "p99": self.p99, "max": self.max}


@dataclass(frozen=True, slots=True)
class PageCost:
    """What was measured on all pages together, and the robot's own report."""

    decoded: Spread
    """From an access unit's arrival at the robot to its decoded frame."""
    drawn: Spread
    """To the frame that draws it."""
    round_trip: Spread
    tick: dict[str, float]
    fps: float
    """Pictures decoded a second, the slowest page's."""
    dropped: int
    pages: int
    cores: dict[str, float]
    """Kept busy meanwhile, by whom."""
    report: dict[str, Any]

    @property
    def missed(self) -> list[str]:
        """Which budgets were."""
        checks = (
            ("decoded p50", self.decoded.p50, DECODED_MS[0]),
            ("decoded p95", self.decoded.p95, DECODED_MS[1]),
            ("round trip p95", self.round_trip.p95, ROUND_TRIP_MS),
            ("tick lateness p99", self.tick["p99"], TICK_MS),
        )
        return [f"{name} {value:g} ms (at most {limit:g})" for name, value, limit in checks if value > limit]

    def to_json(self) -> dict[str, Any]:
        return {
            "passed": not self.missed,
            "missed": self.missed,
            "pages": self.pages,
            "decoded_ms": self.decoded.to_json(),
            "drawn_ms": self.drawn.to_json(),
            "round_trip_ms": self.round_trip.to_json(),
            "tick_lateness_ms": self.tick,
            "ticks_skipped": self.report["ticks_skipped"],
            "fps": self.fps,
            "dropped": self.dropped,
            "cores_busy": self.cores,
            "camera": self.report["theta"],
        }


def film(mode: str) -> list[bytes]:
    """One second as heavy as the camera's, that may be shown again and again; grey, with nothing painted to detect."""
    width, height, bit_rate = SIZES[mode]
    rng = np.random.default_rng(0)
    scene = rng.integers(0, 128, (height // 8, width // 8), np.uint8).repeat(8, 0).repeat(8, 1)
    with ThetaEncoder(width, height, CAMERA_HZ, bit_rate) as encoder:
        second = round(CAMERA_HZ)
        units = [encoder.encode(_noisy(np.roll(scene, (3 * k, 11 * k), (0, 1)), rng)) for k in range(2 * second)]
    return units[second:]  # in the first its rate control has not settled


def _noisy(scene: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """As a camera's pictures are: what is new in each cannot be guessed from the one before."""
    grey = scene + rng.integers(0, NOISE, scene.shape, np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


async def measure(seconds: float, pages: int, mode: str, size: tuple[int, int]) -> PageCost:
    """Run robot and browser, and look. Raises GhalError where either does not come up."""
    units = await asyncio.to_thread(film, mode)
    with tempfile.TemporaryDirectory(prefix="ghal360-bench-") as folder:
        async with Stand(units) as stand, _robot(stand, Path(folder), mode) as robot, chromium(niceness=15) as browser:
            tabs = [await _open(browser, robot.url, size) for _ in range(pages)]
            await asyncio.sleep(WARM_S)
            for tab in tabs:
                await tab.evaluate("telepresence.forget()")
            began, before = time.monotonic(), seconds_used(os.getpid())
            await asyncio.sleep(seconds)
            took, after = time.monotonic() - began, seconds_used(os.getpid())
            seen = [await tab.evaluate("telepresence.measured()") for tab in tabs]
            report = await robot.end()
    return PageCost(
        decoded=Spread.of([value for page in seen for value in page["decoded"]]),
        drawn=Spread.of([value for page in seen for value in page["drawn"]]),
        round_trip=Spread.of([value for page in seen for value in page["roundTrips"]]),
        tick=report["tick_lateness_ms"],
        fps=min(round(len(page["decoded"]) / seconds, 1) for page in seen),
        dropped=sum(page["dropped"] for page in seen),
        pages=pages,
        cores=cores_between(before, after, took),
        report=report,
    )


async def _open(browser: Browser, url: str, size: tuple[int, int]) -> Tab:
    """In a window of its own: what is hidden shows nothing."""
    tab = await browser.tab(size=size, window=True)
    await tab.goto(url)
    try:
        await tab.until("(globalThis.telepresence?.pictureUs ?? 0) > 0", "a picture", START_S)
    except BrowserError as error:
        raise PageBenchError(f"the page does not come up: {error}; {'; '.join(tab.console[-3:])}") from error
    return tab


class _Robot:
    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process
        self.url = ""
        self.said: list[str] = []
        self._known = asyncio.Event()

    async def end(self) -> dict[str, Any]:
        self.process.send_signal(signal.SIGTERM)
        if self.process.stdout is None:
            raise RuntimeError("no pipe")
        out = await asyncio.wait_for(self.process.stdout.read(), END_S)
        await self.process.wait()
        try:
            report: dict[str, Any] = json.loads(out.decode().strip().splitlines()[-1])
        except (ValueError, IndexError) as error:
            raise PageBenchError(f"the robot ended without its report: {self.last_words}") from error
        return report

    async def listen(self) -> None:
        if self.process.stderr is None:
            raise RuntimeError("no pipe")
        while line := (await self.process.stderr.readline()).decode(errors="replace").strip():
            self.said.append(line)
            found = re.search(r"the page is at (\S+)", line)
            if found:
                self.url = found[1]
                self._known.set()
        self._known.set()

    async def ready(self) -> None:
        """Wait until it says where its page is. Raises PageBenchError."""
        try:
            await asyncio.wait_for(self._known.wait(), START_S)
        except TimeoutError as error:
            raise PageBenchError(f"the robot is not ready within {START_S:g} s: {self.last_words}") from error
        if not self.url:
            raise PageBenchError(f"the robot does not start: {self.last_words}")

    @property
    def last_words(self) -> str:
        return "; ".join(self.said[-3:])


@contextlib.asynccontextmanager
async def _robot(stand: Stand, folder: Path, mode: str) -> AsyncIterator[_Robot]:
    ports = stand.endpoints
    settings = folder / "robot.toml"
    settings.write_text(
        f'[theta]\ntransport = "usbip"\nport = {ports.theta}\nresolution = "{mode}"\n'
        f'[tim571]\nhost = "127.0.0.1"\nport = {ports.tim571}\n'
        f'[rmp110]\ninterface = "socketcand"\nhost = "127.0.0.1"\nport = {ports.rmp110}\n'
        '[perception]\ndetector = "painted"\n[page]\nport = 0\n',
        encoding="ascii",
    )
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "ghal360_robot", "run", "--operator", "page", "--json", "--config", str(settings),
        "--record", str(folder), stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, limit=1 << 20,
    )  # fmt: skip
    robot = _Robot(process)
    listening = asyncio.create_task(robot.listen())
    try:
        await robot.ready()
        yield robot
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        listening.cancel()
