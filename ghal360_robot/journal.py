"""What happened in a run, added up tick by tick for its summary."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from ghal360_robot.messages import ArmState, Cue, LinkStats

if TYPE_CHECKING:
    from ghal360_robot.messages import Applied, Decision, Inputs

MAX_STOPS = 100
"""A robot that stops more often than this has told its story; the recording has the rest."""

JUMP_M = 0.2
"""Odometry that moves further than this in one tick (10 m/s) was reset, not driven."""


@dataclass(slots=True)
class Journal:
    """Counts and events of one run. `observe` is called with every tick."""

    start_ns: int
    distance_m: float = 0.0
    cues: Counter[str] = field(default_factory=Counter)
    stops: list[dict[str, Any]] = field(default_factory=list)
    arms: int = 0
    found_presses: int | None = None
    found_ns: int | None = None
    _pose: tuple[float, float] | None = None
    _cue: Cue = Cue.NONE
    _arm: ArmState = ArmState.DISARMED

    def observe(self, inputs: Inputs, decision: Decision, applied: Applied) -> None:
        self._drive(inputs)
        if decision.cue is not self._cue and decision.cue is not Cue.NONE:
            self.cues[decision.cue.value] += 1
        self._cue = decision.cue
        if applied.arm is not self._arm:
            if applied.arm is ArmState.ARMED:
                self.arms += 1
            elif self._arm is ArmState.ARMED and len(self.stops) < MAX_STOPS:
                self.stops.append({"t_s": self._seconds(inputs.stamp_ns), "reason": ", ".join(applied.reasons)})
            self._arm = applied.arm
        if inputs.operator is not None:
            presses = inputs.operator.found_presses
            if self.found_ns is None and self.found_presses is not None and presses > self.found_presses:
                self.found_ns = inputs.stamp_ns
            self.found_presses = presses

    @property
    def seconds_to_found(self) -> float | None:
        return None if self.found_ns is None else self._seconds(self.found_ns)

    def _seconds(self, stamp_ns: int) -> float:
        return round((stamp_ns - self.start_ns) / 1e9, 3)

    def _drive(self, inputs: Inputs) -> None:
        if inputs.base is None:
            return
        here = (inputs.base.pose.x, inputs.base.pose.y)
        if self._pose is not None:
            step = math.dist(here, self._pose)
            if step < JUMP_M:
                self.distance_m += step
        self._pose = here


@dataclass(frozen=True, slots=True)
class RunReport:
    """The summary of one run; field names are the contract of `--json`."""

    found: bool
    seconds_to_found: float | None
    seconds: float
    distance_m: float
    ticks: int
    ticks_skipped: int
    tick_lateness_ms: dict[str, float]
    cues: dict[str, int]
    stops: list[dict[str, Any]]
    theta: dict[str, Any]
    rmp110: dict[str, Any]
    tim571: dict[str, Any]
    detections: dict[str, Any]
    logbook: dict[str, Any]
    recording: str | None
    recording_bytes: int
    simulation: dict[str, Any] | None = None

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def device_report(stats: LinkStats) -> dict[str, Any]:
    """The three counts every device has, its rate, and its last trouble."""
    return {
        "received": stats.received,
        "lost": stats.lost,
        "damaged": stats.damaged,
        "rate_hz": round(stats.rate_hz, 2),
        "reconnects": stats.reconnects,
        "link": stats.link,
    }
