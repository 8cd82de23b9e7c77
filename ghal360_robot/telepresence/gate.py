"""Whether a driver's message counts: of this connection, newer than the last, neither old nor of the future. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ghal360_robot.telepresence.protocol import Operate

MAX_AGE_US = 400_000
"""A wish this old was made for another picture; the operator's silence is noticed sooner, after 0.2 s."""

FUTURE_US = 60_000
"""The page's idea of the robot's clock is off by half the asymmetry of its fastest round trip."""

TAKEN = "taken"


@dataclass(frozen=True, slots=True)
class Gate:
    """What was taken from this connection so far; a refused message leaves no trace."""

    conn: str
    seq: int = -1
    arm: int = 0
    disarm: int = 0
    found: int = 0


def judge(gate: Gate, message: Operate, now_us: int, *, drives: bool) -> tuple[Gate, str]:
    """The gate after this message and TAKEN, or the gate as it was and why not, in words for log and page."""
    if message.conn != gate.conn:
        return gate, "of another connection"
    if message.seq <= gate.seq:
        return gate, "replayed or overtaken"
    if message.sent_us > now_us + FUTURE_US:
        return gate, f"stamped {(message.sent_us - now_us) / 1e6:.2f} s in the future"
    if now_us - message.sent_us > MAX_AGE_US:
        return gate, f"{(now_us - message.sent_us) / 1e6:.2f} s old"
    if not drives:
        return gate, "not the driver's"
    if message.arm < gate.arm or message.disarm < gate.disarm or message.found < gate.found:
        return gate, "counts presses backwards"
    return Gate(gate.conn, message.seq, message.arm, message.disarm, message.found), TAKEN
