"""A real Chromium, without a screen, spoken to over its DevTools protocol: for the page's bench and its tests."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import os
import shutil
import tempfile
import time
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import aiohttp
import cv2
import numpy as np

from ghal360_robot.errors import GhalError

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from numpy.typing import NDArray

NAMES = ("chromium", "chromium-browser", "google-chrome")
EXECUTABLE = next((path for name in NAMES if (path := shutil.which(name))), None)
FLAGS = (
    "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--no-first-run", "--disable-extensions", "--disable-component-update", "--disable-background-networking",
    "--mute-audio", "--hide-scrollbars", "--remote-debugging-port=0", "--disable-dev-shm-usage",
)  # fmt: skip
MODEST = ("setpriv", "--inh-caps=-sys_nice", "--bounding-set=-sys_nice")
"""Started by root, Chromium takes more of the processors for half its threads than a robot beside it has."""

START_S = 30.0
ANSWER_S = 30.0
END_S = 5.0


class BrowserError(GhalError):
    """The browser, or the page in it, did not do what was asked."""


KEYS = {
    " ": ("Space", 32), "Escape": ("Escape", 27), "Enter": ("Enter", 13), "ArrowLeft": ("ArrowLeft", 37),
    "ArrowUp": ("ArrowUp", 38), "ArrowRight": ("ArrowRight", 39), "ArrowDown": ("ArrowDown", 40),
    "Home": ("Home", 36), "=": ("Equal", 187), "-": ("Minus", 189),
}  # fmt: skip


class Tab:
    """One page: `evaluate`, keys, mouse, screenshots."""

    def __init__(self, browser: Browser, target: str, session: str) -> None:
        self.browser = browser
        self.target = target
        self._session = session

    async def send(self, method: str, **params: Any) -> dict[str, Any]:
        return await self.browser.send(method, params, self._session)

    async def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression; promises are awaited."""
        answer = await self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True, userGesture=True
        )
        if "exceptionDetails" in answer:
            raise BrowserError(f"{expression}: {answer['exceptionDetails']['exception'].get('description')}")
        return answer["result"].get("value")

    async def goto(self, url: str) -> None:
        await self.send("Page.navigate", url=url)
        await self.until("document.readyState === 'complete' && location.href !== 'about:blank'", "the page is loaded")

    async def until(self, expression: str, what: str = "", timeout_s: float = 20.0) -> Any:
        """Wait until an expression is true."""
        deadline = time.monotonic() + timeout_s
        while True:
            value = await self.evaluate(expression)
            if value:
                return value
            if time.monotonic() > deadline:
                raise BrowserError(f"waited {timeout_s:g} s for: {what or expression}")
            await asyncio.sleep(0.02)

    async def key(self, kind: str, key: str) -> None:
        """`kind` is down or up."""
        code, number = KEYS.get(key) or (f"Key{key.upper()}", ord(key.upper()))
        kinds = {"down": "rawKeyDown", "up": "keyUp"}
        await self.send("Input.dispatchKeyEvent", type=kinds[kind], key=key, code=code, windowsVirtualKeyCode=number)

    async def press(self, key: str) -> None:
        await self.key("down", key)
        await self.key("up", key)

    async def mouse(self, kind: str, x: float, y: float) -> None:
        """`kind` is Pressed, Released or Moved."""
        down = kind != "Released"
        button = {"button": "left", "buttons": int(down), "clickCount": int(kind != "Moved")}
        await self.send("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, **button)

    async def drag(self, start: tuple[float, float], by: tuple[float, float], steps: int = 8) -> None:
        await self.mouse("Pressed", *start)
        for step in range(1, steps + 1):
            await self.mouse("Moved", start[0] + by[0] * step / steps, start[1] + by[1] * step / steps)
        await self.mouse("Released", start[0] + by[0], start[1] + by[1])

    async def click(self, selector: str) -> None:
        """Click the middle of an element."""
        box = await self.evaluate(
            f"(r => [r.x + r.width / 2, r.y + r.height / 2])"
            f"(document.querySelector({json.dumps(selector)}).getBoundingClientRect())"
        )
        for kind in ("Pressed", "Released"):
            await self.mouse(kind, *box)

    async def picture(self) -> NDArray[np.uint8]:
        """What the tab shows, (height, width, 3) BGR."""
        data = await self.send("Page.captureScreenshot", format="png")
        decoded = cv2.imdecode(np.frombuffer(base64.b64decode(data["data"]), np.uint8), cv2.IMREAD_COLOR)
        if decoded is None:
            raise BrowserError("the screenshot is no picture")
        return np.asarray(decoded, np.uint8)

    async def size(self, width: int, height: int, *, mobile: bool = False) -> None:
        await self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile
        )

    async def show(self) -> None:
        """Bring to the front; the others are hidden then."""
        await self.send("Page.bringToFront")

    async def close(self) -> None:
        await self.browser.send("Target.closeTarget", {"targetId": self.target})

    @property
    def console(self) -> list[str]:
        """Errors and warnings so far."""
        return self.browser.console.get(self._session, [])


class Browser:
    """One process of Chromium."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket = socket
        self._number = 0
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self.console: dict[str, list[str]] = {}
        self._listening = asyncio.create_task(self._listen())

    async def send(self, method: str, params: dict[str, Any], session: str | None = None) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if session is not None:
            message["sessionId"] = session
        answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()
        self._answers[self._number] = answer
        await self._socket.send_json(message)
        try:
            return await asyncio.wait_for(answer, ANSWER_S)
        except TimeoutError as error:
            raise BrowserError(f"the browser does not answer {method} within {ANSWER_S:g} s") from error

    async def tab(self, *, before: str = "", size: tuple[int, int] = (1280, 720), window: bool = False) -> Tab:
        """A new tab, or a window; `before` is a script that runs before any of its pages' own."""
        made = await self.send("Target.createTarget", {"url": "about:blank", "newWindow": window})
        attached = await self.send("Target.attachToTarget", {"targetId": made["targetId"], "flatten": True})
        tab = Tab(self, made["targetId"], attached["sessionId"])
        for domain in ("Page", "Runtime", "Log"):
            await tab.send(f"{domain}.enable")
        await tab.size(*size)
        if before:
            await tab.send("Page.addScriptToEvaluateOnNewDocument", source=before)
        return tab

    async def close(self) -> None:
        self._listening.cancel()
        await self._socket.close()

    async def _listen(self) -> None:
        async for raw in self._socket:
            message = json.loads(raw.data)
            if "id" in message:
                answer = self._answers.pop(message["id"], None)
                if answer is not None and not answer.done():
                    if "error" in message:
                        answer.set_exception(BrowserError(str(message["error"])))
                    else:
                        answer.set_result(message["result"])
                continue
            self._note(message)

    def _note(self, message: dict[str, Any]) -> None:
        said = self.console.setdefault(message.get("sessionId", ""), [])
        match message["method"]:
            case "Runtime.exceptionThrown":
                details = message["params"]["exceptionDetails"]
                said.append(str(details.get("exception", {}).get("description", details["text"])))
            case "Log.entryAdded" if message["params"]["entry"]["level"] == "error":
                said.append(message["params"]["entry"]["text"] + " " + message["params"]["entry"].get("url", ""))
            case "Runtime.consoleAPICalled" if message["params"]["type"] in {"error", "assert"}:
                said.append(
                    " ".join(str(arg.get("value", arg.get("description"))) for arg in message["params"]["args"])
                )


@asynccontextmanager
async def chromium(*flags: str, niceness: int = 5) -> AsyncIterator[Browser]:
    """A headless Chromium without screen or GPU; ended, profile and all, on leaving.

    On a computer of its own it would take nothing of the robot's: `niceness` is how much less it gets on this one.
    """
    if EXECUTABLE is None:
        raise BrowserError("there is no Chromium: apt install chromium")
    modest = MODEST if os.geteuid() == 0 and shutil.which(MODEST[0]) else ()
    with tempfile.TemporaryDirectory(prefix="ghal360-chromium-", ignore_cleanup_errors=True) as profile:
        process = await asyncio.create_subprocess_exec(
            *modest, "nice", "-n", str(niceness), EXECUTABLE, *FLAGS, *flags,
            f"--user-data-dir={profile}", "about:blank",
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        try:
            address = await _address(Path(profile) / "DevToolsActivePort")
            async with (
                aiohttp.ClientSession() as http,
                http.ws_connect(address, max_msg_size=0) as socket,
            ):
                browser = Browser(socket)
                try:
                    yield browser
                finally:
                    with contextlib.suppress(TimeoutError, BrowserError, ConnectionError):
                        await asyncio.wait_for(browser.send("Browser.close", {}), 3.0)
                    await browser.close()
        finally:
            try:
                await asyncio.wait_for(process.wait(), END_S)
            except TimeoutError:
                process.kill()
                await process.wait()


def _lines(file: Path) -> list[str]:
    return file.read_text().split() if file.exists() else []


async def _address(file: Path) -> str:
    deadline = time.monotonic() + START_S
    while len(lines := _lines(file)) != 2:
        if time.monotonic() > deadline:
            raise BrowserError(f"Chromium does not start within {START_S:g} s")
        await asyncio.sleep(0.05)
    return f"ws://127.0.0.1:{lines[0]}{lines[1]}"
