"""What becomes of a question: the operator who is asked "is it this?", sees it and does not say so, means no. Pure.

A no holds for the thing that was asked about, seen from about there: from elsewhere it may be asked about again, after
each further no from further away, and after a while wherever from, as a human may have overlooked it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ghal360_robot.angles import wrap

if TYPE_CHECKING:
    from ghal360_robot.messages import OperatorInput

NS = 1_000_000_000
NO_AFTER_S = 4.0
"""The paper's human acts once in 2 s: who sees the thing marked and says nothing for two of these acts means no."""
AGAIN_M = 1.5
"""A thing that was not the target is looked at anew from so far away: half a room, another side of a chair."""
AGAIN_S = 120.0
"""A no is forgotten: humans overlook things, and somebody may bring the target to where it was not."""
SAME_RAD = math.radians(15)
"""Directions closer than this are of the same thing, as in tracking."""
SAME_M = 1.0
"""Places closer than this are of the same thing: ranges are of what stands below or behind it."""
STEP_M = 0.5
"""An operator who drives up to what they were asked about is still looking."""
GAP_S = 1.0
"""A question that flickers is one question: two or three pictures."""
SILENT_S = 0.5
"""Head poses come at 20 Hz; without any for so long nobody is known to look."""
MOST_NOS = 32
"""The oldest are forgotten."""

Spot = tuple[float, float]
"""A place in the odometry frame, m."""


@dataclass(frozen=True, slots=True)
class QuestionSettings:
    """When silence is a no, and for how long it holds; `no_after_s` 0 takes nothing for one."""

    no_after_s: float = NO_AFTER_S
    again_m: float = AGAIN_M
    again_s: float = AGAIN_S


@dataclass(frozen=True, slots=True)
class Asked:
    """A question that is being shown: about what, from where, and for how long already."""

    yaw: float
    """Direction of the thing in the odometry frame."""
    camera: Spot
    place: Spot | None
    """Where the thing stands, where that is known."""
    presses: int
    """Of "found", when it began."""
    shown_ns: int
    last_ns: int


@dataclass(frozen=True, slots=True)
class No:
    """A thing that an operator was asked about and did not confirm."""

    yaw: float
    camera: Spot
    place: Spot | None
    stamp_ns: int
    times: int = 1

    def holds(self, settings: QuestionSettings, yaw: float, camera: Spot, place: Spot | None) -> bool:
        """Whether a thing in that direction from the camera, at that place if it is known, is this one."""
        moved = math.dist(camera, self.camera)
        if moved > settings.again_m * 2 ** (self.times - 1):
            return False
        if self.place is not None and place is not None and math.dist(self.place, place) <= SAME_M:
            return True
        expected = self.yaw if self.place is None else math.atan2(self.place[1] - camera[1], self.place[0] - camera[0])
        return abs(wrap(expected - yaw)) <= SAME_RAD


@dataclass(frozen=True, slots=True)
class Questions:
    """The question being shown, and the noes that still hold, oldest first."""

    asked: Asked | None = None
    noes: tuple[No, ...] = ()


@dataclass(frozen=True, slots=True)
class Question:
    """What is asked about in this tick."""

    yaw: float
    camera: Spot
    place: Spot | None = None

    def same_as(self, asked: Asked) -> bool:
        return abs(wrap(self.yaw - asked.yaw)) <= SAME_RAD and math.dist(self.camera, asked.camera) <= STEP_M


def step_questions(
    settings: QuestionSettings,
    state: Questions,
    question: Question | None,
    operator: OperatorInput | None,
    base_yaw: float,
    now_ns: int,
) -> tuple[Questions, bool]:
    """The questions after one tick that shows `question`, and whether this tick's silence became a no.

    Only time counts in which the operator's head is known and the thing is in their view; `base_yaw` is the base's when
    the head was, odometry frame.
    """
    noes = tuple(no for no in state.noes if now_ns - no.stamp_ns <= settings.again_s * NS)
    asked = state.asked
    if question is None or settings.no_after_s <= 0:
        gone = asked is None or now_ns - asked.last_ns > GAP_S * NS
        return (state if not gone and noes == state.noes else Questions(None if gone else asked, noes)), False
    if operator is None or now_ns - operator.stamp_ns > SILENT_S * NS:
        return Questions(None, noes), False
    if asked is None or operator.found_presses != asked.presses or not question.same_as(asked):
        presses = operator.found_presses
        asked = Asked(question.yaw, question.camera, question.place, presses, 0, now_ns)
    in_view = abs(wrap(operator.head.yaw + base_yaw - question.yaw)) <= operator.head.fov / 2
    since_ns = min(now_ns - asked.last_ns, round(SILENT_S * NS)) if in_view else 0
    asked = replace(asked, shown_ns=asked.shown_ns + since_ns, last_ns=now_ns)
    if asked.shown_ns < settings.no_after_s * NS:
        return Questions(asked, noes), False
    return Questions(None, _with(settings, noes, asked, now_ns)), True


def _with(settings: QuestionSettings, noes: tuple[No, ...], asked: Asked, now_ns: int) -> tuple[No, ...]:
    """With one more no; those about the same thing become one."""
    wide = replace(settings, again_m=math.inf)
    same = [no for no in noes if no.holds(wide, asked.yaw, asked.camera, asked.place)]
    times = 1 + max((no.times for no in same), default=0)
    new = No(asked.yaw, asked.camera, asked.place, now_ns, times)
    return (*(no for no in noes if no not in same), new)[-MOST_NOS:]


def said_no(
    settings: QuestionSettings, noes: tuple[No, ...], yaw: float, camera: Spot, place: Spot | None = None
) -> bool:
    """Whether the operator said no to a thing in that direction, and it is not yet to be asked about again."""
    return any(no.holds(settings, yaw, camera, place) for no in noes)
