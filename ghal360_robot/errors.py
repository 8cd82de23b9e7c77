"""The errors a person at the robot sees: one clear sentence, and the exit status that goes with it."""

from __future__ import annotations


class GhalError(Exception):
    """Something failed; the text says what happened, what it means and what to do (exit status 1)."""

    exit_status = 1


class UsageError(GhalError, ValueError):
    """The request itself is wrong: configuration, names, paths (exit status 2)."""

    exit_status = 2
