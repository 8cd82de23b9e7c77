"""What can be wrong with the material of an experiment."""

from __future__ import annotations

from ghal360_robot.errors import UsageError


class EnvironmentFileError(UsageError):
    """An environment cannot be read, or no search can be made in it."""
