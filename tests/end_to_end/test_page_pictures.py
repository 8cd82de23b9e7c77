"""The page in a real browser: which pictures it shows, and what it says where one is missing."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING

import pytest

from ghal360_robot.bench.browser import chromium
from ghal360_robot.messages import LinkStats
from tests.end_to_end.page_robot import LIVE, WHY_NOT, opened
from tests.end_to_end.page_stand import SMALL, page_stand, text

if TYPE_CHECKING:
    from ghal360_robot.bench.browser import Tab
    from tests.end_to_end.page_stand import PageStand

pytestmark = [pytest.mark.page, pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)]

GREY, ORANGE = (60, 60, 60), (255, 200, 0)
"""Of the film, as blue, green and red: it was drawn as red, green and blue."""

NEAR = 25
"""The film does not say by which standard its colours were made, and so is shown by that of HD, as everywhere."""


IN_A_GPU = "Object.defineProperty(VideoFrame.prototype, 'format', { get: () => null });"
"""What a browser says of a picture that it decoded with hardware."""

SHUT = "VideoFrame.prototype.copyTo = () => Promise.reject(new Error('not here'));"


@pytest.mark.parametrize(
    ("size", "before"),
    [((1920, 960), ""), ((3840, 1920), ""), ((1920, 960), IN_A_GPU), ((1920, 960), SHUT)],
    ids=["2k", "4k", "2k from a GPU", "2k as a whole only"],
)
async def test_both_modes_of_the_camera_are_shown_in_their_colours(size: tuple[int, int], before: str) -> None:
    async with chromium() as browser, page_stand(size=size) as stand:
        tab = await opened(await browser.tab(size=SMALL, before=before), stand.url)
        picture = await tab.picture()
        assert picture[150, 320].tolist() == pytest.approx(ORANGE, abs=NEAR), "ahead"
        assert picture[150, 40].tolist() == pytest.approx(GREY, abs=NEAR), "beside"
        assert tab.console == []


async def joined_in_the_middle(tab: Tab, stand: PageStand) -> bool:
    """Open the stream anew when its group is nearly over and nothing comes any more; False where it took too long."""
    await stand.until(lambda: stand.sequence % 30 == 25, "the end of a group")
    stand.frozen = True
    frozen_ns, last = time.monotonic_ns(), stand.sequence
    await asyncio.sleep(0.1)
    await tab.evaluate("document.querySelector('#stream').dispatchEvent(new Event('change'))")
    await tab.until("globalThis.fresh?.readyState === 1", "the new stream")
    in_time = time.monotonic_ns() - frozen_ns < 800_000_000
    if in_time:
        await tab.until(f"globalThis.shown === {last - 1}", "the newest picture of the group")
    stand.frozen = False
    await tab.until(LIVE, "live again", 20)
    return in_time


async def test_who_joins_in_the_middle_of_a_group_sees_its_newest_picture_without_waiting_for_the_next() -> None:
    """Although more comes at once than a decoder that is in time would have waiting."""
    listening = """
    globalThis.WebSocket = class extends WebSocket {
      constructor(address) { super(address); if (address.includes('/video')) globalThis.fresh = this; }
      send(text) {
        const message = JSON.parse(text);
        if (message.kind === 'shown') globalThis.shown = message.seq;
        super.send(text);
      }
    };"""
    async with chromium() as browser, page_stand(rate_hz=30.0) as stand:
        tab = await browser.tab(before=listening, size=SMALL)
        await opened(tab, stand.url)
        for _ in range(20):
            if await joined_in_the_middle(tab, stand):
                return
    pytest.skip("this machine is too busy to open a stream within a second")


async def test_what_is_wrong_with_camera_and_lidar_is_said() -> None:
    async with chromium() as browser, page_stand() as stand:
        tab = await opened(await browser.tab(size=SMALL), stand.url)
        stand.links["tim571"] = LinkStats("backoff", detail="no telegram for 0.5 s")
        await tab.until(f"{text('#banners')}.includes('lidar stale: no telegram for 0.5 s')")
        stand.links["tim571"] = LinkStats("streaming")
        await tab.until(f"!{text('#banners')}.includes('lidar')")
        stand.frozen = True
        await asyncio.sleep(1.2)  # what there is of a group is too old to begin with
        await tab.evaluate("document.querySelector('#stream').dispatchEvent(new Event('change'))")
        await tab.until(f"{text('#banners')}.includes('no key frame yet')")
        stand.frozen = False
        await tab.until(f"!{text('#banners')}.includes('no key frame yet')")
