"""The simulated camera's pictures as access units, made in a process of their own."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Self

from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.simulation.picture_process import HEADER, POSE, Message, Order, read_panorama
from ghal360_robot.simulation.world import build_world

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from ghal360_robot.messages import Pose2

    AccessUnitCallback = Callable[[int, bytes], object]
    ErrorCallback = Callable[[Exception], object]

START_TIMEOUT_S = 30.0
"""Loading the renderer and building a world takes one or two seconds, much longer on a busy small machine."""
END_TIMEOUT_S = 1.0
"""How long the process may take to end by itself, and then once more when told to terminate."""
MAX_UNIT_BYTES = 8 * 1024 * 1024
"""An access unit of the camera stays far below this; more means that the pipe is out of step."""
STATISTICS_PICTURES = 60
PICTURE_SUFFIXES = (".jpg", ".jpeg", ".png")


class PictureSourceError(GhalError, RuntimeError):
    """The pictures stopped coming."""


class PictureFolderError(UsageError):
    """The folder of pictures cannot be used."""


@dataclass(frozen=True, slots=True)
class PictureStats:
    """How the process is doing, over its last pictures."""

    pictures: int = 0
    """Delivered since the start."""
    fps: float = 0.0
    draw_ms: float = 0.0
    encode_ms: float = 0.0
    mean_bytes: float = 0.0


class PictureSource:
    """Runs the picture process: register callbacks, enter the context, send poses.

    Callbacks run on a reader thread of this source.
    """

    def __init__(self, order: Order) -> None:
        self._order = order
        self._deliver: AccessUnitCallback | None = None
        self._report: ErrorCallback | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._reader: threading.Thread | None = None
        self._closing = threading.Event()
        self._ready = threading.Event()
        self._complaints: BinaryIO | None = None
        self._lock = threading.Lock()
        self._pose_lock = threading.Lock()
        """Keeps a pose from being written to a pipe that is just being closed."""
        self._recent: deque[tuple[int, float, float, int]] = deque(maxlen=STATISTICS_PICTURES)
        self._pictures = 0
        self.error: Exception | None = None
        """Why the pictures stopped; None while all is well."""

    def on_access_unit(self, callback: AccessUnitCallback) -> None:
        """Call `callback(stamp_ns, access_unit)` for each picture; the stamp is when the picture was taken."""
        self._deliver = callback

    def on_error(self, callback: ErrorCallback) -> None:
        """Call `callback(error)` once if the pictures stop before `close`."""
        self._report = callback

    def start(self) -> None:
        """Start the process and wait until it can deliver. Raises PictureSourceError if it cannot."""
        self._launch()
        try:
            self._wait_until_ready()
        except BaseException:
            self.close()
            raise

    def _launch(self) -> None:
        receive, send = os.pipe()
        complaints = tempfile.TemporaryFile()  # noqa: SIM115 - closed by close()
        command = [sys.executable, "-m", "ghal360_robot.simulation.picture_process", self._order.to_json(), str(send)]
        try:
            self._process = subprocess.Popen(  # noqa: S603 - our own module, arguments of ours
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                # Panda3D complains about the missing screen there; its last line explains a crash.
                stderr=complaints,
                pass_fds=(send,),
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
                bufsize=0,
            )
        except OSError as error:
            os.close(receive)
            complaints.close()
            raise PictureSourceError(f"Cannot start the simulated camera's process: {error.strerror}.") from error
        finally:
            os.close(send)
        self._complaints = complaints
        assert self._process.stdin is not None  # noqa: S101 - a pipe was asked for
        self._pose_pipe = self._process.stdin.fileno()
        os.set_blocking(self._pose_pipe, False)
        pipe = os.fdopen(receive, "rb")
        self._reader = threading.Thread(target=self._read, args=(pipe,), name="pictures", daemon=True)
        self._reader.start()

    def _wait_until_ready(self) -> None:
        deadline = time.monotonic() + START_TIMEOUT_S
        while not self._ready.wait(0.05):
            if self.error is not None:
                raise self.error
            if time.monotonic() > deadline:
                raise PictureSourceError(
                    f"The simulated camera did not start within {START_TIMEOUT_S:.0f} s; is this machine overloaded?"
                )

    def set_pose(self, pose: Pose2) -> None:
        """Tell where the robot stands now. Never blocks; a process too busy to listen misses this one."""
        # A dead process shows in `error`, not here; a full pipe means it is far behind already.
        with self._pose_lock, suppress(BlockingIOError, BrokenPipeError):
            if self._process is not None and not self._closing.is_set():
                os.write(self._pose_pipe, POSE.pack(pose.x, pose.y, pose.yaw))

    def statistics(self) -> PictureStats:
        with self._lock:
            recent, pictures = list(self._recent), self._pictures
        if len(recent) < 2:
            return PictureStats(pictures)
        stamps, draw, encode, size = zip(*recent, strict=True)
        count = len(recent)
        span_s = (stamps[-1] - stamps[0]) / 1e9
        fps = (count - 1) / span_s if span_s > 0 else 0.0
        return PictureStats(pictures, fps, sum(draw) / count, sum(encode) / count, sum(size) / count)

    def close(self) -> None:
        """End the process, within a few seconds whatever it does; no callback comes afterwards."""
        self._closing.set()
        process = self._process
        if process is None:
            return
        if process.stdin is not None:
            with self._pose_lock, suppress(BrokenPipeError):
                process.stdin.close()
        for insist in (process.terminate, process.kill):
            try:
                process.wait(END_TIMEOUT_S)
                break
            except subprocess.TimeoutExpired:
                insist()
        process.wait()
        if self._reader is not None and self._reader is not threading.current_thread():
            self._reader.join(END_TIMEOUT_S)
        self._process = None
        if self._complaints is not None:
            self._complaints.close()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read(self, pipe: BinaryIO) -> None:
        with pipe:
            try:
                while header := pipe.read(HEADER.size):
                    self._take(pipe, header)
            except PictureSourceError as error:
                self._fail(error)
                return
            except Exception as error:  # noqa: BLE001 - a callback's own failure must be told, not end a thread unseen
                self._fail(error)
                return
        self._fail(PictureSourceError(f"The simulated camera's process ended unexpectedly{self._last_words()}."))

    def _take(self, pipe: BinaryIO, header: bytes) -> None:
        if len(header) < HEADER.size:
            raise PictureSourceError("The simulated camera's process ended in the middle of a picture.")
        kind, stamp_ns, length, draw_ms, encode_ms = HEADER.unpack(header)
        if length > MAX_UNIT_BYTES:
            raise PictureSourceError(f"The simulated camera announced a picture of {length} bytes; it is out of step.")
        payload = pipe.read(length)
        if len(payload) < length:
            raise PictureSourceError("The simulated camera's process ended in the middle of a picture.")
        if kind == Message.READY:
            self._ready.set()
        elif kind == Message.ERROR:
            raise PictureSourceError(f"The simulated camera failed: {payload.decode(errors='replace')}")
        elif kind == Message.ACCESS_UNIT and not self._closing.is_set():
            with self._lock:
                self._pictures += 1
                self._recent.append((stamp_ns, draw_ms, encode_ms, length))
            if self._deliver is not None:
                self._deliver(stamp_ns, payload)

    def _fail(self, error: Exception) -> None:
        if self._closing.is_set():
            return
        self.error = error
        if self._report is not None:
            self._report(error)

    def _last_words(self) -> str:
        if self._complaints is None or self._complaints.closed:
            return ""
        self._complaints.seek(0)
        lines = [line for line in self._complaints.read().decode(errors="replace").splitlines() if line.strip()]
        return f" ({lines[-1].strip()})" if lines else ""


class RenderedPictureSource(PictureSource):
    """Pictures of a simulated world from where the robot stands."""

    def __init__(
        self,
        world_name: str,
        seed: int,
        target: str = "backpack",
        fps: float = 12.0,
        bitrate: int = 6_000_000,
        *,
        painted: bool = True,
    ) -> None:
        """The world as in `build_world`; `painted` for the detector of that name, else it looks natural.

        Raises ValueError for a name or target that does not exist.
        """
        build_world(world_name, seed, target)
        super().__init__(Order(fps, bitrate, world=world_name, seed=seed, target=target, painted=painted))


class FolderPictureSource(PictureSource):
    """Real equirectangular pictures from a folder, a few seconds each, in the order of their names."""

    def __init__(
        self, directory: Path | str, fps: float = 12.0, bitrate: int = 6_000_000, seconds_each: float = 4.0
    ) -> None:
        """Raises PictureFolderError if the folder has no pictures or one of them is no 2:1 panorama."""
        super().__init__(Order(fps, bitrate, files=_panoramas(Path(directory)), seconds_each=seconds_each))


def _panoramas(directory: Path) -> tuple[str, ...]:
    try:
        files = sorted(path for path in directory.iterdir() if path.suffix.lower() in PICTURE_SUFFIXES)
    except OSError as error:
        raise PictureFolderError(f"Cannot read the folder {directory}: {error.strerror}.") from error
    if not files:
        raise PictureFolderError(f"There is no JPEG or PNG picture in {directory}; put 2:1 panoramas there.")
    for path in files:
        try:
            read_panorama(path, 64, 32)
        except OSError as error:
            raise PictureFolderError(f"Cannot read {path}: {error.strerror}.") from error
        except ValueError as error:
            raise PictureFolderError(str(error)) from error
    return tuple(str(path.resolve()) for path in files)
