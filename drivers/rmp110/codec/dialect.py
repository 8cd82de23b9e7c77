"""The wire protocols that a base called RMP 110 may speak (fact sheet sections 1, 2)."""

from __future__ import annotations

from enum import Enum


class Dialect(Enum):
    """B1 to B3 are the 0x500 family on CAN; V3 is the later firmware's protocol on UDP and USB."""

    B1 = "B1"
    B2 = "B2"
    B3 = "B3"
    V3 = "V3"


class Action(Enum):
    """Commands of the 0x500 family that store nothing; each dialect numbers them its own way."""

    NONE = "none"
    FORCE_CONFIG_FEEDBACK = "force configuration feedback"
    AUDIO = "audio"
    MODE_REQUEST = "mode request"
    FAULT_LOG = "fault log"
    RESET_INTEGRATORS = "reset integrators"
    RESET_PARAMETERS = "reset parameters"
    CONTINUOUS_DATA = "continuous data"
