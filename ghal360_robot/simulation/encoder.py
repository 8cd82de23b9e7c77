"""Pictures become H.264 as the THETA V sends it: constrained baseline, one slice, no reordering, Annex B."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import av
import cv2
import numpy as np

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

    from numpy.typing import NDArray

LEVEL_2K = "4.0"
"""The THETA's 1920 x 960 mode (its frame descriptor's bLevelIDC 40; 3840 x 1920 has 51)."""
LEVEL_4K = "5.1"
IDR_INTERVAL_S = 1.0
"""The THETA's own interval is not published; a decoder that joins late waits at most this long."""


class ThetaEncoder:
    """Encodes pictures to access units, one out for each one in, without delay."""

    def __init__(self, width: int = 1920, height: int = 960, fps: float = 30.0, bitrate: int = 8_000_000) -> None:
        """Even picture size in pixels, pictures and bits per second. Raises ValueError for what H.264 cannot do."""
        if width <= 0 or height <= 0 or width % 2 or height % 2:
            raise ValueError(f"A picture of {width} x {height} cannot be encoded; both sides must be even.")
        if not (0.1 <= fps <= 120.0 and bitrate > 0):
            raise ValueError(f"Cannot encode {fps} pictures and {bitrate} bits per second; give sensible rates.")
        self.width, self.height = width, height
        self._pictures = 0
        interval = max(1, round(fps * IDR_INTERVAL_S))
        codec = av.CodecContext.create("libx264", "w")
        codec.width, codec.height = width, height
        codec.pix_fmt = "yuv420p"
        codec.framerate = Fraction(fps).limit_denominator(1001)
        codec.time_base = 1 / codec.framerate
        codec.bit_rate = bitrate
        codec.gop_size = interval
        codec.thread_count = 1
        codec.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "profile": "baseline",
            "level": LEVEL_2K if width * height <= 1920 * 1088 else LEVEL_4K,
            "x264-params": ":".join(
                (
                    "annexb=1",
                    "repeat-headers=1",
                    "aud=0",
                    "cabac=0",
                    "bframes=0",
                    "slices=1",
                    "sliced-threads=0",
                    f"keyint={interval}",
                    f"min-keyint={interval}",
                    "scenecut=0",
                    # Constant bit rate, as the camera's bmRateControlModes says.
                    f"vbv-maxrate={bitrate // 1000}",
                    f"vbv-bufsize={bitrate // 2000}",
                )
            ),
        }
        self._codec = codec

    def encode(self, rgb: NDArray[np.uint8]) -> bytes:
        """One access unit of a picture (height, width, 3) RGB. Raises ValueError for any other shape."""
        if rgb.shape != (self.height, self.width, 3) or rgb.dtype != np.uint8:
            raise ValueError(
                f"This encoder takes {self.width} x {self.height} RGB bytes, not {rgb.shape} of {rgb.dtype}."
            )
        planes = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2YUV_I420), np.uint8)
        frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        frame.pts = self._pictures
        self._pictures += 1
        packets = self._codec.encode(frame)
        if len(packets) != 1:
            raise RuntimeError(f"The encoder gave {len(packets)} packets for one picture; x264 ignored zero delay.")
        return bytes(packets[0])

    def close(self) -> None:
        """Free the encoder; what it holds back is nothing."""
        del self._codec

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
