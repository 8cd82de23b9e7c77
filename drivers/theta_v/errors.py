"""What can go wrong with the camera, in sentences for the person standing next to it."""

from __future__ import annotations


class ThetaError(Exception):
    """Root of everything this driver raises."""


class ThetaMalformed(ThetaError, ValueError):  # noqa: N818 named for what happened
    """Bytes that do not follow their format: a descriptor, a container, a parameter set, a message."""


class ThetaNotFound(ThetaError, ConnectionError):  # noqa: N818 named for what happened
    """No such camera on the bus."""


class ThetaWrongDevice(ThetaNotFound):
    """There is a device, but it is no THETA, or not the one with the configured serial number."""


class ThetaRefused(ThetaError, ConnectionRefusedError):  # noqa: N818 named for what happened
    """The camera, or whoever holds it, said no."""


class ThetaGone(ThetaError, ConnectionResetError):  # noqa: N818 named for what happened
    """The camera left the bus: unplugged, switched off, overheated or changing its mode."""


class ThetaStall(ThetaError, BrokenPipeError):  # noqa: N818 named for what happened
    """The camera answered one request with STALL: it does not know it or will not do it now."""


class ThetaTimeout(ThetaError, TimeoutError):  # noqa: N818 named for what happened
    """The camera did not answer in time."""
