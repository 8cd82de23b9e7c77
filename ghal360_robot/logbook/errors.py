"""What can go wrong with a recording, in words for the person at the robot."""

from __future__ import annotations


class LogbookError(Exception):
    """Root of everything the logbook raises."""


class RecordingNotWritableError(LogbookError, OSError):
    """The place for a recording cannot be written."""


class RecordingNotReadableError(LogbookError, OSError):
    """A recording is missing, or holds nothing that can be read."""
