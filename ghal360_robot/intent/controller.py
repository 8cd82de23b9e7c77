"""Drive where you look: from the operator's intention and gaze to the velocity that they want."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ghal360_robot.angles import wrap
from ghal360_robot.guidance.egocentric import WEDGE_WIDTH, wedge_centre
from ghal360_robot.intent.steering import SteeringSettings, choose_heading
from ghal360_robot.messages import STILL, Pose2, Twist

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

CUE_SHOWN = "cue shown"
"""A robot that drives off while its operator follows an arrow makes the search three times as long."""
NO_INTENTION = "no intention"
BLOCKED = "way blocked"
EVADING = "evading"
TURNING = "turning"
DRIVING = "driving"

EVADED = math.radians(5)
"""Being led off the wanted heading by less is not worth a word."""


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """How headings become velocities."""

    v_max: float = 0.5
    w_max: float = 0.8
    gain: float = 1.6
    """rad/s of turn per rad of heading error; the limit is reached at 0.5 rad."""
    lead_s: float = 0.25
    """The base goes on turning for about this long; the error is judged where it will be by then."""
    drive_within: float = math.radians(30)
    """Beyond this heading error the robot turns on the spot."""
    steering: SteeringSettings = SteeringSettings()

    def __post_init__(self) -> None:
        if min(self.v_max, self.w_max, self.gain, self.drive_within) <= 0 or self.lead_s < 0:
            raise ValueError("Speeds, gain and the heading error to drive within must be positive.")


@dataclass(frozen=True, slots=True)
class DriveState:
    """The velocity wanted now and why; `course` is the yaw (odometry frame) that the robot makes for."""

    twist: Twist = STILL
    reasons: tuple[str, ...] = ()
    course: float | None = None


def wanted_yaw(intention: int, gaze: float) -> float:
    """The yaw (rad, CCW) to make for: the gaze while it lies in the intended wedge, else its centre.

    `intention` is a world wedge, clockwise from x of the frame in which `gaze` is measured.
    """
    centre = -wedge_centre(intention)
    inside = abs(wrap(gaze - centre)) <= WEDGE_WIDTH / 2
    return wrap(gaze if inside else centre)


def drive_towards(settings: DriveSettings, heading: float, measured: Twist) -> Twist:
    """The velocity that brings the base onto a heading (rad, CCW, base frame) and along it.

    Forward only as far as the heading is right: full speed straight on, none from `drive_within` off.
    """
    ahead = wrap(heading) - settings.lead_s * measured.w
    w = max(-settings.w_max, min(settings.w_max, settings.gain * ahead))
    off = min(abs(wrap(heading)) / settings.drive_within, 1.0)
    return Twist(settings.v_max * math.cos(off * math.pi / 2) ** 2 if off < 1.0 else 0.0, w)


def step_drive(
    settings: DriveSettings,
    state: DriveState,
    *,
    intention: int | None,
    gaze: float,
    pose: Pose2,
    measured: Twist,
    cue_shown: bool,
    points: NDArray[np.floating] | None,
) -> DriveState:
    """One decision. `gaze` is the head's yaw in the odometry frame, `points` (N, 2) the scan in the base's.

    The robot holds while a cue is shown, without an intention and where every way is blocked. Without
    points there is no steering: the wanted heading is taken as it is, and the safety chain must judge.
    """
    if cue_shown:
        return DriveState(reasons=(CUE_SHOWN,))
    if intention is None or not math.isfinite(gaze - pose.yaw):
        return DriveState(reasons=(NO_INTENTION,))
    wanted = wrap(wanted_yaw(intention, gaze) - pose.yaw)
    heading: float | None = wanted
    if points is not None:
        previous = None if state.course is None else wrap(state.course - pose.yaw)
        heading = choose_heading(settings.steering, wanted, points, previous)
    if heading is None:
        return DriveState(reasons=(BLOCKED,))
    twist = drive_towards(settings, heading, measured)
    motion = DRIVING if twist.v > 0 else TURNING
    evading = abs(wrap(heading - wanted)) > EVADED
    return DriveState(twist, (motion, EVADING) if evading else (motion,), wrap(heading + pose.yaw))
