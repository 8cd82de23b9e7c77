"""An exported film plays in a real browser: time advances, and the pictures are those that were recorded."""

from __future__ import annotations

import base64
import json
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from ghal360_robot.bench.browser import EXECUTABLE, chromium
from ghal360_robot.export.mp4 import FilmSettings, Look, write_mp4
from ghal360_robot.logbook.reader import RunReader
from ghal360_robot.logbook.recorder import Recorder
from ghal360_robot.messages import HeadPose, OperatorInput
from ghal360_robot.simulation.encoder import ThetaEncoder

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [
    pytest.mark.page,
    pytest.mark.skipif(EXECUTABLE is None, reason="there is no Chromium: apt install chromium"),
]

START_NS = 5_000_000_000
RATE_HZ, PICTURES = 15, 45
WIDTH, HEIGHT = 640, 320
RED, BLUE = (220, 30, 30), (30, 30, 220)

PLAY = """
(async source => {
  const video = document.createElement("video");
  video.muted = true;
  video.src = URL.createObjectURL(new Blob([Uint8Array.from(atob(source), c => c.charCodeAt(0))], {type: "video/mp4"}));
  document.body.append(video);
  await new Promise((done, failed) => {
    video.onended = done;
    video.onerror = () => failed(new Error(video.error.message));
    video.play().catch(failed);
  });
  const canvas = new OffscreenCanvas(video.videoWidth, video.videoHeight).getContext("2d");
  canvas.drawImage(video, 0, 0);
  const pixel = x => [...canvas.getImageData(x * video.videoWidth, 0.8 * video.videoHeight, 1, 1).data];
  return {
    size: [video.videoWidth, video.videoHeight],
    duration: video.duration,
    at: video.currentTime,
    shown: video.getVideoPlaybackQuality().totalVideoFrames,
    left: pixel(0.25),
    right: pixel(0.75),
  };
})"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds in front of a panorama whose left half turns from blue to red; the gaze rests ahead."""
    recorder = Recorder(tmp_path_factory.mktemp("runs"), properties={}, config_json="{}")
    with ThetaEncoder(WIDTH, HEIGHT, float(RATE_HZ), 600_000) as encoder:
        for k in range(PICTURES):
            picture = np.full((HEIGHT, WIDTH, 3), BLUE, np.uint8)
            picture[:, : WIDTH // 2] = RED if k > PICTURES // 2 else BLUE
            stamp_ns = START_NS + k * 1_000_000_000 // RATE_HZ
            recorder.access_unit(stamp_ns, encoder.encode(picture), k, k % RATE_HZ == 0, tainted=False)
            recorder.operator(OperatorInput(stamp_ns, HeadPose(0.0, 0.0, math.pi / 2)))
    assert recorder.close()
    return recorder.folder


@pytest.mark.parametrize("look", list(Look))
async def test_an_exported_film_plays_to_its_end_and_shows_what_was_recorded(
    run: Path, tmp_path: Path, look: Look
) -> None:
    with RunReader(run) as reader:
        assert write_mp4(reader, tmp_path / "run.mp4", FilmSettings(look, 480)) == PICTURES
    source = base64.b64encode((tmp_path / "run.mp4").read_bytes()).decode()
    async with chromium() as browser:
        tab = await browser.tab(size=(640, 360))
        seen = await tab.evaluate(f"{PLAY}({json.dumps(source)})")
    assert seen["size"] == [480, 240 if look is Look.PANORAMA else 270]
    assert seen["duration"] == pytest.approx(PICTURES / RATE_HZ, abs=0.1)
    assert seen["at"] == pytest.approx(seen["duration"], abs=0.1)
    assert seen["shown"] > 1
    assert seen["left"][:3] == pytest.approx(RED, abs=60)
    assert seen["right"][:3] == pytest.approx(BLUE, abs=60)
