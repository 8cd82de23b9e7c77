"""Another detector on the pictures of a recorded run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.logbook.pictures import pictures
from ghal360_robot.perception.panorama import UPRIGHT, CameraView, around_robot
from ghal360_robot.perception.sphere import PictureSize

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ghal360_robot.logbook.reader import RunReader
    from ghal360_robot.messages import Detections
    from ghal360_robot.perception.detectors.base import Detector


def redetect(
    reader: RunReader,
    detector: Detector,
    *,
    rate_hz: float,
    camera: CameraView = UPRIGHT,
    told: Callable[[Detections], None] | None = None,
) -> Iterator[Detections]:
    """What `detector` finds in the pictures that were searched in the run, or in so many a second where none were."""
    wanted = {found.stamp_ns for found in reader.detections()}
    next_ns = 0
    for number, (stamp_ns, frame) in enumerate(pictures(reader)):
        if stamp_ns not in wanted if wanted else stamp_ns < next_ns:
            continue
        next_ns = stamp_ns + round(1e9 / rate_hz)
        found = around_robot(
            detector.detect(frame.to_ndarray(format="rgb24").astype(np.uint8, copy=False)),
            PictureSize(frame.width, frame.height),
            camera,
            stamp_ns=stamp_ns,
            picture=number,
            detector=detector.name,
        )
        if told is not None:
            told(found)
        yield found
