"""The error codes of `sFA`, in words (TiM781 manual pages 119-120; fact sheet section 3)."""

from __future__ import annotations

from enum import IntEnum


class Fault(IntEnum):
    """A code of the `sFA` answer."""

    OK = 0x00
    METHOD_ACCESS_DENIED = 0x01
    UNKNOWN_METHOD = 0x02
    UNKNOWN_VARIABLE = 0x03
    LOCAL_CONDITION_FAILED = 0x04
    INVALID_DATA = 0x05
    UNKNOWN_ERROR = 0x06
    BUFFER_OVERFLOW = 0x07
    BUFFER_UNDERFLOW = 0x08
    UNKNOWN_TYPE = 0x09
    WRITE_ACCESS_DENIED = 0x0A
    UNKNOWN_NAME = 0x0B
    UNKNOWN_COMMAND = 0x0C
    METHOD_SERVER_BUSY = 0x0D
    OUT_OF_BOUNDS = 0x0E
    UNKNOWN_EVENT = 0x0F
    VALUE_OVERFLOW = 0x10
    INVALID_CHARACTER = 0x11
    NO_MESSAGE = 0x12
    NO_ANSWER = 0x13
    INTERNAL = 0x14
    HUB_ADDRESS_CORRUPTED = 0x15
    HUB_ADDRESS_DECODING = 0x16
    HUB_ADDRESS_EXCEEDED = 0x17
    HUB_BLANK_EXPECTED = 0x18
    ASYNC_METHODS_SUPPRESSED = 0x19
    COMPLEX_ARRAYS_UNSUPPORTED = 0x1A


_MEANINGS = {
    Fault.OK: "no error",
    Fault.METHOD_ACCESS_DENIED: "the method needs a higher login level",
    Fault.UNKNOWN_METHOD: "it does not know the method",
    Fault.UNKNOWN_VARIABLE: "it does not know the variable",
    Fault.LOCAL_CONDITION_FAILED: "a value is outside its limits",
    Fault.INVALID_DATA: "the data is invalid",
    Fault.UNKNOWN_ERROR: "unknown error",
    Fault.BUFFER_OVERFLOW: "the request carries too many parameters",
    Fault.BUFFER_UNDERFLOW: "the request carries too few parameters",
    Fault.UNKNOWN_TYPE: "unknown parameter type",
    Fault.WRITE_ACCESS_DENIED: "the variable is read-only or needs a login first",
    Fault.UNKNOWN_NAME: "its name server does not know the command",
    Fault.UNKNOWN_COMMAND: "it does not know the kind of telegram",
    Fault.METHOD_SERVER_BUSY: "another method is still running",
    Fault.OUT_OF_BOUNDS: "an index is out of bounds",
    Fault.UNKNOWN_EVENT: "it does not know the event",
    Fault.VALUE_OVERFLOW: "a value is too large for its parameter",
    Fault.INVALID_CHARACTER: "a parameter holds an invalid character",
    Fault.NO_MESSAGE: "internal: no message",
    Fault.NO_ANSWER: "internal: no answer",
    Fault.INTERNAL: "internal error",
    Fault.HUB_ADDRESS_CORRUPTED: "the hub address is corrupted",
    Fault.HUB_ADDRESS_DECODING: "the hub address cannot be decoded",
    Fault.HUB_ADDRESS_EXCEEDED: "the hub address is too large",
    Fault.HUB_BLANK_EXPECTED: "a blank is missing in the hub address",
    Fault.ASYNC_METHODS_SUPPRESSED: "asynchronous methods are suppressed",
    Fault.COMPLEX_ARRAYS_UNSUPPORTED: "complex arrays are not supported",
}


def named(code: int) -> Fault | int:
    """The code by its name, or as it is where no source lists it."""
    try:
        return Fault(code)
    except ValueError:
        return code


def meaning(code: int) -> str:
    """What the device wants to say with `sFA <code>`, as a clause."""
    try:
        return _MEANINGS[Fault(code)]
    except ValueError:
        return f"undocumented error code {code:X}"
