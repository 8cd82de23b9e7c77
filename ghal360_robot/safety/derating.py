"""Slower with what gets worse: the operator's latency, the battery, the temperature, wheels that do not follow.

One table. Each quantity has thresholds to warn, to derate and to stop; a level is entered at its threshold and left
only a hysteresis further back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from ghal360_robot.messages import Twist

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ghal360_robot.messages import Inputs

LATENCY, BATTERY, TEMPERATURE, WHEELS = "latency", "battery", "temperature", "wheels"


class Level(IntEnum):
    """How bad it is."""

    FINE = 0
    WARN = 1
    DERATE = 2
    STOP = 3


@dataclass(frozen=True, slots=True)
class Rule:
    """Thresholds of one quantity, in its own unit; where `stop` is below `warn`, less is worse."""

    name: str
    unit: str
    warn: float
    derate: float
    stop: float
    hysteresis: float
    share: float = 0.5
    """Of the wanted speed while derated."""
    disarms: bool = False
    """At `stop` the robot is disarmed; otherwise it stands still until things are better."""


RULES = (
    # Driving by picture gets worse from 0.2 s on and is hopeless beyond 0.4 s of delay (fact sheet on safety, A5).
    Rule(LATENCY, "s", 0.3, 0.5, 0.8, 0.05),
    # Enough left to drive back with; below that the pack's own protection may cut the power while moving.
    Rule(BATTERY, "%", 25.0, 15.0, 8.0, 2.0, disarms=True),
    # Lithium iron phosphate packs are rated to 60 degrees when discharging.
    Rule(TEMPERATURE, "degC", 50.0, 55.0, 60.0, 3.0, disarms=True),
    # Seconds for which the base has been warning that its wheels slip or do not follow.
    Rule(WHEELS, "s", 0.0, 0.0, 1.5, 0.0, share=0.4, disarms=True),
)


@dataclass(frozen=True, slots=True)
class Derating:
    """The level of each rule, and since when the base warns."""

    levels: tuple[Level, ...] = ()
    warned_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Reading:
    """One rule at this tick."""

    rule: Rule
    level: Level
    words: str


def step(state: Derating, inputs: Inputs, rules: Sequence[Rule] = RULES) -> tuple[Derating, tuple[Reading, ...]]:
    """One tick: the new levels, and what is not fine in words."""
    warned_ns = _warned(state, inputs)
    levels: list[Level] = []
    readings: list[Reading] = []
    for n, rule in enumerate(rules):
        value = _value(rule.name, inputs, warned_ns)
        level = _level(rule, value, state.levels[n] if state.levels else Level.FINE)
        levels.append(level)
        if value is not None and level > Level.FINE:
            readings.append(Reading(rule, level, _words(rule, value, inputs)))
    return Derating(tuple(levels), warned_ns), tuple(readings)


def derate(wanted: Twist, readings: Sequence[Reading]) -> tuple[Twist, tuple[str, ...]]:
    """The wanted twist at the least share that any rule leaves of it, and every warning."""
    share = min((reading.rule.share for reading in readings if reading.level is Level.DERATE), default=1.0)
    said = tuple(f"{'slow: ' if reading.level is Level.DERATE else ''}{reading.words}" for reading in readings)
    return Twist(share * wanted.v, share * wanted.w), said


def stops(readings: Sequence[Reading], *, disarms: bool) -> tuple[str, ...]:
    """What stops the robot now, in words: what disarms it, or what only holds it."""
    return tuple(r.words for r in readings if r.level is Level.STOP and r.rule.disarms is disarms)


def _value(name: str, inputs: Inputs, warned_ns: int | None) -> float | None:
    """The quantity as of this tick; None where nobody says."""
    operator, base = inputs.operator, inputs.base
    if name == LATENCY:
        return None if operator is None else operator.latency_s
    if name == WHEELS:
        return None if warned_ns is None else (inputs.stamp_ns - warned_ns) / 1e9
    if base is None:
        return None
    return base.battery_percent if name == BATTERY else base.temperature_degc


def _warned(state: Derating, inputs: Inputs) -> int | None:
    if inputs.base is None or not inputs.base.warnings:
        return None
    return inputs.stamp_ns if state.warned_ns is None else state.warned_ns


def _level(rule: Rule, value: float | None, before: Level) -> Level:
    """A quantity that nobody tells is taken as fine, one that is no number as the worst."""
    if value is None:
        return Level.FINE
    if not math.isfinite(value):
        return Level.STOP
    sign = -1.0 if rule.stop < rule.warn else 1.0
    for level, at in ((Level.STOP, rule.stop), (Level.DERATE, rule.derate), (Level.WARN, rule.warn)):
        if sign * value >= sign * at or (level <= before and sign * value > sign * at - rule.hysteresis):
            return level
    return Level.FINE


def _words(rule: Rule, value: float, inputs: Inputs) -> str:
    if rule.name == WHEELS and inputs.base is not None:
        return ", ".join(inputs.base.warnings)
    return f"{rule.name} {value:.{1 if rule.unit == 's' else 0}f} {rule.unit}"
