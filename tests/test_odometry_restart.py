"""The base starts again in the middle of a search: its odometry begins at nought, wherever the robot stands."""

from __future__ import annotations

from dataclasses import replace

from ghal360_robot.assembly import make_brain
from ghal360_robot.brain import BrainState
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.messages import BaseMode, BaseState, Cue, Detection, Detections, Inputs, Pose2, Twist
from tests.safety.conftest import TICK_NS, inputs

FAR = Pose2(3.0, 1.0, 2.5)


def tick(n: int, pose: Pose2, seen_n: int | None) -> Inputs:
    """Tick `n` at a pose, with the picture of tick `seen_n` in which a bottle is ahead."""
    found = None
    if seen_n is not None:
        found = Detections(seen_n * TICK_NS, seen_n, "test", (Detection("bottle", 0.9, 0.0, 0.0, 0.1, 0.1),))
    base = BaseState(n * TICK_NS, BaseMode.DRIVE, pose, Twist(), 90.0)
    return replace(inputs(n), base=base, detections=found)


def test_what_was_known_by_the_old_odometry_s_directions_is_forgotten_with_it() -> None:
    brain = make_brain(with_overrides(RobotConfig(), {"perception": {"target": "bottle"}}))
    state = BrainState()
    for n in range(100):
        state, decision = brain.step(state, tick(n, FAR, n))
    assert decision.target_yaw is not None
    state, decision = brain.step(state, tick(100, Pose2(), 99))
    assert decision.target_yaw is None
    assert decision.cue is Cue.NONE
    assert not state.scene.objects
    assert state.target.chances is None
    for n in range(101, 140):
        state, decision = brain.step(state, tick(n, Pose2(), n))
    assert decision.target_yaw is not None
    assert abs(decision.target_yaw) < 0.01
