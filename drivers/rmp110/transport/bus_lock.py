"""One owner per bus: an advisory lock on a file named after the bus, gone with the process that holds it."""

from __future__ import annotations

import errno
import fcntl
import os
import tempfile
from pathlib import Path
from urllib.parse import quote

from drivers.rmp110.errors import RmpInterfaceError

PID_BYTES = 20
"""Room for any process id; whatever else stands in the file is not read."""


def lock_directories() -> tuple[Path, ...]:
    """Where locks go, best first: a directory that every user shares excludes more owners than one's own does."""
    own = os.environ.get("XDG_RUNTIME_DIR")
    return (Path("/run/lock"), *([Path(own)] if own else []), Path(tempfile.gettempdir()))


class BusLock:
    """Held from construction until `release`, or until the process ends.

    Raises RmpInterfaceError, naming the holder, where somebody else has the bus, and where no lock can be had.
    """

    def __init__(self, key: str, directory: Path | None = None) -> None:
        self._held = False
        self._file: int | None = _open(f"rmp110-{quote(key, safe='')}.lock", directory)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = _holder(self._file)
            self.release()
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise RmpInterfaceError(f"the lock of CAN bus {key} does not work: {error.strerror}") from error
            raise RmpInterfaceError(
                f"CAN bus {key} is in use by {holder}: a base has one commander; stop the other program first"
            ) from error
        self._held = True
        # For the other one's error sentence.
        _write(self._file, f"{os.getpid()}\n".encode("ascii"))

    def release(self) -> None:
        """Let the next one in; may be called twice. The file stays: removing it would race with others."""
        if self._file is not None:
            if self._held:
                _write(self._file, b"")
            os.close(self._file)
            self._file = None


def _open(name: str, directory: Path | None) -> int:
    """The lock file, created where missing. The file may belong to another user: locking needs no write access."""
    reason = "none of them can be written to"
    places = (directory,) if directory else lock_directories()
    for place in places:
        for flags in (os.O_RDWR, os.O_RDONLY, os.O_RDWR | os.O_CREAT):
            try:
                return os.open(place / name, flags | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
            except OSError as error:
                reason = error.strerror or reason
    tried = ", ".join(str(place) for place in places)
    raise RmpInterfaceError(f"no lock file for the CAN bus can be had in {tried}: {reason}; give another lock_dir")


def _write(file: int, text: bytes) -> None:
    try:
        os.ftruncate(file, 0)
        os.pwrite(file, text, 0)
    except OSError:
        # Another user's file: the lock holds all the same, only its holder stays nameless.
        return


def _holder(file: int) -> str:
    try:
        text = os.pread(file, PID_BYTES, 0).strip()
    except OSError:
        text = b""
    if not text.isdigit():
        return "another process"
    return "this very process" if int(text) == os.getpid() else f"process {int(text)}"
