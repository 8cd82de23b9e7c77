"""What can go wrong with the base; every text is for the person standing next to it."""

# ruff: noqa: N818 - errors are named by what happened, like the built-in ones they also are

from __future__ import annotations


class RmpError(Exception):
    """Root of everything this driver raises."""


class RmpLinkError(RmpError, ConnectionError):
    """The bus or the base is not there, or no longer there."""


class RmpInterfaceError(RmpLinkError):
    """The CAN interface could not be opened."""


class RmpSilent(RmpLinkError):
    """The base stopped answering; after a kill switch that is its normal state."""


class RmpForeignCommands(RmpLinkError):
    """Somebody else commands the base on the same bus."""


class RmpPoweringDown(RmpLinkError):
    """The base announced that it switches itself off."""


class RmpTimeout(RmpError, TimeoutError):
    """The base answers, but did not do what was asked in time."""


class RmpSendDropped(RmpError, OSError):
    """A frame was not taken by the bus, and is gone. One that was taken may still wait in the kernel's queue."""


class RmpUnacknowledged(RmpSendDropped):
    """Nobody acknowledges on the bus: a motion command would wait in its queue, and was not sent."""


class RmpTooFast(RmpSendDropped):
    """A motion command came sooner after the last one than the base takes them; it was not sent."""


class RmpUnsupported(RmpError, NotImplementedError):
    """The base speaks a dialect, or has a feedback set, that this driver cannot use."""


class RmpRefused(RmpError, RuntimeError):
    """The driver does not do this now; the text says what has to happen first."""


class RmpNotIdentified(RmpRefused):
    """Dialect and stored limits are not known (again), so nothing may move."""


class RmpWrongMode(RmpRefused):
    """The base is not in the mode that this needs, or was not put there by an explicit request."""


class RmpHeld(RmpRefused):
    """The watchdog stopped the base while the program was stuck; a zero command has to come first."""


class RmpFaulted(RmpRefused):
    """The base reports a fault or an intervention of its own."""


class RmpLimitsDiffer(RmpRefused):
    """The base's stored parameters are not the configured ones and make it move otherwise than planned."""


class RmpBadCommand(RmpError, ValueError):
    """A velocity that is not a finite number, or a parameter outside its documented range."""


class RmpForbiddenFrame(RmpError, ValueError):
    """A frame that must never reach the wire was stopped right before it."""
