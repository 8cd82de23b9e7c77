"""Rerun's viewer on the files of a run: on this screen, or for a browser on this machine."""

from __future__ import annotations

import contextlib
import socket
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

import rerun_cli  # type: ignore[import-untyped]

from ghal360_robot.logbook.errors import LogbookError, RecordingNotReadableError
from ghal360_robot.logbook.overlay import PREFIX
from ghal360_robot.logbook.run_folder import files_of

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

END_S = 2.0
LOOPBACK = "127.0.0.1"


def find_files(run: Path, overlay: Path | None, *, with_overlay: bool) -> list[Path]:
    """The parts of a run, and the recording of a replay to lay over them.

    Raises:
        RecordingNotReadableError: one of them is not there.
    """
    if run.is_file():
        parts = [run]
    elif run.is_dir():
        parts = files_of(run, ".rrd")
    else:
        raise RecordingNotReadableError(f"There is no recording at {run}.")
    if not parts:
        raise RecordingNotReadableError(f"{run} holds no recording: there is no part-*.rrd in it.")
    if overlay is not None and not overlay.is_file():
        raise RecordingNotReadableError(f"There is no recording at {overlay}.")
    if overlay is None and with_overlay and run.is_dir():
        overlay = max(run.glob(f"{PREFIX}-*.rrd"), key=lambda file: file.stat().st_mtime, default=None)
    return parts if overlay is None else [*parts, overlay]


@dataclass(slots=True)
class Viewer:
    """A viewer's process; ends with the context, or by itself when its window is closed."""

    process: subprocess.Popen[bytes]
    words: tuple[str, ...]
    """What to tell the person who asked for it."""

    def wait(self) -> None:
        """Until the viewer ends, or Ctrl-C. Raises LogbookError where it ended badly."""
        with contextlib.suppress(KeyboardInterrupt):
            code = self.process.wait()
            if code:
                raise LogbookError(f"the viewer ended with status {code}; its own words are above")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.process.terminate()
        try:
            self.process.wait(END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()


def start_viewer(files: list[Path], web_port: int | None = None) -> Viewer:
    """Open `files` as one recording; with `web_port` for browsers on this machine alone.

    Raises:
        LogbookError: the port is taken.
    """
    program = str(Path(rerun_cli.__file__).parent / "rerun")
    names = [str(file) for file in files]
    words = [f"{file}" for file in names]
    if web_port is None:
        # A port of its own: another viewer may be open, and the robot's live view may be served.
        command = [program, "--port", "auto", *names]
    else:
        port = _free_port()
        _check_free(web_port)
        command = [program, "--serve-web", "--bind", LOOPBACK, "--port", str(port)]
        command += ["--web-viewer-port", str(web_port), *names]
        source = quote(f"rerun+http://{LOOPBACK}:{port}/proxy", safe="")
        words.append(f"open http://{LOOPBACK}:{web_port}/?url={source} in a browser; Ctrl-C ends it")
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL)  # noqa: S603 - Rerun's own program
    return Viewer(process, tuple(words))


def _free_port() -> int:
    with socket.socket() as trial:
        trial.bind((LOOPBACK, 0))
        port: int = trial.getsockname()[1]
        return port


def _check_free(port: int) -> None:
    try:
        with socket.socket() as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind((LOOPBACK, port))
    except OSError as error:
        raise LogbookError(f"port {port} cannot be listened on ({error.strerror}): choose another") from error
