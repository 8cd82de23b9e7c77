"""The pure step of the robot's mind: scene, cue, intention, and the velocity wanted, from one tick's inputs.

No clock, no input or output, no randomness of its own: the same inputs give the same decisions, live,
simulated or replayed. World directions are those of the odometry frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ghal360_robot.angles import wrap
from ghal360_robot.guidance.belief import DetectorModel, TargetBelief, in_focus, likely_wedge, look, refused
from ghal360_robot.guidance.cueing import CueSettings, CueState, step_cue
from ghal360_robot.guidance.egocentric import CLUTTER, EMPTY, N_WEDGES, TARGET
from ghal360_robot.guidance.online import Learnt, OnlineLearner, OnlineState
from ghal360_robot.guidance.policy import NOTHING, Policy, make_policy
from ghal360_robot.guidance.questions import Question, Questions, QuestionSettings, said_no, step_questions
from ghal360_robot.intent.controller import DriveSettings, DriveState, step_drive
from ghal360_robot.intent.exact import ExactFilter, IntentState
from ghal360_robot.intent.head_motion import HeadSettings, HeadState, step_head
from ghal360_robot.intent.particle import ParticleFilter
from ghal360_robot.messages import STILL, Cue, Decision, Twist
from ghal360_robot.perception.tracking import Standpoint, TrackSettings, camera_at
from ghal360_robot.perception.wedges import (
    Refused,
    Scene,
    SceneState,
    nothing_refused,
    reports,
    scene,
    step_scene,
)
from ghal360_robot.trail import Trail

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ghal360_robot.messages import Inputs

TURNS = (Cue.LEFT, Cue.RIGHT)
"""Cues that driving waits for. A confirm asks for no turn: for a closer look the operator may drive up to it."""

NO_SCENE = Scene(allocentric=(EMPTY,) * N_WEDGES, target_yaw=None, target_score=0.0)
PATIENCE_S = 4.0
"""The paper's human answers a cue within one epoch of 2 s; who looks elsewhere for two means it."""

MAX_SILENCE_S = 1.5
"""An operator who was silent for longer may have looked anywhere: the belief starts afresh."""


@dataclass(frozen=True, slots=True)
class BrainState:
    """Everything the brain remembers from tick to tick."""

    trail: Trail = Trail()
    scene: SceneState = SceneState()
    head: HeadState = HeadState()
    intent: IntentState = IntentState()
    cue: CueState = CueState()
    drive: DriveState = DriveState()
    ignoring: tuple[int, int] | None = None
    """The intention that has been held since an instant (ns) while a left or right cue was shown."""
    target: TargetBelief = TargetBelief()
    questions: Questions = Questions()
    """What the operator is being asked about, and what they were asked about and did not confirm."""
    online: OnlineState | None = None
    """What is being learned from this operator; None before the first tick, and without a learner."""
    odometry_since_ns: int | None = None
    """When the base's odometry began anew, if it did: pictures from before are of directions unknown."""


@dataclass(frozen=True, slots=True)
class Brain:
    """The parts of the mind with their settings; `step` is pure."""

    target: str = ""
    """Class name of the object searched for; empty: no search, no cues."""
    policy: Policy = field(default_factory=make_policy)
    scene: TrackSettings = TrackSettings()
    cueing: CueSettings = CueSettings()
    head: HeadSettings = HeadSettings()
    intent: ExactFilter | ParticleFilter = ExactFilter()
    drive: DriveSettings = DriveSettings()
    drive_while_guiding: bool = False
    fusion: DetectorModel | None = None
    """With it, the operator is asked to confirm only what the fused detections make nearly sure."""
    questions: QuestionSettings = QuestionSettings()
    act_on_belief: bool = True
    """Arrows follow what they are worth over all wedges that the target may be in, not in the likeliest alone."""
    learner: OnlineLearner | None = None
    """With it, guidance is learned from the operator, epoch by epoch, beginning with what is known."""
    known: Learnt | None = None
    cue_patience_s: float = PATIENCE_S
    """A gaze held for so long against a left or right cue overrules it, or robot and operator wait for each other."""

    def step(self, state: BrainState, inputs: Inputs) -> tuple[BrainState, Decision]:
        """One tick."""
        state, inputs = _follow_base(state, inputs)
        state, seen = self._look(state, inputs)
        gaze = _gaze(state.trail, inputs)
        state = self._follow_head(state, inputs, gaze)
        policy, online = self._policy(state)
        wedges, belief = self._believed(state.target, seen, inputs.stamp_ns)
        cue = step_cue(policy, self.cueing, state.cue, wedges, gaze, inputs.stamp_ns, belief)
        state = replace(state, cue=cue)
        cue = self._unless_unsure(state, cue, seen, inputs.stamp_ns)
        state = self._hear(state, cue, seen, inputs)
        state = self._learn(replace(state, online=online), cue, inputs)
        state = replace(state, ignoring=self._ignoring(state, cue.cue, inputs.stamp_ns))
        state, wanted, reasons = self._want(state, inputs, gaze, cue.cue)
        return state, Decision(
            cue=cue.cue,
            target_yaw=seen.target_yaw,
            wedges=cue.wedges,
            q=cue.q,
            belief=state.intent.belief,
            intention=self.intent.intention(state.intent),
            wanted=wanted,
            reasons=reasons,
            target_chances=state.target.chances or (),
        )

    def _look(self, state: BrainState, inputs: Inputs) -> tuple[BrainState, Scene]:
        """What is around, remembered in the world's directions."""
        found = inputs.detections
        around = inputs.surroundings
        standpoint = Standpoint(
            pose=state.trail.at(inputs.stamp_ns if found is None else found.stamp_ns),
            surroundings=around,
            scan_pose=None if around is None else state.trail.at(around.stamp_ns),
        )
        remembered = step_scene(self.scene, state.scene, found, standpoint, inputs.stamp_ns)
        state = replace(state, scene=remembered)
        if self.fusion is not None and found is not None and self.target:
            state = replace(state, target=self._fused(self.fusion, state, standpoint))
        if not self.target:
            return state, NO_SCENE
        return state, scene(self.scene, remembered, self.target, state.trail.at(inputs.stamp_ns), self._refused(state))

    def _fused(self, fusion: DetectorModel, state: BrainState, standpoint: Standpoint) -> TargetBelief:
        """Where the target is believed to be after the newest picture; one that was taken in already adds nothing."""
        target, pose, stamp_ns = state.target, standpoint.pose, state.scene.stamp_ns
        if stamp_ns is None or (target.look_ns is not None and stamp_ns <= target.look_ns):
            return target
        seen = reports(self.scene, state.scene, self.target, pose, self._refused(state))
        return look(fusion, target, seen, (pose.x, pose.y), stamp_ns)

    def _refused(self, state: BrainState) -> Refused:
        noes = state.questions.noes
        return partial(said_no, self.questions, noes) if noes else nothing_refused

    def _believed(
        self, target: TargetBelief, seen: Scene, now_ns: int
    ) -> tuple[tuple[int, ...], NDArray[np.float64] | None]:
        """The world's wedge values with the target where it is most likely, and how likely it is where.

        While the pictures speak against every wedge, what is still tracked counts if it was seen well: seldom since, or
        hidden just now. What was never seen well is not pointed at either: an operator who was turned to it and then
        not asked about it would be turned to it again and again.
        """
        if self.fusion is None or target.chances is None:
            return seen.allocentric, None
        clutter = tuple(value & CLUTTER for value in seen.allocentric)
        known = seen.allocentric if self._well_seen(self.fusion, seen, now_ns) else clutter
        if not self.act_on_belief:
            return known, None
        chances = np.array(target.chances)
        likely = likely_wedge(chances)
        if likely is None:
            return known, None
        values = list(clutter)
        values[likely] |= TARGET
        return tuple(values), chances

    def _well_seen(self, fusion: DetectorModel, seen: Scene, now_ns: int) -> bool:
        """Whether the thing tracked as the target was seen well enough to be asked about, not too long ago."""
        return seen.well_seen_ns is not None and now_ns - seen.well_seen_ns <= fusion.fade_s * 1e9

    def _follow_head(self, state: BrainState, inputs: Inputs, gaze: float) -> BrainState:
        """Head motion to belief; only an armed robot has anything to infer an intention for."""
        operator = inputs.operator
        if operator is None:
            return state
        before = state.head.stamp_ns
        head = step_head(self.head, state.head, gaze, operator.stamp_ns)
        if not inputs.armed:
            return replace(state, head=head, intent=IntentState())
        silence_s = (inputs.stamp_ns - operator.stamp_ns) / 1e9
        if silence_s > MAX_SILENCE_S:
            return replace(state, head=head, intent=IntentState())
        if head.stamp_ns == before or before is None or head.stamp_ns is None:
            return replace(state, head=head)
        dt_s = min((head.stamp_ns - before) / 1e9, MAX_SILENCE_S)
        return replace(state, head=head, intent=self.intent.step(state.intent, head.evidence, dt_s))

    def _policy(self, state: BrainState) -> tuple[Policy, OnlineState | None]:
        """The policy of this tick: as configured, or as learned so far."""
        if self.learner is None:
            return self.policy, None
        online = state.online or self.learner.begin(self.known)
        return self.learner.policy(online), online

    def _unless_unsure(self, state: BrainState, cue: CueState, seen: Scene, now_ns: int) -> CueState:
        """The cue, but nothing in place of a question that the detections do not bear out yet."""
        if self.fusion is None or cue.cue is not Cue.CONFIRM or cue.head_wedge is None:
            return cue
        bearing = None if seen.target_yaw is None else -wrap(seen.target_yaw + state.trail.at(now_ns).yaw)
        sure = in_focus(state.target, cue.head_wedge, bearing) >= self.fusion.sure
        # The belief is of a wedge: what is asked about has to be the thing in it that was seen well.
        sure = sure and self._well_seen(self.fusion, seen, now_ns)
        return cue if sure else replace(cue, advice=NOTHING)

    def _hear(self, state: BrainState, cue: CueState, seen: Scene, inputs: Inputs) -> BrainState:
        """The operator's silence, where they are asked about what they have in view."""
        question, operator = None, inputs.operator
        if cue.cue is Cue.CONFIRM and seen.target_yaw is not None:
            pose = state.trail.at(inputs.stamp_ns)
            camera = camera_at(pose, self.scene.camera)
            question = Question(wrap(seen.target_yaw + pose.yaw), camera, seen.target_place)
        base_yaw = 0.0 if operator is None else state.trail.at(operator.stamp_ns).yaw
        before = state.questions
        questions, no = step_questions(self.questions, before, question, operator, base_yaw, inputs.stamp_ns)
        if questions is not before:
            state = replace(state, questions=questions)
        if no and question is not None and self.fusion is not None:
            state = replace(state, target=refused(self.fusion, state.target, -question.yaw))
        return state

    def _learn(self, state: BrainState, cue: CueState, inputs: Inputs) -> BrainState:
        if self.learner is None or state.online is None:
            return state
        presses = None if inputs.operator is None else inputs.operator.found_presses
        return replace(state, online=self.learner.step(state.online, cue, presses, inputs.stamp_ns))

    def _ignoring(self, state: BrainState, cue: Cue, now_ns: int) -> tuple[int, int] | None:
        intention = self.intent.intention(state.intent)
        if cue not in TURNS or intention is None:
            return None
        if state.ignoring is not None and state.ignoring[0] == intention:
            return state.ignoring
        return intention, now_ns

    def _held_by_cue(self, state: BrainState, cue: Cue, now_ns: int) -> bool:
        """Whether driving waits for the operator to follow the cue."""
        if cue not in TURNS or self.drive_while_guiding:
            return False
        return state.ignoring is None or now_ns - state.ignoring[1] < self.cue_patience_s * 1e9

    def _want(
        self, state: BrainState, inputs: Inputs, gaze: float, cue: Cue
    ) -> tuple[BrainState, Twist, tuple[str, ...]]:
        operator = inputs.operator
        if operator is not None and operator.stick is not None:
            return replace(state, drive=DriveState()), STILL, ("stick",)
        if not inputs.armed or inputs.base is None:
            return replace(state, drive=DriveState()), STILL, ("not armed",)
        around = inputs.surroundings
        drive = step_drive(
            self.drive,
            state.drive,
            intention=self.intent.intention(state.intent),
            gaze=gaze,
            pose=state.trail.at(inputs.stamp_ns),
            measured=inputs.base.twist,
            cue_shown=self._held_by_cue(state, cue, inputs.stamp_ns),
            points=None if around is None else around.points,
        )
        return replace(state, drive=drive), drive.twist, drive.reasons


def _follow_base(state: BrainState, inputs: Inputs) -> tuple[BrainState, Inputs]:
    """The base's newest pose; where its odometry began anew, whatever is known by its directions is forgotten."""
    base, found = inputs.base, inputs.detections
    if base is not None and state.trail.began_anew(base):
        fresh = BrainState(cue=state.cue, online=state.online, odometry_since_ns=base.stamp_ns)
        state = replace(fresh, scene=SceneState(stamp_ns=state.scene.stamp_ns))
    if found is not None and state.odometry_since_ns is not None and found.stamp_ns < state.odometry_since_ns:
        inputs = replace(inputs, detections=None)
    return replace(state, trail=state.trail.extended(base)), inputs


def _gaze(trail: Trail, inputs: Inputs) -> float:
    """Where the operator looks, as a world yaw; straight ahead of the base without an operator."""
    operator = inputs.operator
    if operator is None:
        return trail.at(inputs.stamp_ns).yaw
    return wrap(operator.head.yaw + trail.at(operator.stamp_ns).yaw)
