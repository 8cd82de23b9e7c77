"""Detection on a thread of its own: the newest picture, at most so many times a second."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ghal360_robot.errors import GhalError
from ghal360_robot.perception.panorama import UPRIGHT, CameraView, around_robot
from ghal360_robot.perception.worker import Worker

if TYPE_CHECKING:
    from collections.abc import Callable

    from ghal360_robot.messages import Detections
    from ghal360_robot.perception.decode import Picture
    from ghal360_robot.perception.detectors.base import Detector

log = logging.getLogger(__name__)

CLOSE_TIMEOUT_S = 5.0
"""A large network on a slow machine takes seconds for one panorama and cannot be interrupted."""


@dataclass(frozen=True, slots=True)
class DetectionStats:
    """Counts since the worker was made."""

    detected: int = 0
    """Pictures searched."""
    replaced: int = 0
    """Pictures that a newer one replaced before their turn came; normal above the detection rate."""
    tainted: int = 0
    """Pictures not searched because parts of them were lost."""
    failed: int = 0
    """Pictures on which the detector, or what takes its results, raised an error."""
    last_failure: str = ""
    last_duration_s: float = 0.0


class DetectionWorker(Worker):
    """Searches the newest picture offered and hands what it found to `on_detections`, on its own thread.

    `offer` never blocks. Detections carry the stamp of their picture. Use as a context manager.
    """

    def __init__(
        self,
        detector: Detector,
        on_detections: Callable[[Detections], None],
        *,
        rate_hz: float,
        view: CameraView = UPRIGHT,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        if rate_hz <= 0:
            raise ValueError(f"The detection rate must be above zero, not {rate_hz} Hz.")
        super().__init__("detect", CLOSE_TIMEOUT_S)
        self._detector = detector
        self._on_detections = on_detections
        self._period_ns = round(1e9 / rate_hz)
        self._view = view
        self._clock_ns = clock_ns
        self._newest: Picture | None = None
        self._next_ns = 0
        self._stats = DetectionStats()

    def offer(self, picture: Picture) -> None:
        """Make this the picture to search next; call from any thread."""
        with self._changed:
            if picture.tainted:
                self._stats = replace(self._stats, tainted=self._stats.tainted + 1)
                return
            if self._newest is not None:
                self._stats = replace(self._stats, replaced=self._stats.replaced + 1)
            self._newest = picture
            self._changed.notify()

    def stats(self) -> DetectionStats:
        with self._changed:
            return self._stats

    def _run(self) -> None:
        self._warm_up()
        while (picture := self._next_picture()) is not None:
            self._search(picture)

    def _next_picture(self) -> Picture | None:
        """The newest picture once the period is over, or None when closing."""
        with self._changed:
            while not self._closing:
                wait_ns = self._next_ns - self._clock_ns()
                if self._newest is not None and wait_ns <= 0:
                    picture, self._newest = self._newest, None
                    self._next_ns = self._clock_ns() + self._period_ns
                    return picture
                self._changed.wait(wait_ns / 1e9 if self._newest is not None else None)
            return None

    def _warm_up(self) -> None:
        """A network's first run takes many times as long as all others: on this thread, before the first picture."""
        begin_ns = self._clock_ns()
        try:
            self._detector.warm_up()
        except Exception as error:  # noqa: BLE001 - logged and counted below
            # As in searching: what fails here fails at the first picture again, and the robot drives without.
            self._failed(error)
        else:
            log.info("The detector %r is ready after %.1f s.", self._detector.name, (self._clock_ns() - begin_ns) / 1e9)

    def _search(self, picture: Picture) -> None:
        begin_ns = self._clock_ns()
        try:
            found = self._detector.detect(picture.rgb())
            detections = around_robot(
                found,
                picture.size,
                self._view,
                stamp_ns=picture.stamp_ns,
                picture=picture.number,
                detector=self._detector.name,
            )
            self._on_detections(detections)
        except Exception as error:  # noqa: BLE001 - logged and counted below
            # A detector is foreign code (a network's RuntimeError, cv2.error, MemoryError on a full card)
            # and one bad picture must not end guidance: the robot sees old detections age instead.
            self._failed(error)
            return
        duration_s = (self._clock_ns() - begin_ns) / 1e9
        with self._changed:
            self._stats = replace(self._stats, detected=self._stats.detected + 1, last_duration_s=duration_s)

    def _failed(self, error: Exception) -> None:
        text = f"{type(error).__name__}: {error}"
        with self._changed:
            new = text != self._stats.last_failure
            self._stats = replace(self._stats, failed=self._stats.failed + 1, last_failure=text)
        if new:
            log.error(
                "Searching a picture with the detector %r failed (%s); repeats are only counted.",
                self._detector.name,
                text,
                exc_info=None if isinstance(error, GhalError) else error,
            )
