"""One owner per bus: an advisory lock on a file named after the bus, gone with the process that holds it."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import tempfile
from pathlib import Path
from urllib.parse import quote

from drivers.rmp110.errors import RmpInterfaceError

log = logging.getLogger(__name__)

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
        name = f"rmp110-{quote(key, safe='')}.lock"
        self._path, self._file = _open(name, directory)
        while not _locked(self._file, self._path, key):
            # The last holder removed it between our opening and our locking: what we hold is no lock any more.
            os.close(self._file)
            self._path, self._file = _open(name, directory)
        self._held = True
        try:
            # For the other one's error sentence.
            os.ftruncate(self._file, 0)
            os.pwrite(self._file, f"{os.getpid()}\n".encode("ascii"), 0)
        except OSError as error:
            log.debug("%s belongs to another user, its holder stays nameless: %s", self._path, error)

    def release(self) -> None:
        """Let the next one in; may be called twice."""
        if not self._held:
            return
        self._held = False
        try:
            # While it is still locked: whoever opened it meanwhile finds out, see above.
            self._path.unlink()
        except OSError as error:
            log.debug("%s stays: %s", self._path, error)
        os.close(self._file)


def _open(name: str, directory: Path | None) -> tuple[Path, int]:
    """The lock file, created where missing. The file may belong to another user: locking needs no write access."""
    reason = "none of them can be written to"
    places = (directory,) if directory else lock_directories()
    for place in places:
        for flags in (os.O_RDWR, os.O_RDONLY, os.O_RDWR | os.O_CREAT):
            try:
                return place / name, os.open(place / name, flags | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
            except OSError as error:
                reason = error.strerror or reason
    tried = ", ".join(str(place) for place in places)
    raise RmpInterfaceError(f"no lock file for the CAN bus can be had in {tried}: {reason}; give another lock_dir")


def _locked(file: int, path: Path, key: str) -> bool:
    """Whether the file at `path` is ours now; False where it is another one by now. Raises RmpInterfaceError."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False
    except OSError as error:
        holder = _holder(file)
        os.close(file)
        if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
            raise RmpInterfaceError(f"the lock of CAN bus {key} does not work: {error.strerror}") from error
        raise RmpInterfaceError(
            f"CAN bus {key} is in use by {holder}: a base has one commander; stop the other program first"
        ) from error


def _holder(file: int) -> str:
    try:
        text = os.pread(file, PID_BYTES, 0).strip()
    except OSError:
        text = b""
    if not text.isdigit():
        return "another process"
    return "this very process" if int(text) == os.getpid() else f"process {int(text)}"
