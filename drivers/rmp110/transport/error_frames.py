"""Linux' CAN error frames (linux/can/error.h): what the controller says about the wire, as data.

The class bits are in the id, details in the eight data bytes; socketcand passes the classes on without details.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag


class ErrorClass(IntFlag):
    """Bits of an error frame's id."""

    TX_TIMEOUT = 0x001
    LOST_ARBITRATION = 0x002
    CONTROLLER = 0x004
    PROTOCOL = 0x008
    TRANSCEIVER = 0x010
    NO_ACK = 0x020
    BUS_OFF = 0x040
    BUS_ERROR = 0x080
    RESTARTED = 0x100
    COUNTERS = 0x200
    """Data bytes 6 and 7 hold the error counters; older kernels fill them without this bit."""


class Controller(IntFlag):
    """Bits of data byte 1, valid with `ErrorClass.CONTROLLER`."""

    RX_OVERFLOW = 0x01
    TX_OVERFLOW = 0x02
    RX_WARNING = 0x04
    TX_WARNING = 0x08
    RX_PASSIVE = 0x10
    TX_PASSIVE = 0x20
    ACTIVE = 0x40


PASSIVE = Controller.RX_PASSIVE | Controller.TX_PASSIVE
WARNING = Controller.RX_WARNING | Controller.TX_WARNING
OVERFLOW = Controller.RX_OVERFLOW | Controller.TX_OVERFLOW
KNOWN_CLASSES = 0x3FF


@dataclass(frozen=True, slots=True)
class ErrorFrame:
    """One error frame; bits nobody documented are dropped."""

    classes: ErrorClass
    controller: Controller = Controller(0)
    tx_errors: int = 0
    rx_errors: int = 0
    """The controller's error counters, 0 to 255; 0 where the driver does not tell."""

    def has(self, error_class: ErrorClass) -> bool:
        return bool(self.classes & error_class)


def parse_error_frame(can_id: int, data: bytes) -> ErrorFrame:
    """An error frame's id (with or without flag bits) and data, which may be too short. Never raises."""
    classes = ErrorClass(can_id & KNOWN_CLASSES)
    details = data[:8].ljust(8, b"\x00")
    controller = Controller(details[1] & 0x7F) if classes & ErrorClass.CONTROLLER else Controller(0)
    return ErrorFrame(classes, controller, tx_errors=details[6], rx_errors=details[7])
