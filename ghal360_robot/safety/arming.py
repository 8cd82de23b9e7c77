"""Who may move: armed only by a fresh press of the operator, disarmed by any loss.

Reset is not restart (ISO 13850): after an emergency stop the first press only unlatches, a second one arms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress
from operator import gt, lt
from typing import TYPE_CHECKING

from ghal360_robot.messages import ArmState, BaseMode, Stops

if TYPE_CHECKING:
    from ghal360_robot.messages import BaseState, Inputs, OperatorInput
    from ghal360_robot.safety.staleness import Staleness

DRIVE_TIMEOUT_NS = 2_000_000_000
"""The base changes mode within 50 ms (2017 logs); after two seconds it will not."""

SETTLE_NS = 1_000_000_000
"""Counts that fell and rise again within this are two senders that take turns, and no press of either."""


@dataclass(frozen=True, slots=True)
class Arming:
    """State of the gate; the press counts already seen are part of it."""

    state: ArmState = ArmState.DISARMED
    reason: str = "not armed yet"
    arm_seen: int | None = None
    disarm_seen: int = 0
    estop_seen: int = 0
    silent: bool = False
    """Whether the operator was, at the tick before."""
    holder: str = ""
    """Who sent the counts."""
    stops_seen: Stops = Stops()
    since_ns: int = 0
    drove: bool = False
    """The base has been in drive mode since the press."""
    fell_ns: int | None = None
    """When counts fell last."""


def step(arming: Arming, inputs: Inputs, stale: Staleness, losses: tuple[str, ...]) -> Arming:
    """One tick of the gate. `losses` are in words what takes the right to move away, besides what is stale."""
    now_ns, base = inputs.stamp_ns, inputs.base
    arming, pressed, replaced = _presses(arming, inputs.operator, now_ns, silent="operator" in stale.silent)
    arming, elsewhere = _stops(arming, inputs.stops)
    pressed |= elsewhere
    if "estop" in pressed:
        return replace(arming, state=ArmState.ESTOP, reason="emergency stop pressed", since_ns=now_ns)
    if arming.state is ArmState.ESTOP:
        if "arm" in pressed:
            return replace(arming, state=ArmState.DISARMED, reason="emergency stop reset; press again to arm")
        return arming
    if arming.state is ArmState.ARMED:
        why = "another operator took over" if replaced else _why_disarm(arming, now_ns, base, stale.lost + losses)
        if "disarm" in pressed:
            why = "disarmed by somebody else" if "disarm" in elsewhere else "disarmed by the operator"
        if why:
            return replace(arming, state=ArmState.DISARMED, reason=why)
        drives = base is not None and base.mode is BaseMode.DRIVE
        return replace(arming, drove=True) if drives and not arming.drove else arming
    if "arm" in pressed and "disarm" not in pressed:
        blockers = why_not_ready(base, stale, losses)
        if blockers:
            return replace(arming, reason="cannot arm: " + ", ".join(blockers))
        return replace(arming, state=ArmState.ARMED, reason="", since_ns=now_ns, drove=False)
    return arming


def why_not_ready(base: BaseState | None, stale: Staleness, losses: tuple[str, ...]) -> tuple[str, ...]:
    """What stands in the way of arming, in words; empty when a press would arm."""
    blockers = [*stale.lost, *stale.hold, *losses]
    if base is not None:
        blockers.extend(base.faults)
        if base.mode not in {BaseMode.STANDBY, BaseMode.DRIVE}:
            blockers.append(f"base is {base.mode.value}")
    return tuple(blockers)


def _why_disarm(arming: Arming, now_ns: int, base: BaseState | None, losses: tuple[str, ...]) -> str:
    if losses:
        return ", ".join(losses)
    if base is not None and base.faults:
        return "base fault: " + ", ".join(base.faults)
    due = arming.drove or now_ns - arming.since_ns > DRIVE_TIMEOUT_NS
    if base is not None and due and base.mode is not BaseMode.DRIVE:
        return f"base left the drive mode ({base.mode.value})"
    return ""


def _presses(
    arming: Arming, operator: OperatorInput | None, now_ns: int, *, silent: bool
) -> tuple[Arming, frozenset[str], bool]:
    """Edges since the last tick, and whether somebody else sits at the controls.

    Another holder, or counts that fall, belong to a new operator. Their first message, and the first after a
    silence, is a new start: an arm press in it may be as old as the silence. A stop counts however old it is.
    """
    if operator is None:
        return arming, frozenset(), False
    counts = (operator.arm_presses, operator.disarm_presses, operator.estop_presses)
    seen = (arming.arm_seen or 0, arming.disarm_seen, arming.estop_seen)
    same = operator.holder == arming.holder
    fell = same and any(map(lt, counts, seen))
    another = fell or not same
    replaced = another and arming.arm_seen is not None
    fell_ns = now_ns if fell else arming.fell_ns
    unsettled = fell_ns is not None and now_ns - fell_ns < SETTLE_NS
    new_start = silent or arming.silent or another or arming.arm_seen is None or unsettled
    old = (0, 0, 0) if another else seen
    pressed = set(compress(("arm", "disarm", "estop"), map(gt, counts, old)))
    if new_start:
        pressed.discard("arm")
    if counts == (arming.arm_seen, *seen[1:]) and silent is arming.silent and same:
        return arming, frozenset(pressed), replaced
    updated = replace(
        arming,
        arm_seen=counts[0],
        disarm_seen=counts[1],
        estop_seen=counts[2],
        silent=silent,
        holder=operator.holder,
        fell_ns=fell_ns,
    )
    return updated, frozenset(pressed), replaced


def _stops(arming: Arming, stops: Stops) -> tuple[Arming, frozenset[str]]:
    """Stops of anybody else since the last tick; counts that fell have begun anew at zero."""
    seen = arming.stops_seen
    if stops == seen:
        return arming, frozenset()
    counts = (("disarm", stops.disarm, seen.disarm), ("estop", stops.estop, seen.estop))
    pressed = {name for name, now, before in counts if now > before or 0 < now < before}
    return replace(arming, stops_seen=stops), frozenset(pressed)
