"""A whole search through the page: an operator who knows only what it shows, on a simulated robot."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import os
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from ghal360_robot.bench.browser import chromium
from ghal360_robot.bench.processor_time import below
from ghal360_robot.logbook.reader import RunReader
from tests.end_to_end.page_robot import LIVE, WHY_NOT, armed, opened, page_robot, turning

if TYPE_CHECKING:
    from ghal360_robot.bench.browser import Tab

pytestmark = [
    pytest.mark.page,
    pytest.mark.timeout(400),
    pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT),
]

SEARCH = ("--target", "backpack", "--seed", "1")
"""The backpack can be seen from the start, behind the robot and out of the operator's view."""

SEARCH_S = 180.0
CUE_SHOWN_MS = 200.0

SCREEN = """({
  left: !document.querySelector('#cue-left').hidden,
  right: !document.querySelector('#cue-right').hidden,
  confirm: !document.querySelector('#cue-confirm').hidden,
  found: document.querySelector('#banners').innerText.includes('target found'),
  armed: document.querySelector('#arm-text').innerText.includes('armed') &&
         !document.querySelector('#arm-text').innerText.includes('disarmed'),
})"""


async def search(tab: Tab) -> int:
    """Look where the page says, confirm what it asks about; how often it said left or right."""
    deadline = time.monotonic() + SEARCH_S
    confirmed = turned = 0
    while time.monotonic() < deadline:
        screen: dict[str, bool] = await tab.evaluate(SCREEN)
        if screen["found"]:
            return turned
        if not screen["armed"]:
            await armed(tab)
        if screen["left"] or screen["right"]:
            turned += 1
            for _ in range(3):
                await tab.press("ArrowLeft" if screen["left"] else "ArrowRight")
            await asyncio.sleep(1.0)
        elif screen["confirm"]:
            confirmed += 1
            if confirmed > 2:
                await tab.click("#found")
            await asyncio.sleep(0.5)
        else:
            await asyncio.sleep(0.2)
    raise AssertionError(f"not found: {await tab.evaluate('[telepresence.state, telepresence.cues]')}")


async def test_an_operator_who_only_follows_the_page_finds_the_target(tmp_path: Path) -> None:
    async with chromium() as browser, page_robot(tmp_path, *SEARCH) as robot:
        tab = await opened(await browser.tab(size=(640, 360)), robot.url)
        await armed(tab)
        turned = await search(tab)
        cues: list[dict[str, Any]] = await tab.evaluate("telepresence.cues")
    assert robot.report["found"]
    assert robot.report["cues"].get("confirm", 0) >= 1
    assert turned
    shown_ms = sorted(cue["ms"] for cue in cues if cue["cue"] != "none")
    # A busy machine draws late, whatever it draws; of every cue it is asked where there is no robot on the same cores.
    assert shown_ms[0] < CUE_SHOWN_MS, shown_ms
    with RunReader(robot.recording) as reader:
        entities = set(reader.entities())
    assert {"operator/received", "operator/command", "operator/head", "cmd/rights", "cmd/applied"} <= entities


async def test_a_page_process_that_is_killed_stops_the_robot_and_comes_back(tmp_path: Path) -> None:
    async with chromium() as browser, page_robot(tmp_path) as robot:
        tab = await opened(await browser.tab(size=(640, 360)), robot.url)
        await turning(tab)
        conn = await tab.evaluate("telepresence.conn")
        killed_ns = time.monotonic_ns()
        os.kill(process_of(robot.process.pid, "page_process"), signal.SIGKILL)
        await tab.until(f"![{json.dumps(conn)}, ''].includes(telepresence.conn) && ({LIVE})", "the page again", 40)
        assert not await tab.evaluate("telepresence.right.yours")
        assert await tab.evaluate("telepresence.state.arm") == "disarmed"
    moving = [stamp for stamp, pair in robot.motion() if stamp >= killed_ns and any(pair)]
    assert (max(moving, default=killed_ns) - killed_ns) / 1e6 <= 300


def process_of(pid: int, word: str) -> int:
    """What this process, or one that it started, has started with this word in its command line."""
    for child in below(pid):
        with contextlib.suppress(OSError):
            if word in Path(f"/proc/{child}/cmdline").read_text(errors="replace"):
                return child
    raise AssertionError(f"there is no {word}")


async def test_pictures_of_the_page_in_seven_states(tmp_path: Path) -> None:
    """Saved where GHAL360_PICTURES says, to be looked at; here only that each shows something."""
    folder = os.environ.get("GHAL360_PICTURES", str(tmp_path))

    async def save(name: str, tab: Tab) -> None:
        picture = await tab.picture()
        assert float(np.std(picture)) > 10.0
        cv2.imwrite(f"{folder}/page-{name}.png", picture)

    async with chromium() as browser, page_robot(tmp_path, *SEARCH) as robot:
        tab = await opened(await browser.tab(), robot.url)
        # As fine as a GPU draws.
        await tab.evaluate("document.querySelector('a-scene').renderer.setPixelRatio(1)")
        await tab.until("telepresence.state.target !== null", "the target", 40)
        await asyncio.sleep(1.0)
        await save("looking", tab)
        await armed(tab)
        await tab.evaluate("document.querySelector('#arrow').click()")
        await tab.until(f"({SCREEN}).left || ({SCREEN}).right", "a cue", 60)
        await asyncio.sleep(0.5)
        await save("cue", tab)
        for _ in range(20):
            screen = await tab.evaluate(SCREEN)
            if screen["confirm"]:
                break
            if screen["left"] or screen["right"]:
                for _ in range(3):
                    await tab.press("ArrowLeft" if screen["left"] else "ArrowRight")
            await asyncio.sleep(1.0)
        await asyncio.sleep(1.0)
        await save("confirm", tab)
        await turning(tab, "w")
        await save("driving", tab)
        filming = process_of(robot.process.pid, "picture_process")
        os.kill(filming, signal.SIGSTOP)
        try:
            await tab.until("document.querySelector('#banners').innerText.includes('driving is locked')", "the lock")
            await save("locked", tab)
        finally:
            os.kill(filming, signal.SIGCONT)
        await tab.key("up", "w")
        await tab.until(LIVE, "live again", 20)
        await tab.press("h")
        await tab.press(" ")
        await asyncio.sleep(1.0)
        await save("stopped", tab)
        await tab.press("h")
        await tab.size(390, 844, mobile=True)
        await asyncio.sleep(2.0)
        await save("phone", tab)
        assert math.isfinite(await tab.evaluate("telepresence.fovH"))
