"""The envelope of motion: what may be asked of the base at all, and every number of the chain."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ghal360_robot.messages import STILL, Twist
from ghal360_robot.safety.derating import RULES, Rule
from ghal360_robot.safety.footprint import Disc
from ghal360_robot.safety.lease import LEASE_S
from ghal360_robot.safety.mux import SOURCES, LockRule, Source
from ghal360_robot.safety.watchdog import GAP_S

OLDEST_S = 0.3
"""The robot moves by no scan that was measured longer ago, however regularly such late scans arrive."""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Numbers of the whole chain, SI. Defaults are the RMP-110's stored limits and the zones sized by them."""

    v_max: float = 0.5
    w_max: float = 0.8
    wheel_max: float = 0.7
    track_m: float = 0.481224
    accel: float = 0.5
    decel: float = 0.5
    w_accel: float = 1.5
    reverse_max: float = 0.15
    footprint: tuple[Disc, ...] = (Disc(0.0, 0.0, 0.40),)
    margin_m: float = 0.04
    standoff_m: float = 0.10
    slow_margin_m: float = 0.12
    slow_max: float = 0.3
    person_margin_m: float = 0.25
    person_speed: float = 1.2
    person_memory_s: float = 30.0
    ground_memory_s: float = 5.0
    reaction_s: float = 0.25
    tick_gap_s: float = GAP_S
    lease_s: float = LEASE_S
    sources: tuple[Source, ...] = SOURCES
    locks: tuple[LockRule, ...] = ()
    deratings: tuple[Rule, ...] = RULES
    hold_s: tuple[tuple[str, float], ...] = (("operator", 0.2), ("tim571", 0.25), ("rmp110", 0.25), ("theta", 0.7))
    """Age of an input from which the base stands still."""
    lost_s: tuple[tuple[str, float], ...] = (("operator", 1.0), ("tim571", 1.0), ("rmp110", 1.0), ("theta", 2.0))
    """Age of an input from which the robot is disarmed."""

    @property
    def outline_m(self) -> float:
        """How far the footprint reaches from the base's origin."""
        return max(math.hypot(disc.x, disc.y) + disc.radius for disc in self.footprint)

    @property
    def reach_m(self) -> float:
        """How far from the base things matter that stay where they are: what full speed needs to stop before them."""
        way_m = self.v_max * self.reaction_s + self.v_max**2 / (2.0 * self.decel)
        beside_m = max(self.margin_m + self.standoff_m, self.slow_margin_m)
        return self.outline_m + way_m + beside_m + self.v_max * OLDEST_S

    @property
    def people_reach_m(self) -> float:
        """How far people matter, who come closer meanwhile."""
        braking_s = self.reaction_s + self.v_max / self.decel
        return self.reach_m + self.person_speed * braking_s + self.person_margin_m


def clamp(wanted: Twist, limits: SafetyLimits) -> tuple[Twist, tuple[str, ...]]:
    """The nearest twist of the same curvature inside the envelope; anything not finite becomes a standstill.

    The envelope is that of the base's centre and that of its wheels: the outer one is faster than the centre.
    """
    if not (math.isfinite(wanted.v) and math.isfinite(wanted.w)):
        return STILL, ("command is not a number",)
    said: tuple[str, ...] = ()
    if wanted.v < 0.0 and limits.reverse_max == 0.0:
        wanted, said = Twist(0.0, wanted.w), ("reversing is off",)
    forward = limits.v_max if wanted.v >= 0.0 else limits.reverse_max
    # Divided one by one: the sum of two huge numbers may not be finite.
    wheel = abs(wanted.v) / limits.wheel_max + abs(wanted.w) * (limits.track_m / 2.0 / limits.wheel_max)
    excess = max(abs(wanted.v) / forward, abs(wanted.w) / limits.w_max, wheel)
    if excess <= 1.0:
        return wanted, said
    if not math.isfinite(excess):
        return STILL, ("command is absurd",)
    return Twist(wanted.v / excess, wanted.w / excess), (*said, "speed limit")
