"""The process that makes the simulated camera's pictures, so that no other one waits for them.

It is started by `picture_source` with its order as JSON; poses come in on standard input, messages go
out on a pipe of their own. When its input ends, its parent is gone or has had enough, and it ends too.
"""

from __future__ import annotations

import json
import os
import signal
import struct
import sys
import threading
import time
from dataclasses import asdict, dataclass
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np

from ghal360_robot.messages import Pose2
from ghal360_robot.simulation.encoder import ThetaEncoder
from ghal360_robot.simulation.world import CAMERA_HEIGHT_M, build_world

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

POSE = struct.Struct("<3d")
"""x, y in metres, yaw in radians; from the parent."""
HEADER = struct.Struct("<BQIff")
"""Message kind, stamp in ns, payload bytes, milliseconds of drawing and of encoding; to the parent."""
NICENESS = 5
"""Pictures wait when the control loop wants the processor."""


class Message(IntEnum):
    """Kinds of messages to the parent."""

    READY = 0
    ACCESS_UNIT = 1
    ERROR = 2


@dataclass(frozen=True, slots=True)
class Order:
    """What to show: a world (by name, seed and target), or else the pictures of a folder."""

    fps: float
    bitrate: int
    width: int = 1920
    height: int = 960
    world: str = ""
    seed: int = 0
    target: str = ""
    camera_height: float = CAMERA_HEIGHT_M
    painted: bool = True
    """Things wear the paint of their class, for the `painted` detector, instead of looking natural."""
    files: tuple[str, ...] = ()
    seconds_each: float = 4.0

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Order:
        values = json.loads(text)
        return cls(**{**values, "files": tuple(values["files"])})


class Scenery(Protocol):
    """Something that can be photographed."""

    def picture(self, pose: Pose2) -> NDArray[np.uint8]: ...


class RenderedScenery:
    """A simulated world; a robot that stands still is not drawn again."""

    def __init__(self, order: Order) -> None:
        # The folder's pictures need no renderer, and loading it takes a second.
        try:
            from ghal360_robot.simulation.renderer import PanoramaRenderer  # noqa: PLC0415
        except ModuleNotFoundError as error:
            raise RuntimeError(
                f"The renderer needs the package {error.name}; install it with: pip install 'ghal360-robot[sim]'"
            ) from error

        world = build_world(order.world, order.seed, order.target)
        self.start = world.start
        self._renderer = PanoramaRenderer(world, order.width, order.height, painted=order.painted)
        self._height = order.camera_height
        self._shown: Pose2 | None = None
        self._picture = np.zeros((order.height, order.width, 3), np.uint8)

    def picture(self, pose: Pose2) -> NDArray[np.uint8]:
        if pose != self._shown:
            self._picture = self._renderer.render(pose.x, pose.y, pose.yaw, self._height)
            self._shown = pose
        return self._picture


class FolderScenery:
    """Real panoramas one after the other, round and round; the pose changes nothing."""

    def __init__(self, order: Order) -> None:
        self.start = Pose2()
        self._order = order
        self._began = time.monotonic()
        self._shown = -1
        self._picture = np.zeros((order.height, order.width, 3), np.uint8)

    def picture(self, pose: Pose2) -> NDArray[np.uint8]:
        del pose
        files = self._order.files
        index = int((time.monotonic() - self._began) / self._order.seconds_each) % len(files)
        if index != self._shown:
            self._picture = read_panorama(Path(files[index]), self._order.width, self._order.height)
            self._shown = index
        return self._picture


def read_panorama(path: Path, width: int, height: int) -> NDArray[np.uint8]:
    """A picture file scaled to (height, width, 3) RGB. Raises ValueError if it is no 2:1 panorama."""
    data = np.fromfile(path, np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    if picture is None:
        raise ValueError(f"{path} is not a readable picture; give equirectangular JPEG or PNG files.")
    if picture.shape[1] != 2 * picture.shape[0]:
        raise ValueError(
            f"{path} is {picture.shape[1]} x {picture.shape[0]}; an equirectangular panorama is twice as wide as high."
        )
    scaled = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(scaled, cv2.COLOR_BGR2RGB), np.uint8)


class PoseInput:
    """The newest pose that came in; the end of the input ends the process at once."""

    def __init__(self, descriptor: int, start: Pose2) -> None:
        self.newest = start
        self._descriptor = descriptor
        threading.Thread(target=self._listen, name="poses", daemon=True).start()

    def _listen(self) -> None:
        pending = b""
        while chunk := os.read(self._descriptor, 64 * POSE.size):
            pending += chunk
            whole = len(pending) // POSE.size * POSE.size
            if whole:
                self.newest = Pose2(*POSE.unpack_from(pending, whole - POSE.size))
                pending = pending[whole:]
        os._exit(0)


def send(
    descriptor: int, kind: Message, stamp_ns: int, payload: bytes, draw_ms: float = 0.0, encode_ms: float = 0.0
) -> None:
    """Write one message whole; blocks while the parent does not read, which slows only this process."""
    pieces: Iterable[bytes] = (HEADER.pack(kind, stamp_ns, len(payload), draw_ms, encode_ms), payload)
    view = memoryview(b"".join(pieces))
    while view:
        view = view[os.write(descriptor, view) :]


def photograph(order: Order, scenery: Scenery, poses: PoseInput, output: int) -> None:
    """Pictures at the ordered rate, for ever; a late one delays the next, none is made up for."""
    encoder = ThetaEncoder(order.width, order.height, order.fps, order.bitrate)
    period_ns = round(1e9 / order.fps)
    due_ns = time.monotonic_ns()
    while True:
        wait_ns = due_ns - time.monotonic_ns()
        if wait_ns > 0:
            time.sleep(wait_ns / 1e9)
        stamp_ns = time.monotonic_ns()
        due_ns = max(due_ns + period_ns, stamp_ns)
        picture = scenery.picture(poses.newest)
        drawn_ns = time.monotonic_ns()
        unit = encoder.encode(picture)
        encoded_ns = time.monotonic_ns()
        send(output, Message.ACCESS_UNIT, stamp_ns, unit, (drawn_ns - stamp_ns) / 1e6, (encoded_ns - drawn_ns) / 1e6)


def main() -> None:
    """Entry of the process: `picture_process ORDER OUTPUT_DESCRIPTOR`."""
    order, output = Order.from_json(sys.argv[1]), int(sys.argv[2])
    os.nice(NICENESS)
    # Ctrl-C is for the parent; this process ends when its input does.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    try:
        scenery = FolderScenery(order) if order.files else RenderedScenery(order)
        poses = PoseInput(sys.stdin.fileno(), scenery.start)
        send(output, Message.READY, time.monotonic_ns(), b"")
        photograph(order, scenery, poses, output)
    except BrokenPipeError:
        # Nobody listens any more: the parent is gone.
        sys.exit(0)
    except (ImportError, OSError, RuntimeError, ValueError) as error:
        send(output, Message.ERROR, time.monotonic_ns(), str(error).encode())
        sys.exit(1)


if __name__ == "__main__":
    main()
