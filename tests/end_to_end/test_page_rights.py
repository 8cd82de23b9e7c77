"""The page in a real browser, without a robot behind it: login, hand-over, stops, locks, headset, slow link."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from ghal360_robot.bench.browser import chromium
from ghal360_robot.messages import Applied, ArmState, Cue, Twist
from ghal360_robot.telepresence import certificates
from ghal360_robot.telepresence.access import Role, Sessions
from ghal360_robot.telepresence.settings import PageSettings
from tests.end_to_end.page_robot import LIVE, WHY_NOT, opened
from tests.end_to_end.page_stand import (
    CALM,
    SMALL,
    PageStand,
    holds,
    page_stand,
    takes_the_controls,
    text,
    visible,
)
from tests.telepresence.test_access import TOKENS
from tests.telepresence.test_protocol import PAGE

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path

    from ghal360_robot.bench.browser import Tab

pytestmark = [pytest.mark.page, pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)]

IWER = PAGE / "node_modules" / "iwer" / "build" / "iwer.min.js"


async def test_the_controls_go_from_hand_to_hand_in_sight_of_both() -> None:
    async with chromium() as browser, page_stand() as stand:
        first = await opened(await browser.tab(size=SMALL), stand.url)
        await takes_the_controls(first)
        second = await browser.tab(size=SMALL)
        await second.goto(stand.url)
        await second.until("document.querySelector('#take').innerText === 'Ask to drive'")
        assert "operator 1 drives" in await second.evaluate(text("#right"))
        await second.press("t")
        await first.show()
        await first.until(visible("#ask"), "the question")
        assert "operator 2 asks to drive" in await first.evaluate(text("#ask"))
        await first.click("#ask-no")
        await first.until(f"!({visible('#ask')})")
        assert not await second.evaluate("telepresence.right.yours")
        await second.press("t")
        await first.until(visible("#ask"), "the second question")
        await first.click("#ask-yes")
        await first.until("!telepresence.right.yours")
        await first.until(f"{text('#banners')}.includes('operator 2 drives now')")
        await second.show()
        await second.until("telepresence.right.yours")
        assert "you drive" in await second.evaluate(text("#right"))


async def test_a_driver_who_does_not_answer_can_be_relieved() -> None:
    async with chromium() as browser, page_stand() as stand:
        first = await opened(await browser.tab(size=SMALL), stand.url)
        await takes_the_controls(first)
        second = await browser.tab(size=SMALL)
        await second.goto(stand.url)
        await second.until("globalThis.telepresence?.right?.driver === 'operator 1'")
        await first.show()  # goes on driving, and does not answer
        await second.press("t")
        await second.until("telepresence.right.may_take", "five seconds of silence", 10)
        await second.show()
        await second.until(visible("#ask"))
        assert "does not answer" in await second.evaluate(text("#ask"))
        await second.click("#ask-yes")
        await second.until("telepresence.right.yours")


@pytest.mark.parametrize("how", ["button", "space", "escape"])
async def test_whoever_looks_may_stop_and_it_is_repeated_until_the_robot_has_it(how: str) -> None:
    async with chromium() as browser, page_stand() as stand:
        stand.arm()
        tab = await opened(await browser.tab(size=SMALL), stand.url)
        if how == "button":
            await tab.click("#estop")
        else:
            await tab.press({"space": " ", "escape": "Escape"}[how])
        await stand.until(lambda: len(stand.said("stop")) >= 3, "the stop and its repetition")
        stand.applied = Applied(Twist(), ArmState.ESTOP, ("emergency stop pressed",))
        await tab.until("telepresence.state.arm === 'estop'")
        await tab.until(f"{text('#arm-text')}.includes('EMERGENCY STOP')")
        count = len(stand.said("stop"))
        await asyncio.sleep(1.0)
        assert len(stand.said("stop")) <= count + 1
        assert set(stand.said("stop")) == {"estop"}


async def test_a_frozen_picture_locks_driving_with_the_reason_on_the_screen() -> None:
    async with chromium() as browser, page_stand() as stand:
        stand.arm()
        tab = await opened(await browser.tab(size=SMALL), stand.url)
        await takes_the_controls(tab)
        await holds(tab, stand)
        stand.frozen = True
        began = time.monotonic()
        await stand.until(lambda: stand.said("lock")[-1]["engaged"], "the lock")
        assert time.monotonic() - began < 1.2
        await tab.until(f"{text('#banners')}.includes('driving is locked: the picture on the screen is')")
        stand.frozen = False
        await tab.until(LIVE, "live again")
        await tab.until("telepresence.quality.lock === 'let go and press again'")
        assert not stand.wish["deadman"]
        await tab.key("up", "f")
        await asyncio.sleep(0.2)
        await tab.key("down", "f")
        await stand.until(lambda: stand.wish["deadman"], "driving again")


async def test_a_lost_connection_comes_back_and_drives_only_after_a_fresh_press() -> None:
    async with chromium() as browser, page_stand() as stand:
        stand.arm()
        tab = await opened(await browser.tab(size=SMALL), stand.url)
        await takes_the_controls(tab)
        await holds(tab, stand)
        conn = await tab.evaluate("telepresence.conn")
        for ws in list(stand.server._sockets):
            await ws.close()
        await stand.until(lambda: not stand.wish["deadman"], "let go")
        await tab.until(f"![{json.dumps(conn)}, ''].includes(telepresence.conn) && ({LIVE})", "connected again", 20)
        assert not await tab.evaluate("telepresence.right.yours")
        await takes_the_controls(tab)
        await asyncio.sleep(0.5)
        assert not stand.wish["deadman"]
        await tab.key("up", "f")
        await tab.key("down", "f")
        await stand.until(lambda: stand.wish["deadman"], "driving again")


async def test_driving_by_looking_by_hand_and_by_button_say_what_they_mean() -> None:
    async with chromium() as browser, page_stand(replace(PageSettings(), v_max=1.0, w_max=1.0)) as stand:
        stand.arm()
        tab = await opened(await browser.tab(), stand.url)
        await takes_the_controls(tab)
        await tab.press("ArrowLeft")
        await tab.until("telepresence.settled")
        await tab.key("down", "f")
        await stand.until(lambda: stand.wish.get("deadman"), "held")
        assert stand.wish["stick"] is None
        assert stand.wish["head"]["yaw"] == pytest.approx(math.radians(15), abs=0.01)
        assert stand.wish["head"]["fov"] == pytest.approx(math.radians(107.5), abs=0.01)
        await tab.key("down", "w")
        await tab.key("down", "d")
        await stand.until(lambda: stand.wish["stick"] == {"v": 0.7, "w": -0.7}, "stick")
        for key in "wdf":
            await tab.key("up", key)
        await stand.until(lambda: not stand.wish["deadman"], "let go")
        box = await tab.evaluate("(r => [r.x + 20, r.y + 10])(document.querySelector('#hold').getBoundingClientRect())")
        await tab.mouse("Pressed", *box)
        await stand.until(lambda: stand.wish["deadman"], "held by the button")
        await tab.mouse("Moved", 300, 300)
        await asyncio.sleep(0.2)
        assert stand.wish["deadman"]
        await tab.mouse("Released", 300, 300)
        await stand.until(lambda: not stand.wish["deadman"], "button let go")


async def test_a_cue_is_on_the_screen_within_200_ms() -> None:
    async with chromium() as browser, page_stand() as stand:
        tab = await opened(await browser.tab(size=SMALL), stand.url)
        for cue in (Cue.LEFT, Cue.RIGHT, Cue.CONFIRM):
            stand.decision = replace(CALM, cue=cue, target_yaw=0.5)
            await tab.until(visible(f"#cue-{cue.value}"), f"the cue {cue.value}")
            shown = [await tab.evaluate(visible(f"#cue-{other}")) for other in ("left", "right", "confirm")]
            assert sum(shown) == 1
        stand.decision = CALM
        await tab.until(f"!({visible('#cue-confirm')})")
        assert max(entry["ms"] for entry in await tab.evaluate("telepresence.cues")) < 200


async def test_a_token_opens_the_page_over_tls_and_leaves_no_trace(tmp_path: Path) -> None:
    made = certificates.make(tmp_path, ("127.0.0.1",))
    settings = replace(PageSettings(), certificate=str(made.certificate), key=str(made.key), need_token=True)
    async with (
        chromium("--ignore-certificate-errors") as browser,
        page_stand(settings, sessions=Sessions(TOKENS)) as stand,
    ):
        tab = await browser.tab(size=SMALL)
        await tab.goto(stand.url)
        await tab.until(visible("#login"), "the question for a token")
        await tab.evaluate(
            "document.querySelector('#token').value = 'wrong'; document.querySelector('#login button').click()"
        )
        await tab.until(f"{text('#login-text')}.includes('not one')")
        await tab.evaluate(f"document.querySelector('#token').value = '{TOKENS[Role.VIEWER]}'")
        await tab.evaluate("document.querySelector('#login button').click()")
        await tab.until(LIVE, "the page", 20)
        assert "you may look and stop" in await tab.until(text("#right"))
        assert await tab.evaluate("document.querySelector('#take').disabled")
        await tab.press(" ")
        await stand.until(lambda: stand.said("stop"), "a viewer's stop")

        other = await browser.tab(size=SMALL)
        await other.goto(f"{stand.url}#token={TOKENS[Role.DRIVER]}")
        await other.until(LIVE, "the page", 20)
        assert await other.evaluate("location.href") == stand.url
        assert await other.evaluate("document.cookie") == ""
        assert not await other.evaluate("document.querySelector('#take').disabled")


@contextlib.asynccontextmanager
async def slow(port: int, bytes_per_s: float) -> AsyncIterator[int]:
    """A proxy that lets so much through; its own buffers are small."""

    async def carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, rate: float) -> None:
        with contextlib.suppress(ConnectionError, asyncio.CancelledError):
            while data := await reader.read(4096):
                writer.write(data)
                await writer.drain()
                # A sleep that took too long on a busy machine is no slower link: a little may be caught up.
                budget["at"] = max(budget["at"], time.monotonic() - 0.1) + len(data) / rate
                await asyncio.sleep(max(0.0, budget["at"] - time.monotonic()))
        writer.close()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        onward_reader, onward = await asyncio.open_connection("127.0.0.1", port, limit=8192)
        tasks = (carry(onward_reader, writer, bytes_per_s), carry(reader, onward, 1e9))
        carrying.update(asyncio.create_task(task) for task in tasks)

    budget = {"at": 0.0}
    carrying: set[asyncio.Task[None]] = set()
    server = await asyncio.start_server(serve, "127.0.0.1", 0, limit=8192)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        for task in carrying:
            task.cancel()
        await asyncio.gather(*carrying, return_exceptions=True)


async def test_a_slow_link_costs_whole_groups_of_pictures_and_locks_driving() -> None:
    """2K at 40 Mb/s through 1 MB/s, control on the same link."""
    async with (
        chromium() as browser,
        page_stand(size=(1920, 960), rate_hz=30.0, bit_rate=40_000_000) as stand,
        slow(stand.server.port, 1e6) as port,
    ):
        stand.server._hosts |= {f"127.0.0.1:{port}"}
        stand.arm()
        tab = await browser.tab(size=SMALL)
        await tab.goto(f"http://127.0.0.1:{port}/")
        await tab.until("(globalThis.telepresence?.delays?.length ?? 0) > 0", "a first picture", 60)
        await takes_the_controls(tab)
        await tab.key("down", "f")
        await asyncio.sleep(2.0)  # the page itself came over this link as well
        first = await tab.evaluate("telepresence.delays.length")
        await asyncio.sleep(12.0)
        inside = await tab.evaluate("(({delays, dropped, quality}) => ({delays, dropped, quality}))(telepresence)")
        banners = await tab.evaluate(text("#banners"))
    delays = inside["delays"][first:]
    assert len(delays) >= 8
    assert max(delays) < 1000, delays
    assert inside["quality"]["dropped"] > 100
    assert "driving is locked" in banners
    assert any(lock["engaged"] for lock in stand.said("lock")[-30:])


async def pulls_the_trigger(tab: Tab, stand: PageStand) -> None:
    """Afresh, and again where a late picture made it void."""
    for _ in range(10):
        await tab.evaluate("headset.controllers.right.updateButtonValue('trigger', 0)")
        await asyncio.sleep(0.3)
        await tab.evaluate("headset.controllers.right.updateButtonValue('trigger', 1)")
        with contextlib.suppress(AssertionError):
            await stand.until(lambda: stand.wish["deadman"], "the trigger", 2.0)
            return
    raise AssertionError(f"it never counted: {await tab.evaluate('telepresence.quality')}")


async def test_a_headset_drives_by_its_trigger_and_stops_by_its_squeeze() -> None:
    """WebXR as Meta's emulator of a Quest 3 has it."""
    if not IWER.is_file():
        pytest.skip("the emulated headset is missing: make page")
    before = (
        IWER.read_text(encoding="utf-8")
        + ";globalThis.headset = new IWER.XRDevice(IWER.metaQuest3); headset.installRuntime({ forceInstall: true });"
    )
    async with chromium() as browser, page_stand() as stand:
        stand.arm()
        plain = await opened(await browser.tab(size=SMALL), stand.url)
        assert not await plain.evaluate(visible("#vr")), "offered without a headset"
        await plain.close()
        tab = await browser.tab(before=before, size=SMALL)
        await opened(tab, stand.url)
        await tab.until(visible("#vr"), "the button")
        await takes_the_controls(tab)
        await tab.evaluate("document.querySelector('#vr').click()")
        await tab.until("telepresence.mode === 'xr'", "the headset")
        await tab.evaluate("headset.quaternion.set(0, Math.sin(Math.PI / 8), 0, Math.cos(Math.PI / 8))")
        await stand.until(lambda: abs(stand.wish.get("head", {}).get("yaw", 0) - math.pi / 4) < 0.02, "the head's turn")
        assert 1.0 < stand.wish["head"]["fov"] < 2.5
        await pulls_the_trigger(tab, stand)
        assert stand.wish["stick"] is None
        await tab.evaluate("headset.controllers.right.updateAxes('thumbstick', 0, -1)")
        await stand.until(lambda: stand.wish["stick"] is not None, "the thumb stick")
        assert stand.wish["stick"]["v"] > 0
        await tab.evaluate("headset.updateVisibilityState('visible-blurred')")
        await stand.until(lambda: not stand.wish["deadman"], "released by the headset's menu")
        await tab.evaluate("headset.updateVisibilityState('visible')")
        await asyncio.sleep(0.5)
        assert not stand.wish["deadman"], "still pressed is no fresh press"
        await pulls_the_trigger(tab, stand)
        await tab.evaluate("headset.controllers.left.updateButtonValue('squeeze', 1)")
        await stand.until(lambda: "estop" in stand.said("stop"), "the squeeze")
        assert not stand.wish["deadman"]
        assert tab.console == []


async def test_without_webcodecs_there_are_stills_and_a_sentence() -> None:
    async with chromium() as browser, page_stand() as stand:
        tab = await browser.tab(before="delete globalThis.VideoDecoder;", size=SMALL)
        await tab.goto(stand.url)
        await tab.until("(globalThis.telepresence?.pictureUs ?? 0) > 0", "a still")
        assert "still pictures only" in await tab.until(text("#banners"))
        assert await tab.evaluate("document.querySelector('#stream').value") == "stills"


async def test_a_phone_shows_everything_that_stops_and_drives() -> None:
    async with chromium() as browser, page_stand() as stand:
        tab = await browser.tab()
        for size in ((390, 844), (844, 390), (1280, 720)):
            await tab.size(*size, mobile=size[0] != 1280)
            await opened(tab, stand.url)
            for control in ("#estop", "#hold", "#arm", "#take", "#pill", "#map", "#fov"):
                box = await tab.evaluate(
                    "(r => [r.left, r.top, r.right, r.bottom])"
                    f"(document.querySelector('{control}').getBoundingClientRect())"
                )
                assert box[0] >= 0, (control, size, box)
                assert box[1] >= 0, (control, size, box)
                assert box[2] <= size[0], (control, size, box)
                assert box[3] <= size[1], (control, size, box)
            estop = await tab.evaluate(
                "(r => document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2).id)"
                "(document.querySelector('#estop').getBoundingClientRect())"
            )
            assert estop == "estop"


async def test_in_the_unwound_view_the_world_stands_still_while_the_robot_turns() -> None:
    async with chromium() as browser, page_stand() as stand:
        tab = await opened(await browser.tab(size=SMALL), stand.url)
        await tab.press("ArrowRight")
        await tab.until("telepresence.settled")
        stand.yaw = 0.5
        await tab.until("telepresence.state.pose.yaw === 0.5")
        await asyncio.sleep(0.3)
        wound = await tab.evaluate("[telepresence.yaw, telepresence.heading]")
        assert wound == pytest.approx([-math.radians(15)] * 2, abs=0.01), "the view turns with the robot"
        await tab.press("u")
        assert await tab.evaluate("telepresence.heading") == pytest.approx(wound[1], abs=0.01), (
            "switching turns nothing"
        )
        before = await tab.evaluate("telepresence.yaw")
        stand.yaw = 1.5
        await tab.until(f"Math.abs(telepresence.heading - ({wound[1]} - 1.0)) < 0.02", "looking where it looked")
        assert await tab.evaluate("telepresence.yaw") == pytest.approx(before, abs=0.01)


async def test_what_comes_closer_is_marked_at_its_place_or_at_the_edge_it_is_behind() -> None:
    async with chromium() as browser, page_stand() as stand:
        tab = await opened(await browser.tab(size=SMALL), stand.url)
        for yaw, side in ((0.2, "in"), (2.5, "left"), (-2.5, "right")):
            stand.approaching = (yaw,)
            await tab.until(f"document.querySelector('.edge')?.dataset.side === '{side}'", side)
        stand.approaching = ()
        await tab.until("document.querySelector('.edge') === null")
