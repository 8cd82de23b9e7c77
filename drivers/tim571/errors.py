"""What can go wrong with the lidar, each kind also being the built-in error it resembles."""

from __future__ import annotations

from drivers.tim571.codec.faults import Fault


class TimError(Exception):
    """Root of every error of this driver; its text is a sentence for the person at the robot."""


class TimUnreachableError(TimError, ConnectionError):
    """No connection to the lidar could be opened, or an open one broke."""


class TimTimeoutError(TimError, TimeoutError):
    """The lidar did not say in time what it should have said."""


class TimRefusedError(TimError, PermissionError):
    """The lidar answered a request with `sFA` or with a refusal; `fault` holds the code if it gave one."""

    def __init__(self, text: str, fault: Fault | int | None = None) -> None:
        super().__init__(text)
        self.fault = fault


class TimMalformedError(TimError, ValueError):
    """Bytes that cannot be what they claim to be; `fault` is the code a device would answer them with."""

    def __init__(self, text: str, fault: Fault = Fault.INVALID_DATA) -> None:
        super().__init__(text)
        self.fault = fault


class TimAnswerError(TimError, ValueError):
    """The lidar answered a request with something that is not an answer to it."""
