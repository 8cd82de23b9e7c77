"""A run as an MP4: the panorama with what the robot made of it, or the operator's own view along the recorded gaze."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import av
import numpy as np

from ghal360_robot.errors import GhalError
from ghal360_robot.export.viewport import ViewportSize, viewport
from ghal360_robot.logbook.pictures import pictures
from ghal360_robot.messages import Cue, HeadPose
from ghal360_robot.perception.overlay import Annotation, draw
from ghal360_robot.perception.panorama import UPRIGHT, CameraView
from ghal360_robot.perception.sphere import PictureSize

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from ghal360_robot.logbook.reader import RunReader
    from ghal360_robot.logbook.records import Tick
    from ghal360_robot.messages import Detections

    Pixels = NDArray[np.uint8]

TIME_BASE = Fraction(1, 90_000)
"""The customary clock of video files: fine enough for any picture rate."""
DETECTION_SHOWN_NS = 1_000_000_000
"""Boxes older than this are no longer where their objects are."""


class Look(Enum):
    """What the film shows."""

    PANORAMA = "panorama"
    VIEW = "view"


class Stamped(Protocol):
    @property
    def stamp_ns(self) -> int: ...


Message = TypeVar("Message", bound=Stamped)


@dataclass(frozen=True, slots=True)
class FilmSettings:
    """`width` is the film's; the height follows (2:1 panorama, 16:9 view)."""

    look: Look = Look.PANORAMA
    width: int = 1280
    camera: CameraView = UPRIGHT
    target: str = ""
    from_s: float = 0.0
    to_s: float = float("inf")


def write_mp4(reader: RunReader, out: Path, settings: FilmSettings) -> int:
    """Write the film (H.264, yuv420p: plays in browsers); returns the number of pictures in it.

    Every recorded picture is shown for as long as it was the newest. Raises GhalError where the run has no
    picture that can be decoded, OSError where the file cannot be written.
    """
    size = _film_size(settings)
    count, first_ns, last_pts = 0, 0, -1
    with av.open(str(out), "w", format="mp4", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = size.width, size.height, "yuv420p"
        stream.time_base = stream.codec_context.time_base = TIME_BASE
        stream.options = {"preset": "veryfast", "crf": "23"}
        for stamp_ns, picture in film(reader, settings):
            first_ns = first_ns or stamp_ns
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.time_base = TIME_BASE
            frame.pts = last_pts = max(round((stamp_ns - first_ns) / 1e9 / TIME_BASE), last_pts + 1)
            container.mux(stream.encode(frame))
            count += 1
        if count:
            container.mux(stream.encode(None))
    if not count:
        out.unlink(missing_ok=True)
        raise GhalError(f"{reader.path} holds no picture that can be decoded in that span")
    return count


def film(reader: RunReader, settings: FilmSettings) -> Iterator[tuple[int, Pixels]]:
    """Stamps and RGB pictures of the film."""
    detections, ticks = _Newest(reader.detections()), _Newest(reader.ticks())
    operators = _Newest(reader.operator_inputs())
    size = _film_size(settings)
    first = next(reader.access_units(), None)
    first_ns = 0 if first is None else first.stamp_ns
    span = (round(first_ns + s * 1e9) if 0 < s < float("inf") else None for s in (settings.from_s, settings.to_s))
    for stamp_ns, frame in pictures(reader, *span):
        found, tick, operator = detections.at(stamp_ns), ticks.at(stamp_ns), operators.at(stamp_ns)
        if not settings.from_s <= (stamp_ns - first_ns) / 1e9 <= settings.to_s:
            continue
        head = HeadPose() if operator is None else operator.head
        annotation = annotate(stamp_ns, found, tick, head, settings.target)
        if settings.look is Look.VIEW:
            # Drawn before it is cut out: boxes and cue then bend as the world does.
            whole = draw(_rgb(frame, PictureSize(frame.width, frame.height)), annotation, settings.camera)
            yield stamp_ns, viewport(whole, head, ViewportSize(size.width, size.height), settings.camera.yaw)
        else:
            yield stamp_ns, draw(_rgb(frame, size), annotation, settings.camera)


def annotate(stamp_ns: int, found: Detections | None, tick: Tick | None, head: HeadPose, target: str) -> Annotation:
    """What the robot knew at that instant."""
    recent = found is not None and stamp_ns - found.stamp_ns <= DETECTION_SHOWN_NS
    return Annotation(
        objects=found.objects if found is not None and recent else (),
        target=target,
        wedges=tick.decision.wedges if tick is not None else (),
        gaze_yaw=head.yaw,
        fov=head.fov,
        cue=tick.decision.cue if tick is not None else Cue.NONE,
    )


class _Newest(Generic[Message]):
    """The newest message that is not later than an instant; instants must not run backwards."""

    def __init__(self, messages: Iterator[Message]) -> None:
        self._messages = messages
        self._next = next(messages, None)
        self._newest: Message | None = None

    def at(self, stamp_ns: int) -> Message | None:
        while self._next is not None and self._next.stamp_ns <= stamp_ns:
            self._newest, self._next = self._next, next(self._messages, None)
        return self._newest


def _film_size(settings: FilmSettings) -> PictureSize:
    height = settings.width / 2 if settings.look is Look.PANORAMA else settings.width * 9 / 16
    return PictureSize(settings.width // 2 * 2, round(height / 2) * 2)


def _rgb(frame: av.VideoFrame, size: PictureSize) -> Pixels:
    converted = frame.reformat(size.width, size.height, "rgb24", interpolation="AREA")
    return converted.to_ndarray().astype(np.uint8, copy=False)
