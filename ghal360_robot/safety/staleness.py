"""From the age of each input to holding still, and to giving up the right to move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.safety.mux import FUTURE_NS

if TYPE_CHECKING:
    from ghal360_robot.messages import Inputs
    from ghal360_robot.safety.limits import SafetyLimits

WORDS = {"operator": "operator", "tim571": "lidar", "rmp110": "base", "theta": "video"}


UNANSWERED_S = 0.08
"""Every motion frame is answered within 10 ms. After four at 50 Hz that were not, the frames may wait in a queue; from
0.1 s on the driver itself says zero instead, and a command must not come back from there at full speed."""


@dataclass(frozen=True, slots=True)
class Staleness:
    """`hold`: stand still now; `lost`: disarm; both in words. `silent` names the inputs that are too old."""

    hold: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    silent: frozenset[str] = frozenset()


def judge(inputs: Inputs, limits: SafetyLimits) -> Staleness:
    """Compare every input's age with its two limits; an input that was never seen is lost.

    An operator whose stamps run ahead of the robot's clock could never grow old: that one counts as silent.
    """
    hold: list[str] = []
    lost: list[str] = []
    silent: set[str] = set()
    lost_s = dict(limits.lost_s)
    for name, hold_s in limits.hold_s:
        word = WORDS.get(name, name)
        fresh = inputs.freshness.get(name)
        if fresh is None or not fresh.age_s <= lost_s[name]:
            lost.append(f"{word} lost")
            silent.add(name)
        elif not fresh.valid:
            lost.append(f"{word} not valid")
        elif fresh.age_s > hold_s:
            hold.append(f"{word} stale")
            silent.add(name)
        elif not fresh.rate_ok:
            hold.append(f"{word} slow")
    if inputs.operator is not None and inputs.operator.stamp_ns > inputs.stamp_ns + FUTURE_NS:
        hold.append("operator stamps from the future")
        silent.add("operator")
    return Staleness(tuple(hold), tuple(lost), frozenset(silent))


def unanswered(inputs: Inputs) -> str:
    """Why the base may not have heard the last commands, in words; empty where it has."""
    base = inputs.freshness.get("rmp110")
    late = base is None or not base.age_s <= UNANSWERED_S
    return "base answers late" if late else ""
