"""H.264 access units to pictures, on a thread of its own.

Decoder settings and their measurements: fact sheet on the THETA V, section 5.3 (one thread, low delay:
no added picture of delay, 4 ms per 2K picture) and 5.4 (libavcodec flags only the damaged picture, so
everything up to the next clean IDR is tainted here).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import av
import numpy as np
from av.codec.context import Flags
from av.video.reformatter import Interpolation, VideoReformatter

from ghal360_robot.perception.backlog import AccessUnit, Backlog, access_unit
from ghal360_robot.perception.sphere import PictureSize
from ghal360_robot.perception.worker import Worker

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

log = logging.getLogger(__name__)

QUEUE_UNITS = 8
"""A quarter of a second at 29.97 Hz: a picture older than that is no longer what the robot sees."""
MAX_UNIT_BYTES = 16 << 20
"""The largest buffer other THETA drivers reserve for one picture; anything above is not a picture."""
MAX_PIXELS = 3840 * 2160
"""The camera's largest picture is 3840 x 1920; a stream that declares more gets no memory for it."""
UNITS_IN_DECODER = 32
"""H.264 lets a decoder hold back 16 pictures; entries beyond twice that belong to pictures never shown."""
CLOSE_TIMEOUT_S = 2.0
"""The longest decode measured is 60 ms; a thread that takes longer than this to end is stuck."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One decoded picture, not yet converted to RGB: of thirty pictures a second a detector asks for a few."""

    number: int
    """Running number of its access unit since the decoder was made."""
    stamp_ns: int
    tainted: bool
    """Some of it leans on data that was lost or damaged."""
    frame: av.VideoFrame

    @property
    def size(self) -> PictureSize:
        return PictureSize(self.frame.width, self.frame.height)

    def rgb(self, size: PictureSize | None = None) -> NDArray[np.uint8]:
        """The picture as (height, width, 3) uint8 RGB, scaled by area when `size` asks for another size.

        Safe to call from any thread; every call converts anew.
        """
        wanted = size or self.size
        # A reformatter per call: the one a frame carries is not meant for two threads at once.
        converted = VideoReformatter().reformat(
            self.frame, wanted.width, wanted.height, "rgb24", interpolation=Interpolation.AREA, threads=1
        )
        return converted.to_ndarray().astype(np.uint8, copy=False)


@dataclass(frozen=True, slots=True)
class _Origin:
    """What a picture inside the decoder inherits from its access unit."""

    stamp_ns: int
    tainted: bool


@dataclass(frozen=True, slots=True)
class DecoderStats:
    """Counts since the decoder was made."""

    received: int = 0
    decoded: int = 0
    tainted: int = 0
    """Decoded pictures that lean on lost or damaged data."""
    undecodable: int = 0
    """Units the decoder refused; normal until the first IDR."""
    dropped: int = 0
    """Units thrown away undecoded, because the decoder fell behind or the unit was absurdly large."""
    consumer_failures: int = 0


class PictureDecoder(Worker):
    """Decodes on its own thread and hands every picture to `on_picture`, on that thread.

    Use as a context manager, or `start` and `close`. `submit` never blocks and never raises for bad data.
    """

    def __init__(self, on_picture: Callable[[Picture], None], *, queue_units: int = QUEUE_UNITS) -> None:
        super().__init__("decode", CLOSE_TIMEOUT_S)
        self._on_picture = on_picture
        self._backlog = Backlog(queue_units)
        self._decoder = _new_decoder()
        self._in_decoder: dict[int, _Origin] = {}
        self._tainted = True
        self._last_number = -1
        self._received = self._decoded = self._decoded_tainted = 0
        self._undecodable = self._oversized = self._consumer_failures = 0

    def submit(self, data: bytes, stamp_ns: int, *, tainted: bool = False) -> None:
        """Queue one access unit (Annex B); `tainted` as the camera's driver judged it."""
        with self._changed:
            number = self._received
            self._received += 1
            # What is refused here leaves a gap in the numbers, which taints what follows.
            if len(data) > MAX_UNIT_BYTES:
                self._oversized += 1
                return
            unit = access_unit(data, number, stamp_ns, tainted=tainted)
            if unit.empty:
                self._undecodable += 1
                return
            self._backlog.push(unit)
            self._changed.notify()

    def stats(self) -> DecoderStats:
        with self._changed:
            return DecoderStats(
                received=self._received,
                decoded=self._decoded,
                tainted=self._decoded_tainted,
                undecodable=self._undecodable,
                dropped=self._backlog.dropped + self._oversized,
                consumer_failures=self._consumer_failures,
            )

    def _run(self) -> None:
        while (unit := self._next_unit()) is not None:
            for picture in self._decode(unit):
                self._deliver(picture)

    def _next_unit(self) -> AccessUnit | None:
        with self._changed:
            while not self._closing:
                unit = self._backlog.pop()
                if unit is not None:
                    return unit
                self._changed.wait()
            return None

    def _decode(self, unit: AccessUnit) -> list[Picture]:
        gap, self._last_number = unit.number != self._last_number + 1, unit.number
        with self._changed:
            # A clean IDR leans on nothing before it; everything else leans on all units since.
            self._tainted = unit.tainted or ((self._tainted or gap) and not unit.idr)
            tainted = self._tainted
        self._in_decoder[unit.number] = _Origin(unit.stamp_ns, tainted)
        while len(self._in_decoder) > UNITS_IN_DECODER:
            del self._in_decoder[next(iter(self._in_decoder))]
        packet = av.Packet(unit.data)
        packet.pts = unit.number
        frames: list[av.VideoFrame] = []
        try:
            if unit.idr and self._decoder.has_b_frames:
                # The camera never reorders pictures, so a damaged SPS said so; libavcodec would go on
                # holding every picture back by one for as long as this decoder lives.
                frames += self._decoder.decode(None)
                self._decoder = _new_decoder()
            frames += self._decoder.decode(packet)
        except av.FFmpegError as error:
            self._refused(unit, error)
        return [picture for frame in frames if (picture := self._picture(frame)) is not None]

    def _refused(self, unit: AccessUnit, error: av.FFmpegError) -> None:
        with self._changed:
            self._undecodable += 1
            self._tainted = True
        self._in_decoder.pop(unit.number, None)
        if not isinstance(error, av.error.InvalidDataError):
            log.warning("The H.264 decoder failed (%s); it starts anew at the next IDR.", error)
            self._decoder = _new_decoder()
            self._in_decoder.clear()

    def _picture(self, frame: av.VideoFrame) -> Picture | None:
        number = -1 if frame.pts is None else frame.pts
        origin = self._in_decoder.pop(number, None)
        if origin is None:
            return None
        with self._changed:
            self._tainted = self._tainted or frame.is_corrupt
            tainted = origin.tainted or frame.is_corrupt
            self._decoded += 1
            self._decoded_tainted += tainted
        return Picture(number, origin.stamp_ns, tainted, frame)

    def _deliver(self, picture: Picture) -> None:
        try:
            self._on_picture(picture)
        except Exception:
            # The consumer is not ours: whatever its bug is, it must not end the video for everyone else.
            with self._changed:
                self._consumer_failures += 1
                first = self._consumer_failures == 1
            if first:
                log.exception("What takes the decoded pictures failed; further failures are only counted.")


def _new_decoder() -> av.VideoCodecContext:
    decoder = av.VideoCodecContext.create("h264", "r")
    decoder.thread_type = "NONE"
    decoder.thread_count = 1
    decoder.flags |= Flags.low_delay
    decoder.options = {"max_pixels": str(MAX_PIXELS)}
    return decoder
