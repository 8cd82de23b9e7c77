"""Commands that read recordings run in a process of their own.

One wrong byte in an .rrd can abort the whole process inside Rerun (found by flipping bytes, tests/logbook). What
comes from a damaged disk or from somebody else must end in a sentence, not in a core dump.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

READING = ("inspect", "replay", "export")
IN_CHILD = "GHAL360_READS_RECORDING"
CHECK_TIMEOUT_S = 120.0

CHECK = "import sys; from rerun.chunk import RrdReader\nfor c in RrdReader(sys.argv[1]).stream(): c.to_record_batch()"


def wants_child(arguments: list[str]) -> bool:
    """Whether these arguments name a command that reads a recording, and this is not its process yet."""
    return bool(arguments) and arguments[0] in READING and IN_CHILD not in os.environ


def run_in_child(arguments: list[str]) -> tuple[int, str]:
    """Run `ghal360 ARGUMENTS`; its exit status, and a sentence where it did not survive what it read."""
    command = [sys.executable, "-m", "ghal360_robot", *arguments]
    with subprocess.Popen(command, env={**os.environ, IN_CHILD: "1"}, stderr=subprocess.PIPE) as child:  # noqa: S603
        try:
            _, said = child.communicate()
        except KeyboardInterrupt:
            child.wait()
            return 1, ""
    if child.returncode >= 0:
        sys.stderr.buffer.write(said)
        return child.returncode, ""
    how = signal.Signals(-child.returncode).name
    if child.returncode not in {-signal.SIGABRT, -signal.SIGSEGV, -signal.SIGBUS, -signal.SIGILL, -signal.SIGFPE}:
        return 1, f"reading the recording was ended from outside ({how})"
    culprit = next((file for file in _files(arguments) if not _is_readable(file)), None)
    where = "a file of this recording" if culprit is None else str(culprit)
    return 1, (
        f"{where} is damaged in a way that Rerun does not survive ({how}); move it away to read the rest, "
        f"or try `rerun rrd merge --continue-on-error` on it"
    )


def _files(arguments: list[str]) -> list[Path]:
    paths = [Path(argument) for argument in arguments[1:] if not argument.startswith("-")]
    return [file for path in paths for file in (sorted(path.glob("part-*.rrd")) if path.is_dir() else [path])]


def _is_readable(file: Path) -> bool:
    """Whether a process that reads all of `file` lives."""
    command = [sys.executable, "-c", CHECK, str(file)]
    try:
        done = subprocess.run(  # noqa: S603 - this interpreter
            command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=CHECK_TIMEOUT_S, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode >= 0
