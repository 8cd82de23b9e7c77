"""Pictures made of the camera's: a smaller stream for a slow link, and stills for a browser without WebCodecs.

Each runs in a thread of its own inside the page's process, and only while somebody watches.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from fractions import Fraction
from typing import TYPE_CHECKING, Protocol, cast

import av
import cv2

from ghal360_robot.telepresence.frames import Frame
from ghal360_robot.telepresence.inbox import Inbox

if TYPE_CHECKING:
    from collections.abc import Callable

    from av.video.codeccontext import VideoCodecContext

    from ghal360_robot.telepresence.settings import PageSettings

MAX_WAITING = 30
"""A second of pictures; who is slower begins anew at a key picture."""

JPEG_WIDTH = 1920
JPEG_QUALITY = 80
KEY_EVERY_S = 1.0
END_S = 0.5
"""The thread dies with its process anyway."""

logger = logging.getLogger(__name__)


class Maker(Protocol):
    """Turns a decoded picture into what is sent; None where this one is left out."""

    def __call__(self, picture: av.VideoFrame, frame: Frame) -> Frame | None: ...


class Transcoder:
    """A decoder and a maker in a thread; `keys_only` decodes nothing but key pictures."""

    def __init__(self, new_maker: Callable[[], Maker], *, keys_only: bool = False) -> None:
        self._new_maker = new_maker
        self._keys_only = keys_only
        self._waiting: Inbox[Frame] = Inbox()
        self._joining = True
        self._loop: asyncio.AbstractEventLoop
        self._give: Callable[[Frame], None]
        self._thread = threading.Thread(target=self._run, name="transcoder", daemon=True)

    def start(self, give: Callable[[Frame], None]) -> None:
        """Begin; `give` is called on the event loop that runs now."""
        self._loop, self._give = asyncio.get_running_loop(), give
        self._thread.start()

    def close(self) -> None:
        self._waiting.close()
        self._thread.join(END_S)

    def offer(self, frame: Frame) -> None:
        """One access unit; never waits."""
        if self._keys_only and not frame.key:
            return
        if len(self._waiting) >= MAX_WAITING:
            self.rest()
        if frame.key:
            self._joining = False
        if not self._joining:
            self._waiting.put(frame)

    def rest(self) -> None:
        """Nobody watches, or it got too much: begin again with a key picture."""
        if not self._joining:
            self._waiting.clear()
            self._joining = True

    def _run(self) -> None:
        decoder, make = None, None
        while (frame := self._waiting.get()) is not None:
            if decoder is None and not frame.key:
                continue
            try:
                if decoder is None or make is None:
                    decoder, make = _decoder(), self._new_maker()
                for picture in decoder.decode(av.Packet(frame.data)):
                    made = make(picture, frame)
                    if made is not None:
                        self._loop.call_soon_threadsafe(self._give, made)
            except (av.FFmpegError, ValueError, OSError) as error:
                logger.warning("a picture could not be made smaller: %s", error)
                decoder = make = None  # the next key picture begins anew
            except RuntimeError:
                return  # the event loop has ended


def _decoder() -> VideoCodecContext:
    decoder = av.CodecContext.create("h264", "r")
    decoder.thread_count = 1
    decoder.options = {"flags": "low_delay"}
    return decoder


def jpeg_of() -> Maker:
    """Stills of at most JPEG_WIDTH."""

    def make(picture: av.VideoFrame, frame: Frame) -> Frame:
        if picture.width > JPEG_WIDTH:
            picture = picture.reformat(width=JPEG_WIDTH, height=JPEG_WIDTH * picture.height // picture.width)
        pixels = picture.to_ndarray(format="bgr24")
        _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        height, width = pixels.shape[:2]
        return Frame(data.tobytes(), frame.stamp_ns, frame.sequence, width, height, True, frame.tainted, True)

    return make


def small_of(settings: PageSettings) -> Callable[[], Maker]:
    """A smaller H.264 stream by the configured encoder."""

    def new() -> Maker:
        return _Small(settings)

    return new


class _Small:
    def __init__(self, settings: PageSettings) -> None:
        self._settings = settings
        self._codec: VideoCodecContext | None = None
        self._next_ns = 0
        self._count = 0

    def __call__(self, picture: av.VideoFrame, frame: Frame) -> Frame | None:
        s = self._settings
        if frame.stamp_ns < self._next_ns:
            return None
        period_ns = round(1e9 / s.small_hz)
        self._next_ns = max(self._next_ns + period_ns, frame.stamp_ns - period_ns)
        width = min(s.small_width, picture.width) & ~1
        height = (width * picture.height // picture.width) & ~1
        codec = self._codec or self._open(width, height)
        small = picture.reformat(width=width, height=height, format="yuv420p")
        small.pts = self._count
        self._count += 1
        packets = codec.encode(small)
        if not packets:
            return None
        data = b"".join(bytes(packet) for packet in packets)
        key = any(packet.is_keyframe for packet in packets)
        return Frame(data, frame.stamp_ns, frame.sequence, width, height, key, frame.tainted)

    def _open(self, width: int, height: int) -> VideoCodecContext:
        s = self._settings
        codec = cast("VideoCodecContext", av.CodecContext.create(s.small_codec, "w"))
        codec.width, codec.height, codec.pix_fmt = width, height, "yuv420p"
        codec.framerate = Fraction(s.small_hz).limit_denominator(1001)
        codec.time_base = 1 / codec.framerate
        codec.bit_rate = s.small_kbps * 1000
        codec.gop_size = max(1, round(s.small_hz * KEY_EVERY_S))
        if s.small_codec == "libx264":
            codec.thread_count = 1
            codec.options = {
                "preset": "ultrafast",
                "tune": "zerolatency",
                "profile": "baseline",
                "x264-params": f"annexb=1:repeat-headers=1:scenecut=0:vbv-maxrate={s.small_kbps}:"
                f"vbv-bufsize={max(s.small_kbps // 4, 100)}",
            }
        self._codec = codec
        return codec
