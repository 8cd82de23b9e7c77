"""A seeded virtual human who searches by looking: one pure step from what they see to what they do.

As in the paper: the human looks around, follows a left or right cue with probability 0.95 and else does
anything, keeps looking where they want to go, and says "found" when asked to confirm what they see.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING

from ghal360_robot.angles import wrap
from ghal360_robot.guidance.cueing import uniform
from ghal360_robot.guidance.egocentric import WEDGE_WIDTH
from ghal360_robot.messages import Cue, HeadPose, OperatorInput, Pose2
from ghal360_robot.simulation.recollection import Recollection, forget_tries, give_up, remember
from ghal360_robot.simulation.wayfinding import next_way

if TYPE_CHECKING:
    from ghal360_robot.simulation.eyes import Sight
    from ghal360_robot.simulation.wayfinding import Way

NS = 1_000_000_000
RATE_HZ = 20.0
"""How often the operator's page reports the head."""


@dataclass(frozen=True, slots=True)
class Temper:
    """How this human behaves."""

    seed: int = 0
    fov: float = math.radians(90)
    follow: float = 0.95
    """Chance to do what a cue says (paper, section IV)."""
    rhythm_s: float = 2.0
    """One decision on a cue in this time (paper)."""
    reaction_s: float = 0.3
    turn_rate: float = math.radians(60)
    """rad/s of a saccade with a headset or a dragged picture."""
    jitter: float = math.radians(1.5)
    """A held gaze wanders this far."""
    recognise_s: float = 0.5
    """The target must have been in view for this long to be confirmed."""
    arm_after_s: float = 1.0
    """How long the robot must have been ready before a human trusts it again."""
    patience_s: float = 5.0
    """A robot that stands still for so long while it should go is in front of something."""


class Doing(Enum):
    """What the operator is at."""

    LOOKING = "looking around"
    GOING = "going"
    FOLLOWING = "following a cue"
    CONFIRMING = "confirming"


@dataclass(frozen=True, slots=True)
class Buttons:
    """Presses so far, and when the reasons for the next one began."""

    arm: int = 0
    found: int = 0
    ready_since_ns: int | None = None
    confirm_since_ns: int | None = None


@dataclass(frozen=True, slots=True)
class OperatorState:
    """Everything the operator has in mind. Yaws are in the world, radians counter-clockwise."""

    temper: Temper
    memory: Recollection
    gaze: float
    aim: float
    """Where the gaze turns to."""
    now_ns: int
    doing: Doing = Doing.LOOKING
    glances: tuple[float, ...] = ()
    """Directions still to look at before going on."""
    looked_around: bool = False
    look_until_ns: int = 0
    decide_ns: int = 0
    """When the next decision on a cue, or on the way, is due."""
    remembered_ns: int = 0
    way: Way | None = None
    elsewhere_until_ns: int = 0
    """Until then the operator goes on although the target is in view: straight ahead was no way to it."""
    still_since_ns: int = 0
    still_pose: Pose2 = field(default_factory=Pose2)
    wander: float = 0.0
    buttons: Buttons = Buttons()
    draws: int = 0


FIRST_GLANCES = 4
"""Saccades of 60 degrees on average: most of a turn."""
REMEMBER_S = 0.2
"""At 0.5 m/s a new picture every cell of the memory."""
PLAN_S = 1.0
"""A human thinks about the way about once a second."""
CUE_LOST_S = 1.0
"""A cue that vanishes may come back: wait this long before going on."""
AGAIN_S = 3.0
"""If a press of "arm" or "found" had no effect by then, press again."""
PASSED_M = 0.3
"""The direction of a point closer than this swings too fast to look at."""
HERE_M = 0.35
"""Who is this close to a goal and sees nothing new gives it up."""
STILL_M = 0.15
STILL_YAW = 0.2
"""Less motion than this, in metres and radians, is standing still."""
GIVE_UP_M = 0.6
"""Around a place that cannot be reached: about the robot's own width."""
ELSEWHERE_S = 15.0
"""Time enough to find a way around a desk."""
WANDER_S = 0.5
"""Time constant of the gaze's wandering."""
LONGEST_STEP_S = 0.25
"""After a longer silence of the caller the gaze does not jump."""


def start(temper: Temper, pose: Pose2, now_ns: int) -> OperatorState:
    """An operator who just sat down in front of the picture of a robot at `pose`, looking straight ahead."""
    return OperatorState(
        temper=temper,
        memory=Recollection.empty(pose),
        gaze=pose.yaw,
        aim=pose.yaw,
        now_ns=now_ns,
        still_since_ns=now_ns,
        still_pose=pose,
    )


def step(state: OperatorState, sight: Sight, now_ns: int) -> tuple[OperatorState, OperatorInput]:
    """What the operator does next, and the message that their page sends. Call at about RATE_HZ."""
    dt_s = min(max(now_ns - state.now_ns, 0) / NS, LONGEST_STEP_S)
    state = replace(state, now_ns=now_ns)
    if now_ns - state.remembered_ns >= REMEMBER_S * NS:
        state = replace(state, memory=remember(state.memory, sight.view), remembered_ns=now_ns)
    state = _watch_motion(state, sight)
    state = _press(state, sight)
    state = _decide(state, sight)
    state = _turn(state, dt_s)
    pose = sight.view.pose
    # A robot that knows the target from further away than a human does: drive up to what it points at.
    approaching = state.doing is Doing.CONFIRMING and sight.view.target_yaw is None
    message = OperatorInput(
        stamp_ns=now_ns,
        head=HeadPose(wrap(state.gaze + state.wander - pose.yaw), 0.0, state.temper.fov),
        deadman=sight.armed and (state.doing is Doing.GOING or approaching),
        arm_presses=state.buttons.arm,
        found_presses=state.buttons.found,
    )
    return state, message


def _decide(state: OperatorState, sight: Sight) -> OperatorState:
    if sight.cue in {Cue.LEFT, Cue.RIGHT}:
        return _follow(state, sight.cue)
    if sight.cue is Cue.CONFIRM:
        aim = state.aim if sight.view.target_yaw is None else sight.view.target_yaw
        return replace(state, doing=Doing.CONFIRMING, aim=aim)
    if state.doing in {Doing.FOLLOWING, Doing.CONFIRMING}:
        wait_ns = state.now_ns + round(CUE_LOST_S * NS)
        return replace(state, doing=Doing.LOOKING, glances=(), look_until_ns=wait_ns, way=None)
    seen = sight.view.target_yaw is not None and state.now_ns >= state.elsewhere_until_ns
    if seen and sight.armed and not _blocked(state):
        return replace(state, doing=Doing.GOING, aim=sight.view.target_yaw or 0.0, way=None)
    if state.doing is Doing.LOOKING:
        return _look_around(state, sight)
    return _go(state, sight)


def _follow(state: OperatorState, cue: Cue) -> OperatorState:
    """One wedge as indicated with probability `follow`, else anything; once per rhythm."""
    if state.doing is not Doing.FOLLOWING:
        react_ns = state.now_ns + round(state.temper.reaction_s * NS)
        return replace(state, doing=Doing.FOLLOWING, aim=state.gaze, decide_ns=react_ns)
    if state.now_ns < state.decide_ns:
        return state
    turn = WEDGE_WIDTH if cue is Cue.LEFT else -WEDGE_WIDTH
    state, obeys = _draw(state)
    if obeys >= state.temper.follow:
        state, anything = _draw(state)
        turn = (-WEDGE_WIDTH, 0.0, WEDGE_WIDTH)[int(3 * anything)]
    due_ns = state.now_ns + round(state.temper.rhythm_s * NS)
    return replace(state, aim=state.gaze + turn, decide_ns=due_ns)


def _look_around(state: OperatorState, sight: Sight) -> OperatorState:
    """Saccades with fixations between them, until all that was worth a look has been seen."""
    if abs(wrap(state.aim - state.gaze)) > 1e-3:
        return state
    if state.now_ns < state.look_until_ns:
        return state
    if state.glances:
        state, pause = _draw(state)
        fixation_s = min(0.2 - 0.4 * math.log(1.0 - pause), 1.0)
        turn_s = abs(wrap(state.glances[0] - state.gaze)) / state.temper.turn_rate
        until_ns = state.now_ns + round((turn_s + fixation_s) * NS)
        return replace(state, aim=state.glances[0], glances=state.glances[1:], look_until_ns=until_ns)
    if not state.looked_around:
        return _glance_around(replace(state, looked_around=True), FIRST_GLANCES)
    if not sight.armed:
        return _glance_around(state, 1)
    return _think(replace(state, doing=Doing.GOING), sight)


def _glance_around(state: OperatorState, count: int) -> OperatorState:
    """`count` saccades of 30 to 90 degrees, the same way round; which way is chance."""
    state, side = _draw(state)
    yaw, glances = state.gaze, []
    for _ in range(count):
        state, size = _draw(state)
        yaw += math.copysign(math.radians(30 + 60 * size), side - 0.5)
        glances.append(yaw)
    return replace(state, glances=tuple(glances), doing=Doing.LOOKING)


def _go(state: OperatorState, sight: Sight) -> OperatorState:
    if not sight.armed:
        return replace(state, doing=Doing.LOOKING, glances=(), way=None)
    pose = sight.view.pose
    if _blocked(state):
        place = state.way.goal if state.way else (pose.x + math.cos(state.gaze), pose.y + math.sin(state.gaze))
        memory = give_up(state.memory, *place, GIVE_UP_M)
        until_ns = state.now_ns + round(ELSEWHERE_S * NS)
        state = replace(state, memory=memory, way=None, still_since_ns=state.now_ns, elsewhere_until_ns=until_ns)
        return _glance_around(state, 1)
    way = state.way
    if way is None or state.now_ns >= state.decide_ns:
        return _think(state, sight)
    return _keep_looking(state, way, sight)


def _blocked(state: OperatorState) -> bool:
    return state.now_ns - state.still_since_ns > state.temper.patience_s * NS


def _think(state: OperatorState, sight: Sight) -> OperatorState:
    """Choose where to go, or start over when there is nowhere left."""
    pose = sight.view.pose
    way = next_way(state.memory, pose, state.way.goal if state.way else None)
    due_ns = state.now_ns + round(PLAN_S * NS)
    if way is None:
        state = replace(state, memory=forget_tries(state.memory), way=None, decide_ns=due_ns)
        return _glance_around(state, FIRST_GLANCES)
    if way.length_m < HERE_M:
        memory = give_up(state.memory, *way.goal, GIVE_UP_M)
        return replace(state, memory=memory, decide_ns=state.now_ns, way=None)
    going = replace(state, doing=Doing.GOING, way=way, decide_ns=due_ns)
    return _keep_looking(going, way, sight)


def _keep_looking(state: OperatorState, way: Way, sight: Sight) -> OperatorState:
    """Hold the gaze on the next point of the way."""
    pose = sight.view.pose
    x, y = way.waypoint
    if math.hypot(x - pose.x, y - pose.y) < PASSED_M:
        return state
    return replace(state, aim=math.atan2(y - pose.y, x - pose.x))


def _turn(state: OperatorState, dt_s: float) -> OperatorState:
    """Turn the gaze towards the aim, and let it wander a little (Ornstein-Uhlenbeck)."""
    most = state.temper.turn_rate * dt_s
    turn = max(-most, min(most, wrap(state.aim - state.gaze)))
    state, noise = _draw(state)
    keep = math.exp(-dt_s / WANDER_S)
    spread = state.temper.jitter * math.sqrt(max(0.0, 1.0 - keep * keep))
    # A uniform draw of the same variance: the gaze has no tails.
    wander = keep * state.wander + spread * math.sqrt(12.0) * (noise - 0.5)
    return replace(state, gaze=wrap(state.gaze + turn), wander=wander)


def _watch_motion(state: OperatorState, sight: Sight) -> OperatorState:
    """Notice how long the robot has been standing although it should go."""
    pose, then = sight.view.pose, state.still_pose
    moved = math.hypot(pose.x - then.x, pose.y - then.y) > STILL_M
    turned = abs(wrap(pose.yaw - then.yaw)) > STILL_YAW
    if moved or turned or state.doing is not Doing.GOING or not sight.armed:
        return replace(state, still_pose=pose, still_since_ns=state.now_ns)
    return state


def _press(state: OperatorState, sight: Sight) -> OperatorState:
    """Arm when the robot has been ready for a while; confirm what was asked for and is in view."""
    buttons, now_ns = state.buttons, state.now_ns
    if sight.armed or sight.trouble or not sight.ready:
        buttons = replace(buttons, ready_since_ns=None)
    elif buttons.ready_since_ns is None:
        buttons = replace(buttons, ready_since_ns=now_ns)
    elif now_ns - buttons.ready_since_ns >= state.temper.arm_after_s * NS:
        later_ns = now_ns + round((AGAIN_S - state.temper.arm_after_s) * NS)
        buttons = replace(buttons, arm=buttons.arm + 1, ready_since_ns=later_ns)
    if sight.cue is not Cue.CONFIRM or sight.view.target_yaw is None:
        buttons = replace(buttons, confirm_since_ns=None)
    elif buttons.confirm_since_ns is None:
        buttons = replace(buttons, confirm_since_ns=now_ns)
    elif now_ns - buttons.confirm_since_ns >= state.temper.recognise_s * NS:
        later_ns = now_ns + round((AGAIN_S - state.temper.recognise_s) * NS)
        buttons = replace(buttons, found=buttons.found + 1, confirm_since_ns=later_ns)
    return replace(state, buttons=buttons)


def _draw(state: OperatorState) -> tuple[OperatorState, float]:
    """The next number in [0, 1) of this operator's seed."""
    return replace(state, draws=state.draws + 1), uniform(state.temper.seed, state.draws)
