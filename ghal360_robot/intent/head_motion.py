"""From a stream of head yaws to evidence: which way the head turns and which wedge it focuses on.

Yaws are radians counter-clockwise in a frame that stays put while the robot turns (odometry, not base).
World wedges are clockwise from that frame's x axis, as everywhere in guidance: `wedge_of(-yaw)`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ghal360_robot.angles import wrap
from ghal360_robot.guidance.egocentric import sticky_wedge

LEFT, STILL, RIGHT = -1, 0, 1


@dataclass(frozen=True, slots=True)
class HeadSettings:
    """How a yaw stream is read; any rate from 2 Hz up gives the same evidence per second."""

    half_life_s: float = 0.1
    """Low pass: half of a step is followed in this time."""
    dead_band: float = math.radians(15)
    """rad/s. A head at rest drifts by less; a look around is four times as fast."""
    border_margin: float = math.radians(3)
    """How far beyond its border the focused wedge is kept."""
    gap_s: float = 1.5
    """Over a longer silence nobody can say how the head moved: start afresh."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the head did between two samples: turned LEFT, RIGHT or kept STILL, from wedge to wedge."""

    delta: int
    focus: int
    origin: int
    """The wedge that was in focus before."""


@dataclass(frozen=True, slots=True)
class HeadState:
    """The filtered head; `evidence` is None until two samples in a row have come."""

    stamp_ns: int | None = None
    yaw: float = 0.0
    """Low-passed, radians, in [-pi, pi)."""
    focus: int | None = None
    evidence: Evidence | None = None


def step_head(settings: HeadSettings, state: HeadState, yaw: float, stamp_ns: int) -> HeadState:
    """Take in one sample. One that is not finite or not newer than the last changes nothing."""
    if not math.isfinite(yaw) or (state.stamp_ns is not None and stamp_ns <= state.stamp_ns):
        return state
    focus = sticky_wedge(-yaw, state.focus, settings.border_margin)
    if state.stamp_ns is None or state.focus is None or stamp_ns - state.stamp_ns > settings.gap_s * 1e9:
        return HeadState(stamp_ns=stamp_ns, yaw=wrap(yaw), focus=focus)
    dt_s = (stamp_ns - state.stamp_ns) / 1e9
    followed = (1.0 - 0.5 ** (dt_s / settings.half_life_s)) * wrap(yaw - state.yaw)
    rate = followed / dt_s
    delta = STILL if abs(rate) < settings.dead_band else LEFT if rate > 0 else RIGHT
    return replace(
        state,
        stamp_ns=stamp_ns,
        yaw=wrap(state.yaw + followed),
        focus=focus,
        evidence=Evidence(delta=delta, focus=focus, origin=state.focus),
    )
