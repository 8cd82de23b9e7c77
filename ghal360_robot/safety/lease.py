"""Who may drive: the holder of a lease that is kept alive. Stops need no lease."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ghal360_robot.safety.mux import FUTURE_NS

if TYPE_CHECKING:
    from ghal360_robot.messages import Lease, OperatorInput

LEASE_S = 3.0
"""Renewed once a second: two renewals may get lost."""


def denied(lease: Lease | None, operator: OperatorInput | None, now_ns: int, lease_s: float = LEASE_S) -> str:
    """Why this operator may not drive, in words; empty if they may.

    Without any lease only the operator at the robot itself may, whose `holder` is empty.
    """
    if operator is None:
        return ""  # there is nobody to deny anything; freshness says that the operator is missing
    if lease is None:
        return "nobody holds the lease" if operator.holder else ""
    if not -FUTURE_NS <= now_ns - lease.stamp_ns <= lease_s * 1e9:
        return "the lease has expired"
    return "" if operator.holder == lease.holder else "another operator holds the lease"
