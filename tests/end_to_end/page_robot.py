"""A whole simulated robot with its page, in processes of its own, and what tests of the page ask of it."""

from __future__ import annotations

import asyncio
import json
import re
import struct
import sys
import time
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ghal360_robot.bench.browser import EXECUTABLE
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.telepresence.page_process import BUILT

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from ghal360_robot.bench.browser import Tab

START_S = 60.0
LIVE = "(ms => ms !== null && ms < 500)(globalThis.telepresence?.quality?.picture_ms ?? null)"
END_S = 30.0

WHY_NOT = (
    "there is no Chromium: apt install chromium"
    if EXECUTABLE is None
    else "the page is not built: make page"
    if not (BUILT / "index.html").is_file()
    else ""
)
"""Why tests of the page cannot run here; empty if they can."""


@dataclass
class PageRobot:
    """A robot that runs; after the context `report` says how it was."""

    url: str
    process: asyncio.subprocess.Process
    said: list[str] = field(default_factory=list)
    report: dict[str, Any] = field(default_factory=dict)

    @property
    def recording(self) -> Path:
        return Path(self.report["recording"])

    def motion(self) -> list[tuple[int, tuple[float, float]]]:
        """Every motion frame on the bus: when, and speed and turn as shares of the base's limits."""
        with RunReader(self.recording) as reader:
            frames = [f for f in reader.can_frames() if f.direction == "tx" and f.can_id == 0x500]
        return [(frame.stamp_ns, struct.unpack(">2f", frame.data)) for frame in frames]


@asynccontextmanager
async def page_robot(folder: Path, *words: str, config: str = "") -> AsyncIterator[PageRobot]:
    """`ghal360 run --sim --operator page` with these words and settings, from start to its report."""
    settings = folder / "robot.toml"
    settings.write_text(config or "[page]\nport = 0\n")
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "ghal360_robot", "run", "--sim", "--operator", "page", "--json",
        "--config", str(settings), "--record", str(folder), *words,
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, limit=1 << 20,
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stderr is not None
    robot = PageRobot("", process)
    listening = asyncio.create_task(_listen(robot, process.stderr))
    collecting = asyncio.create_task(process.stdout.read())
    try:
        deadline = time.monotonic() + START_S
        while not robot.url:
            assert process.returncode is None, "\n".join(robot.said)
            assert time.monotonic() < deadline, "\n".join(robot.said)
            await asyncio.sleep(0.05)
        yield robot
        process.terminate()
        await asyncio.wait_for(process.wait(), END_S)
        await listening
        assert process.returncode == 0, "\n".join(robot.said)
        robot.report = json.loads((await collecting).decode().strip().splitlines()[-1])
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
        listening.cancel()
        collecting.cancel()


async def _listen(robot: PageRobot, stream: asyncio.StreamReader) -> None:
    while line := (await stream.readline()).decode(errors="replace"):
        robot.said.append(line.rstrip())
        found = re.search(r"the page is at (\S+)", line)
        if found:
            robot.url = found[1]


async def opened(tab: Tab, url: str) -> Tab:
    """The page, with a live picture on it and the robot's state known."""
    await tab.goto(url)
    await tab.until(LIVE, "a live picture", 40)
    await tab.until("telepresence.state !== undefined && document.querySelector('#take').disabled === false", "rights")
    return tab


async def armed(tab: Tab) -> None:
    """Take the controls and arm, as often as a busy machine makes the robot doubt its inputs."""
    if not await tab.evaluate("telepresence.right.yours"):
        await tab.press("t")
        await tab.until("telepresence.right.yours", "the controls")
    await tab.until("telepresence.state.blockers.length === 0 || telepresence.state.arm === 'armed'", "ready", 40)
    for _ in range(20):
        await tab.press("Enter")
        await asyncio.sleep(0.3)
        if await tab.evaluate("telepresence.state.arm") == "armed":
            return
    raise AssertionError(f"never armed: {await tab.evaluate('telepresence.state')}")


async def turning(tab: Tab, key: str = "a") -> None:
    """Hold the key until the robot turns; once more where a picture was late in between."""
    for _ in range(10):
        await armed(tab)
        await tab.key("down", key)
        for _ in range(40):
            speed = await tab.evaluate("telepresence.state.speed")
            if speed and max(abs(speed["w"]), abs(speed["v"])) > 0.15:
                return
            await asyncio.sleep(0.05)
        await tab.key("up", key)
        await asyncio.sleep(0.3)
    raise AssertionError(f"never turned: {await tab.evaluate('[telepresence.state, telepresence.quality]')}")
