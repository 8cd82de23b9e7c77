"""Who may move: armed only by a fresh press of the operator, disarmed by any loss.

Reset is not restart (ISO 13850): after an emergency stop the first press only unlatches, a second one arms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ghal360_robot.messages import ArmState, BaseMode

if TYPE_CHECKING:
    from ghal360_robot.messages import BaseState, OperatorInput
    from ghal360_robot.safety.staleness import Staleness

DRIVE_TIMEOUT_NS = 2_000_000_000
"""The base changes mode within 50 ms (2017 logs); after two seconds it will not."""


@dataclass(frozen=True, slots=True)
class Arming:
    """State of the gate; the press counts already seen are part of it."""

    state: ArmState = ArmState.DISARMED
    reason: str = "not armed yet"
    arm_seen: int | None = None
    disarm_seen: int = 0
    estop_seen: int = 0
    since_ns: int = 0


def step(
    arming: Arming, now_ns: int, operator: OperatorInput | None, base: BaseState | None, stale: Staleness
) -> Arming:
    """One tick of the gate."""
    arming, pressed = _presses(arming, operator)
    if "estop" in pressed:
        return replace(arming, state=ArmState.ESTOP, reason="emergency stop pressed", since_ns=now_ns)
    if arming.state is ArmState.ESTOP:
        if "arm" in pressed:
            return replace(arming, state=ArmState.DISARMED, reason="emergency stop reset; press again to arm")
        return arming
    if arming.state is ArmState.ARMED:
        why = _why_disarm(arming, now_ns, base, stale, pressed)
        return replace(arming, state=ArmState.DISARMED, reason=why) if why else arming
    if "arm" in pressed:
        blockers = why_not_ready(base, stale)
        if blockers:
            return replace(arming, reason="cannot arm: " + ", ".join(blockers))
        return replace(arming, state=ArmState.ARMED, reason="", since_ns=now_ns)
    return arming


def why_not_ready(base: BaseState | None, stale: Staleness) -> tuple[str, ...]:
    """What stands in the way of arming, in words; empty when a press would arm."""
    blockers = list(stale.lost + stale.hold)
    if base is not None:
        blockers.extend(base.faults)
        if base.mode not in {BaseMode.STANDBY, BaseMode.DRIVE}:
            blockers.append(f"base is {base.mode.value}")
    return tuple(blockers)


def _why_disarm(arming: Arming, now_ns: int, base: BaseState | None, stale: Staleness, pressed: frozenset[str]) -> str:
    if "disarm" in pressed:
        return "disarmed by the operator"
    if stale.lost:
        return ", ".join(stale.lost)
    if base is not None and base.faults:
        return "base fault: " + ", ".join(base.faults)
    late = now_ns - arming.since_ns > DRIVE_TIMEOUT_NS
    if base is not None and late and base.mode is not BaseMode.DRIVE:
        return f"base left the drive mode ({base.mode.value})"
    return ""


def _presses(arming: Arming, operator: OperatorInput | None) -> tuple[Arming, frozenset[str]]:
    """Edges since the last tick. Counts that fall belong to a new operator: they are a new start, no press."""
    if operator is None:
        return arming, frozenset()
    counts = (operator.arm_presses, operator.disarm_presses, operator.estop_presses)
    seen = (arming.arm_seen, arming.disarm_seen, arming.estop_seen)
    fresh_start = arming.arm_seen is None or any(now < (old or 0) for now, old in zip(counts, seen, strict=True))
    pressed = frozenset(
        name
        for name, now, old in zip(("arm", "disarm", "estop"), counts, seen, strict=True)
        if now > (old or 0) and not (fresh_start and name == "arm")
    )
    updated = replace(arming, arm_seen=counts[0], disarm_seen=counts[1], estop_seen=counts[2])
    return updated, pressed
