"""H.264 for the simulated camera, encoded before the guest starts: a software-emulated CPU is too slow for it.

Two seconds of each size, to be played round and round. The content is noise on a slow pan: it reaches the
camera's bit rates, and its key pictures are larger than the others, as the camera's are.
"""

from __future__ import annotations

import struct
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np

PICTURES = 60
KEY_INTERVAL = 30
MODES = {"2k": (1920, 960, 42_000_000), "4k": (3840, 1920, 105_000_000)}


def prepared(mode: str, folder: Path) -> Path:
    """The file of a mode's access units, made at the first call."""
    path = folder / f"{mode}-{MODES[mode][2]}.units"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        save(encode(*MODES[mode]), partial)
        partial.rename(path)
    return path


def save(units: list[bytes], path: Path) -> None:
    sizes = struct.pack(f"<I{len(units)}I", len(units), *map(len, units))
    path.write_bytes(sizes + b"".join(units))


def load(path: Path) -> list[bytes]:
    raw = path.read_bytes()
    (count,) = struct.unpack_from("<I", raw)
    sizes = struct.unpack_from(f"<{count}I", raw, 4)
    ends = np.cumsum([4 + 4 * count, *sizes]).tolist()
    return [raw[start:end] for start, end in pairwise(ends)]


def encode(width: int, height: int, bit_rate: int) -> list[bytes]:
    import av  # only on the host: the guest plays what is prepared

    context = av.CodecContext.create("libx264", "w")
    context.width, context.height, context.pix_fmt = width, height, "yuv420p"
    context.time_base, context.framerate = Fraction(1001, 30000), Fraction(30000, 1001)
    context.options = {
        "profile": "baseline",
        "preset": "ultrafast",
        "tune": "zerolatency",
        "b": str(bit_rate),
        "x264-params": f"keyint={KEY_INTERVAL}:min-keyint={KEY_INTERVAL}:scenecut=0:repeat-headers=1:annexb=1"
        f":bframes=0:sliced-threads=0:slices=1:vbv-maxrate={bit_rate // 1000}:vbv-bufsize={bit_rate // 4000}"
        ":nal-hrd=cbr:filler=1:log-level=error",
    }
    rng = np.random.default_rng(5)
    luma = np.kron(rng.integers(0, 255, (height // 4 + 1, width // 4), np.uint8), np.ones((4, 4), np.uint8))[:height]
    noise = rng.integers(0, 48, (height, width), np.uint8)
    units: list[bytes] = []
    for index in range(PICTURES):
        frame = av.VideoFrame(width, height, "yuv420p")
        pan = np.roll(luma // 2, 8 * index, 1) + np.roll(noise, 131 * index, 0)
        frame.planes[0].update(np.pad(pan, ((0, 0), (0, frame.planes[0].line_size - width))).tobytes())
        for plane in frame.planes[1:]:
            plane.update(bytes([128]) * plane.buffer_size)
        frame.pts = index
        units += [bytes(packet) for packet in context.encode(frame)]
    units += [bytes(packet) for packet in context.encode(None)]
    return units
