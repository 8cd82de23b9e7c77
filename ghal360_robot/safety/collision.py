"""The collision monitor: what is seen and remembered around the robot against the motion that is wanted.

It is no personal-protection device: the lidar sees one plane, a hand's breadth above the floor; table tops, feet
below it, glass and stairs are invisible to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.messages import STILL, Twist
from ghal360_robot.safety.footprint import Disc, disc_velocity
from ghal360_robot.safety.limits import OLDEST_S
from ghal360_robot.safety.memory import Memory, Scene, here, known_free
from ghal360_robot.safety.mux import TELEOP
from ghal360_robot.safety.view import out_of_sight
from ghal360_robot.safety.zones import Around, Verdict, limit, stopping_m

if TYPE_CHECKING:
    from ghal360_robot.messages import Inputs, Surroundings
    from ghal360_robot.safety.limits import SafetyLimits


@dataclass(frozen=True, slots=True, eq=False)
class Monitor:
    """One tick's view of the surroundings; `check` holds any motion against it."""

    limits: SafetyLimits
    memory: Memory
    scene: Scene
    seen: Surroundings
    around: Around
    """What is seen, from where the base is now."""
    measured: Twist
    now_ns: int
    source: str
    """Whose command it is: only a hand on the stick may back."""
    stopped: float
    """The speed at which the robot had to stop before; see `zones.limit`."""

    def check(self, wanted: Twist) -> tuple[Twist, tuple[str, ...], float | None]:
        """The part of `wanted` that is safe, why not more, and the free metres on its way (None: nothing in it)."""
        twist, reasons = self._in_sight(wanted)
        if twist == STILL:
            return STILL, reasons, None
        free, verdict = limit(self.around, twist, self.limits, self.measured, self.stopped)
        if free != twist:
            reasons = (*reasons, _words(free, twist, verdict))
            why = self._blind(free)  # a slower or tighter way is another one
            if why:
                return STILL, (*reasons, why), None
        return free, reasons, verdict.free_m if math.isfinite(verdict.free_m) else None

    def _in_sight(self, wanted: Twist) -> tuple[Twist, tuple[str, ...]]:
        """Without what would lead into ground that the lidar does not look at."""
        turn = Twist(0.0, wanted.w)
        if wanted.v > 0.0 and self.scene.blind_ahead:
            return (STILL if self._blind(turn) else turn), (self.scene.blind_ahead,)
        why = self._blind(wanted)
        if why:
            return (turn if wanted.v and not self._blind(turn) else STILL), (why,)
        if wanted.v > self.limits.slow_max and self.scene.silent_ahead:
            share = self.limits.slow_max / wanted.v
            return Twist(self.limits.slow_max, share * wanted.w), (self.scene.silent_ahead,)
        return wanted, ()

    def _blind(self, twist: Twist) -> str:
        """Why this motion would lead into unseen ground; empty where it does not."""
        footprint = self.limits.footprint
        hidden = out_of_sight(self.seen, twist, [(disc, self._way_m(disc, twist)) for disc in footprint])
        if not hidden:
            return ""
        word = "backwards" if twist.v < 0.0 else "curve" if twist.v else "turning"
        if twist.v < 0.0 and self.source != TELEOP:
            return f"{word}: lidar is blind there"
        someone_ns = self.memory.someone_ns
        if someone_ns is not None and self.now_ns - someone_ns < self.limits.ground_memory_s * 1e9:
            return f"{word}: lidar is blind there, and somebody is about"
        outline_m = max(disc.radius - math.hypot(disc.x, disc.y) for disc in footprint)
        if known_free(self.memory, np.array(hidden), outline_m, self.now_ns).all():
            return ""
        return f"{word}: lidar is blind there, and has not seen it lately"

    def _way_m(self, disc: Disc, twist: Twist) -> float:
        """How far a part of the robot moves until it stands, from the faster of what is wanted and what is done."""
        speed = max(math.hypot(*disc_velocity(disc, twist)), math.hypot(*disc_velocity(disc, self.measured)))
        return stopping_m(speed, self.limits.decel, self.limits.reaction_s)


def watch(limits: SafetyLimits, memory: Memory, inputs: Inputs, source: str, stopped: float) -> Monitor | str:
    """The monitor of this tick; or why nothing is known about the surroundings."""
    seen, scene, base = inputs.surroundings, memory.scene, inputs.base
    if seen is None or scene is None or base is None:
        return "no scan"
    if abs(inputs.stamp_ns - seen.stamp_ns) > OLDEST_S * 1e9:
        return "the scan is old"  # whenever it arrived
    now_ns = inputs.stamp_ns
    return scene.fault or Monitor(
        limits, memory, scene, seen, here(memory, now_ns), base.twist, now_ns, source, stopped
    )


def _words(free: Twist, wanted: Twist, verdict: Verdict) -> str:
    """The limiting direction in words for the person who drives."""
    stopped = free.v == 0.0 if wanted.v else free.w == 0.0
    what = "person" if verdict.person else "obstacle"
    place = "close by" if verdict.at is None else direction(math.atan2(verdict.at[1], verdict.at[0]))
    metres = f" {verdict.free_m:.1f} m" if math.isfinite(verdict.free_m) else ""
    return f"{'stopped' if stopped else 'slowed'}: {what}{metres}, {place}"


def direction(bearing: float) -> str:
    """A direction in the base frame in words."""
    degrees = math.degrees(bearing)
    if abs(degrees) <= 10:
        return "ahead"
    return f"{abs(degrees):.0f} deg {'left' if degrees > 0 else 'right'}"
