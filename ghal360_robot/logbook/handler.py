"""Python's logging, into the recording's own queue."""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ghal360_robot.logbook.recorder import Recorder

# Marks what the recorder says of itself, which is in the recording already.
RECORDED = {"in_recording": True}

# A runaway message must not become the recording.
MAX_TEXT = 4096

LEVELS = (
    (logging.CRITICAL, "CRITICAL"),
    (logging.ERROR, "ERROR"),
    (logging.WARNING, "WARN"),
    (logging.INFO, "INFO"),
    (logging.DEBUG, "DEBUG"),
)


class LogbookHandler(logging.Handler):
    """Sends every record to `log/<logger's name>` of one recorder, whatever thread it comes from."""

    def __init__(self, recorder: Recorder, level: int = logging.INFO) -> None:
        super().__init__(level)
        self._recorder = recorder

    def emit(self, record: logging.LogRecord) -> None:
        if getattr(record, "in_recording", False):
            return
        try:
            text = self.format(record)
        except (TypeError, ValueError, KeyError):
            # A wrong format string is the caller's mistake; logging has its own way of saying so.
            self.handleError(record)
            return
        level = next((name for bound, name in LEVELS if record.levelno >= bound), "TRACE")
        self._recorder.text(time.monotonic_ns(), record.name, level, text[:MAX_TEXT])
