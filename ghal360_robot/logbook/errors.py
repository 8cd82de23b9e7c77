"""What can go wrong with a recording, in words for the person at the robot."""

from __future__ import annotations

MADE_OF_FLIPPED_BITS = (ValueError, LookupError, TypeError, AttributeError)
"""What reading a row may raise whose bits have flipped: lengths that do not fit, unknown words, missing values."""


class LogbookError(Exception):
    """Root of everything the logbook raises."""


class RecordingNotWritableError(LogbookError, OSError):
    """The place for a recording cannot be written."""


class RecordingNotReadableError(LogbookError, OSError):
    """A recording is missing, or holds nothing that can be read."""
