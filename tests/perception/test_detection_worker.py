"""The detection thread: newest picture, bounded rate, failures counted."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import av
import numpy as np
import pytest

from ghal360_robot.perception.decode import Picture
from ghal360_robot.perception.detection_worker import DetectionWorker
from ghal360_robot.perception.detectors.base import PixelDetection
from ghal360_robot.perception.panorama import CameraView
from ghal360_robot.perception.sphere import PixelBox

if TYPE_CHECKING:
    from collections.abc import Callable

    from ghal360_robot.messages import Detections

WAIT_S = 10.0
FAST_HZ = 1e6


def picture(number: int, *, tainted: bool = False) -> Picture:
    frame = av.VideoFrame.from_ndarray(np.zeros((32, 64, 3), np.uint8), format="rgb24")
    return Picture(number, 1000 + number, tainted, frame)


class Scripted:
    """A detector that does what the test says and lets it wait for each call."""

    name = "scripted"
    class_names = ("thing",)

    def __init__(self, act: Callable[[int], Any] = lambda _: None) -> None:
        self._act = act
        self.calls = 0

    def warm_up(self) -> None:
        self.warmed = True

    def detect(self, rgb: np.ndarray) -> list[PixelDetection]:
        self.calls += 1
        self._act(self.calls)
        return [PixelDetection("thing", 0.9, PixelBox(30, 14, 4, 4))]


class Inbox:
    def __init__(self) -> None:
        self.messages: list[Detections] = []
        self._changed = threading.Condition()

    def __call__(self, message: Detections) -> None:
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()

    def wait(self, count: int) -> list[Detections]:
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.messages) >= count, WAIT_S)
            return list(self.messages)


def test_detections_carry_the_picture_s_stamp_and_the_camera_s_mounting() -> None:
    inbox = Inbox()
    with DetectionWorker(Scripted(), inbox, rate_hz=FAST_HZ, view=CameraView(0.5)) as worker:
        worker.offer(picture(3))
        (message,) = inbox.wait(1)
    assert (message.stamp_ns, message.picture, message.detector) == (1003, 3, "scripted")
    assert message.objects[0].yaw == pytest.approx(0.5)


def test_only_the_newest_of_the_pictures_that_wait_is_searched() -> None:
    entered, go_on = threading.Event(), threading.Event()

    def hold(call: int) -> None:
        entered.set()
        assert call > 1 or go_on.wait(WAIT_S)

    inbox = Inbox()
    with DetectionWorker(Scripted(hold), inbox, rate_hz=FAST_HZ) as worker:
        worker.offer(picture(0))
        assert entered.wait(WAIT_S)
        for number in range(1, 6):
            worker.offer(picture(number))
        go_on.set()
        messages = inbox.wait(2)
    assert [message.picture for message in messages] == [0, 5]
    assert worker.stats().replaced == 4


def test_the_rate_is_an_upper_bound() -> None:
    now_ns = 0
    detector, inbox = Scripted(), Inbox()
    worker = DetectionWorker(detector, inbox, rate_hz=4.0, clock_ns=lambda: now_ns)
    worker.offer(picture(0))
    first = worker._next_picture()
    assert first is not None
    assert first.number == 0
    worker.offer(picture(1))
    taken: list[Picture | None] = []
    waiter = threading.Thread(target=lambda: taken.append(worker._next_picture()))
    now_ns = 249_999_999
    waiter.start()
    worker.offer(picture(2))
    assert taken == []
    now_ns = 250_000_000
    worker.offer(picture(3))
    waiter.join(WAIT_S)
    assert len(taken) == 1
    assert taken[0] is not None
    assert taken[0].number >= 2


def test_a_tainted_picture_is_not_searched() -> None:
    inbox = Inbox()
    with DetectionWorker(Scripted(), inbox, rate_hz=FAST_HZ) as worker:
        worker.offer(picture(0, tainted=True))
        worker.offer(picture(1))
        assert [message.picture for message in inbox.wait(1)] == [1]
    assert worker.stats().tainted == 1


@pytest.mark.parametrize("error", [RuntimeError("no memory on the card"), MemoryError(), KeyError("weights")])
def test_a_detector_that_raises_is_counted_logged_once_and_asked_again(
    error: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    asked = threading.Semaphore(0)

    def act(call: int) -> None:
        asked.release()
        if call <= 3:
            raise error

    inbox = Inbox()
    with DetectionWorker(Scripted(act), inbox, rate_hz=FAST_HZ) as worker:
        for number in range(4):
            worker.offer(picture(number))
            assert asked.acquire(timeout=WAIT_S)
        inbox.wait(1)
    stats = worker.stats()
    assert stats.failed == 3
    assert stats.last_failure.startswith(type(error).__name__)
    assert len([record for record in caplog.records if "failed" in record.message]) == 1


def test_closing_ends_the_thread_even_while_the_rate_makes_it_wait() -> None:
    inbox = Inbox()
    worker = DetectionWorker(Scripted(), inbox, rate_hz=0.001)
    with worker:
        worker.offer(picture(0))
        inbox.wait(1)
        worker.offer(picture(1))
    assert not worker._thread.is_alive()


def test_a_rate_of_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="above zero"):
        DetectionWorker(Scripted(), Inbox(), rate_hz=0)
