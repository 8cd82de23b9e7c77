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
    arming, pressed, replaced = _presses(arming, operator, silent="operator" in stale.silent)
    if "estop" in pressed:
        return replace(arming, state=ArmState.ESTOP, reason="emergency stop pressed", since_ns=now_ns)
    if arming.state is ArmState.ESTOP:
        if "arm" in pressed:
            return replace(arming, state=ArmState.DISARMED, reason="emergency stop reset; press again to arm")
        return arming
    if arming.state is ArmState.ARMED:
        why = "another operator took over" if replaced else _why_disarm(arming, now_ns, base, stale, pressed)
        return replace(arming, state=ArmState.DISARMED, reason=why) if why else arming
    if "arm" in pressed and "disarm" not in pressed:
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


def _presses(arming: Arming, operator: OperatorInput | None, *, silent: bool) -> tuple[Arming, frozenset[str], bool]:
    """Edges since the last tick, and whether somebody else sits at the controls.

    Counts that fall belong to a new operator. Their first message, and the first after a silence, is a new
    start: an arm press in it may be as old as the silence. A stop counts however old it is.
    """
    if operator is None:
        return arming, frozenset(), False
    counts = (operator.arm_presses, operator.disarm_presses, operator.estop_presses)
    seen = (arming.arm_seen or 0, arming.disarm_seen, arming.estop_seen)
    fell = any(now < before for now, before in zip(counts, seen, strict=True))
    replaced = fell and arming.arm_seen is not None
    new_start = silent or fell or arming.arm_seen is None
    old = (0, 0, 0) if fell else seen
    names = ("arm", "disarm", "estop")
    pressed = {name for name, now, before in zip(names, counts, old, strict=True) if now > before}
    if new_start:
        pressed.discard("arm")
    arm_seen = None if silent else counts[0]
    updated = replace(arming, arm_seen=arm_seen, disarm_seen=counts[1], estop_seen=counts[2])
    return updated, frozenset(pressed), replaced
