"""Whose command is taken: the live source of the highest priority, unless a lock holds it back (as in twist_mux).

Unlike there, a source that falls silent does not hand over to the next one at once: the robot first stands
still for a while, so that nobody's program drives on where another's has died.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.messages import STILL, Command, Twist

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ghal360_robot.messages import Inputs, Lock

FUTURE_NS = 20_000_000
"""A stamp may be this far ahead of the tick's, which was taken before the inputs were read; one tick."""

TELEOP, AUTONOMY, TEST = "teleop", "autonomy", "test"


@dataclass(frozen=True, slots=True)
class Source:
    """Somebody who may ask for motion; the higher `priority` wins (0..255)."""

    name: str
    priority: int
    hold_s: float
    """Silent for longer: its command is zero."""
    gone_s: float
    """Silent for longer: it is no source any more, and the next one is taken."""


@dataclass(frozen=True, slots=True)
class LockRule:
    """A lock that has to be there: until its publisher is heard, and when it falls silent, it holds."""

    name: str
    priority: int = 255
    """Sources of lower priority are held."""
    hold_s: float = 0.5


SOURCES = (
    Source(TELEOP, 100, 0.2, 1.0),
    Source(TEST, 50, 0.3, 1.0),
    Source(AUTONOMY, 10, 0.2, 1.0),
)
"""A hand on the stick overrides a program under test, and both override driving by gaze."""


@dataclass(frozen=True, slots=True)
class Taken:
    """The command that won; `held` says why it is zero where that is not its own wish."""

    source: str = ""
    twist: Twist = STILL
    held: tuple[str, ...] = ()


def asked(inputs: Inputs, wanted: Twist) -> tuple[Command, ...]:
    """What everybody asks for at this tick; `wanted` is the brain's wish."""
    operator = inputs.operator
    stick = () if operator is None or operator.stick is None else (operator.stick,)
    own = (*(Command(TELEOP, operator.stamp_ns, twist) for twist in stick if operator is not None),)
    others = tuple(command for command in inputs.commands if command.source not in {TELEOP, AUTONOMY})
    return (*own, Command(AUTONOMY, inputs.stamp_ns, wanted), *others)


def take(
    commands: Sequence[Command],
    locks: Sequence[Lock],
    now_ns: int,
    sources: Sequence[Source] = SOURCES,
    rules: Sequence[LockRule] = (),
) -> Taken:
    """The one command of this tick."""
    newest = {command.source: command for command in commands}
    barred, by = _barred(locks, now_ns, rules)
    for source in sorted(sources, key=lambda source: -source.priority):
        command = newest.get(source.name)
        if command is None or now_ns - command.stamp_ns > source.gone_s * 1e9:
            continue
        if source.priority < barred:
            return Taken(source.name, STILL, (by,))
        if command.stamp_ns > now_ns + FUTURE_NS:
            return Taken(source.name, STILL, (f"{source.name}: stamp from the future",))
        if now_ns - command.stamp_ns > source.hold_s * 1e9:
            return Taken(source.name, STILL, (f"{source.name} is silent",))
        return Taken(source.name, command.twist)
    return Taken(held=("nobody asks for motion",))


def _barred(locks: Sequence[Lock], now_ns: int, rules: Sequence[LockRule]) -> tuple[int, str]:
    """The priority below which sources are held, and by what; a lock that no rule names holds everybody."""
    known = {rule.name: rule for rule in rules}
    seen = {lock.name: lock for lock in locks}
    highest, by = 0, ""
    for name in (*known, *(name for name in seen if name not in known)):
        rule, lock = known.get(name, LockRule(name)), seen.get(name)
        silent = lock is None or not -FUTURE_NS <= now_ns - lock.stamp_ns <= rule.hold_s * 1e9
        if (silent or (lock is not None and lock.engaged)) and rule.priority > highest:
            highest, by = rule.priority, f"lock '{name}' is silent" if silent else f"held by lock '{name}'"
    return highest, by
