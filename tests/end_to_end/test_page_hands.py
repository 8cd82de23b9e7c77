"""The page in a real browser, in every hand it can be in: gamepad, fingers, a phone that is turned, a keyboard."""

from __future__ import annotations

import asyncio
import contextlib
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from ghal360_robot.bench.browser import chromium
from ghal360_robot.telepresence.settings import PageSettings
from tests.end_to_end.page_robot import WHY_NOT, opened
from tests.end_to_end.page_stand import CALM, SMALL, PageStand, page_stand, takes_the_controls, text, visible

if TYPE_CHECKING:
    from ghal360_robot.bench.browser import Tab

pytestmark = [pytest.mark.page, pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)]

GAMEPAD = """
globalThis.pad = {
  connected: true, mapping: "standard", axes: [0, 0, 0, 0],
  buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })),
};
navigator.getGamepads = () => [null, globalThis.pad];
"""
BUMPER, TRIGGER, B = 5, 7, 1
FAST = replace(PageSettings(), v_max=1.0, w_max=1.0)


async def presses(tab: Tab, button: int, *, down: bool) -> None:
    await tab.evaluate(f"pad.buttons[{button}].pressed = {str(down).lower()}")


async def squeezes(tab: Tab, stand: PageStand, button: int) -> None:
    """Afresh, and again where a picture that came late made it void."""
    for _ in range(10):
        await presses(tab, button, down=False)
        await asyncio.sleep(0.2)
        await presses(tab, button, down=True)
        with contextlib.suppress(AssertionError):
            await stand.until(lambda: stand.wish.get("deadman"), "the gamepad", 2.0)
            return
    raise AssertionError(f"it never counted: {await tab.evaluate('telepresence.quality')}")


async def test_a_gamepad_drives_while_its_trigger_is_held_and_stops_by_its_button() -> None:
    async with chromium() as browser, page_stand(FAST) as stand:
        stand.arm()
        tab = await browser.tab(before=GAMEPAD, size=SMALL)
        await opened(tab, stand.url)
        await presses(tab, TRIGGER, down=True)
        await takes_the_controls(tab)
        await asyncio.sleep(0.5)
        assert not stand.wish["deadman"], "held before there was a right to drive"
        await squeezes(tab, stand, TRIGGER)
        assert stand.wish["stick"] is None, "the stick untouched: where the operator looks"
        await tab.evaluate("pad.axes = [0.5, -1, 0, 0]")
        await stand.until(lambda: stand.wish["stick"] == {"v": 1.0, "w": -0.5}, "forward and to the right")
        await presses(tab, TRIGGER, down=False)
        await stand.until(lambda: not stand.wish["deadman"], "let go")
        await squeezes(tab, stand, BUMPER)
        await presses(tab, B, down=True)
        await stand.until(lambda: "estop" in stand.said("stop"), "the button")
        await stand.until(lambda: not stand.wish["deadman"], "stopped")


async def test_a_gamepad_that_goes_away_lets_go() -> None:
    async with chromium() as browser, page_stand() as stand:
        stand.arm()
        tab = await browser.tab(before=GAMEPAD, size=SMALL)
        await opened(tab, stand.url)
        await takes_the_controls(tab)
        await squeezes(tab, stand, TRIGGER)
        await tab.evaluate("globalThis.pad = null")
        await stand.until(lambda: not stand.wish["deadman"], "let go")


async def touches(tab: Tab, kind: str, *points: tuple[float, float]) -> None:
    """`kind` is Start, Move or End; all the fingers that are down."""
    fingers = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
    await tab.send("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=fingers)


async def view(tab: Tab) -> dict[str, Any]:
    now = await tab.evaluate("(({yaw, pitch, fovV, mode}) => ({yaw, pitch, fovV, mode}))(telepresence)")
    return {name: math.degrees(value) if name != "mode" else value for name, value in now.items()}


async def phone(tab: Tab) -> None:
    await tab.send("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=5)
    await tab.size(390, 844, mobile=True)


async def test_one_finger_takes_the_scene_along_and_two_widen_it() -> None:
    async with chromium() as browser, page_stand() as stand:
        tab = await browser.tab()
        await phone(tab)
        await opened(tab, stand.url)
        before = await view(tab)
        await touches(tab, "Start", (100, 300))
        for step in range(1, 9):
            await touches(tab, "Move", (100 + 15 * step, 300 - 5 * step))
        await touches(tab, "End")
        after = await view(tab)
        per_pixel = before["fovV"] / 844
        # The browser takes the first pixels for what may become a tap.
        assert after["yaw"] - before["yaw"] == pytest.approx(120 * per_pixel, abs=16 * per_pixel)
        assert after["pitch"] - before["pitch"] == pytest.approx(-40 * per_pixel, abs=16 * per_pixel)
        assert after["mode"] == "touch"

        await touches(tab, "Start", (150, 300), (250, 300))
        for step in range(1, 11):
            await touches(tab, "Move", (150 - 5 * step, 300), (250 + 5 * step, 300))
        await touches(tab, "End")
        wide = await view(tab)
        assert wide["fovV"] == pytest.approx(after["fovV"] / 2, rel=0.2)
        assert wide["yaw"] == pytest.approx(after["yaw"], abs=0.1), "two fingers turn nothing"
        assert await tab.evaluate(text("#fov-text")) == f"{wide['fovV']:.0f}°"


async def test_the_view_follows_a_phone_that_is_turned() -> None:
    async with chromium() as browser, page_stand() as stand:
        tab = await browser.tab()
        await phone(tab)
        await opened(tab, stand.url)

        async def held(alpha: float, beta: float) -> None:
            await tab.send("DeviceOrientation.setDeviceOrientationOverride", alpha=alpha, beta=beta, gamma=0)

        await held(80, 90)
        await tab.until(visible("#tilt"), "offered where there is a touch screen")
        await tab.evaluate("document.querySelector('#tilt').click()")
        await tab.until(f"{text('#tilt')} === 'Stop following'")
        await tab.until("telepresence.mode === 'touch'", "the first angles")
        assert (await view(tab))["yaw"] == pytest.approx(0, abs=0.1), "following turns nothing by itself"
        await held(110, 70)
        await tab.until("Math.abs(telepresence.yaw) > 0.1", "turned")
        turned = await view(tab)
        assert turned["yaw"] == pytest.approx(30, abs=0.1), "to the left"
        assert turned["pitch"] == pytest.approx(-20, abs=0.1), "tipped forward is looking down"
        await tab.evaluate("document.querySelector('#tilt').click()")
        await tab.until(f"{text('#tilt')} === 'Follow the phone'")
        await held(0, 90)
        await asyncio.sleep(0.3)
        assert await view(tab) == turned


async def test_a_mark_goes_into_the_recording_with_its_note_and_writing_it_drives_nothing() -> None:
    async with chromium() as browser, page_stand() as stand:
        stand.arm()
        tab = await opened(await browser.tab(), stand.url)
        await takes_the_controls(tab)
        await tab.press("m")
        await stand.until(lambda: stand.said("bookmark"), "a mark without a note")
        assert stand.said("bookmark")[0]["note"] == ""
        await tab.until(f"{text('#banners')}.includes('marked in the recording')")
        await tab.click("#note")
        await tab.send("Input.insertText", text="the cat again")
        for key in "wf":
            await tab.key("down", key)
        await asyncio.sleep(0.3)
        assert not stand.wish["deadman"]
        await tab.press("Enter")
        await stand.until(lambda: len(stand.said("bookmark")) == 2, "a mark with a note")
        assert stand.said("bookmark")[1]["note"].startswith("the cat again")
        assert not stand.said("stop")
        await tab.click("#note")
        await tab.press(" ")
        await stand.until(lambda: "estop" in stand.said("stop"), "Space, with nothing written yet")


async def test_the_arrow_to_the_target_is_an_option_and_points_where_it_is() -> None:
    async with chromium() as browser, page_stand() as stand:
        tab = await opened(await browser.tab(size=SMALL), stand.url)
        stand.decision = replace(CALM, target_yaw=1.0)
        await tab.until("telepresence.state.target === 1")
        assert not await tab.evaluate(visible("#bearing"))
        await tab.press("b")
        await tab.until(visible("#bearing"), "the arrow")
        angle = "new DOMMatrix(getComputedStyle(document.querySelector('#bearing')).transform)"
        turned = f"(m => Math.atan2(m.b, m.a))({angle})"
        await tab.until(f"Math.abs({turned} + 1) < 0.01", "to the left of what is ahead")
        await tab.press("ArrowLeft")
        await tab.until(f"Math.abs({turned} + 1 - Math.PI / 12) < 0.01", "less so after a turn to the left")
        stand.decision = CALM
        await tab.until(f"!({visible('#bearing')})", "nothing to point at")
