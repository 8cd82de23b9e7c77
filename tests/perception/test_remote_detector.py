"""A detector in a process of its own: the same answers, and a clear word when the process dies."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest

from ghal360_robot.errors import UsageError
from ghal360_robot.perception.detectors.base import DetectorOptions, make_detector
from ghal360_robot.perception.detectors.errors import DetectorError, PictureError, WeightsError
from ghal360_robot.perception.detectors.painted import PaintedDetector
from ghal360_robot.perception.detectors.remote import DetectorDiedError, RemoteDetector, apart

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

WAIT_S = 20.0


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def remote(clock: Clock) -> Iterator[RemoteDetector]:
    detector = RemoteDetector("painted", DetectorOptions(), clock)
    yield detector
    detector.close()


def picture() -> np.ndarray:
    """Something green on grey, which `painted` takes for one thing or another."""
    rgb = np.full((240, 480, 3), 120, np.uint8)
    rgb[100:140, 200:230] = (10, 200, 10)
    return rgb


def killed(detector: RemoteDetector, number: signal.Signals) -> None:
    assert detector.pid is not None
    os.kill(detector.pid, number)


def test_it_finds_what_the_same_detector_finds_here(remote: RemoteDetector) -> None:
    here = make_detector("painted")
    remote.warm_up()
    assert (remote.name, remote.class_names) == (here.name, here.class_names)
    assert remote.detect(picture()) == here.detect(picture()) != []
    assert remote.detect(np.full((240, 480, 3), 120, np.uint8)) == []


def test_signals_for_the_robot_do_not_end_it(remote: RemoteDetector) -> None:
    killed(remote, signal.SIGINT)
    killed(remote, signal.SIGTERM)
    assert remote.detect(picture())


def test_a_killed_process_is_said_once_and_started_again_after_a_while(remote: RemoteDetector, clock: Clock) -> None:
    killed(remote, signal.SIGKILL)
    with pytest.raises(DetectorDiedError, match="was killed") as first:
        remote.detect(picture())
    with pytest.raises(DetectorDiedError) as second:
        remote.detect(picture())
    assert str(first.value) == str(second.value)
    clock.now_s += 5.0
    assert remote.detect(picture())


def test_closing_ends_the_process_even_while_an_answer_is_awaited(remote: RemoteDetector) -> None:
    pid = remote.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    raised: list[BaseException] = []

    def search() -> None:
        try:
            remote.detect(picture())
        except DetectorError as error:
            raised.append(error)

    thread = threading.Thread(target=search)
    thread.start()
    deadline = time.monotonic() + WAIT_S
    while not remote._memory[: picture().nbytes].any() and time.monotonic() < deadline:
        time.sleep(0.001)
    remote.close()
    thread.join(WAIT_S)
    assert not thread.is_alive()
    assert len(raised) == 1
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    remote.close()


@pytest.mark.parametrize(
    ("name", "options", "error", "words"),
    [
        ("yolo9000", DetectorOptions(), UsageError, "no detector 'yolo9000'"),
        ("centernet", DetectorOptions(), WeightsError, "ghal360 detectors add centernet"),
    ],
)
def test_what_is_wrong_with_a_detector_is_said_in_its_own_sentence(
    name: str,
    options: DetectorOptions,
    error: type[Exception],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("GHAL360_CACHE", str(tmp_path))
    with pytest.raises(error, match=words):
        RemoteDetector(name, options)


def test_an_absurd_picture_is_refused_before_it_is_sent(remote: RemoteDetector) -> None:
    with pytest.raises(PictureError):
        remote.detect(np.zeros((4, 4), np.uint8))
    with pytest.raises(DetectorError, match="larger than any"):
        remote.detect(np.zeros((4000, 8000, 3), np.uint8))


def test_what_needs_no_network_needs_no_process() -> None:
    assert isinstance(apart("painted", DetectorOptions()), PaintedDetector)
