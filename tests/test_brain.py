from __future__ import annotations

import math
from dataclasses import replace

import pytest

from ghal360_robot.assembly import make_brain
from ghal360_robot.brain import Brain, BrainState
from ghal360_robot.config import RobotConfig, with_overrides
from ghal360_robot.guidance.follow_rates import FollowRates
from ghal360_robot.guidance.online import OnlineLearner
from ghal360_robot.messages import (
    STILL,
    BaseMode,
    BaseState,
    Cue,
    Decision,
    Detection,
    Detections,
    HeadPose,
    Inputs,
    OperatorInput,
    Pose2,
    Twist,
)
from tests.safety.conftest import TICK_NS, inputs


@pytest.fixture(scope="module")
def brain() -> Brain:
    return make_brain(with_overrides(RobotConfig(), {"perception": {"target": "bottle"}}))


def tick(n: int, *, head_yaw: float = 0.0, base_yaw: float = 0.0, target_yaw: float | None = None) -> Inputs:
    """Tick `n` with the head and the target at yaws relative to the base."""
    stamp = n * TICK_NS
    found = None
    if target_yaw is not None:
        found = Detections(stamp, n, "test", (Detection("bottle", 0.9, target_yaw, 0.0, 0.1, 0.1),))
    return replace(
        inputs(n),
        base=BaseState(stamp, BaseMode.DRIVE, Pose2(0.0, 0.0, base_yaw), Twist(), 90.0),
        operator=OperatorInput(stamp, HeadPose(yaw=head_yaw), deadman=True, arm_presses=1),
        detections=found,
        armed=True,
    )


def think(brain: Brain, ticks: list[Inputs]) -> list[Decision]:
    state, out = BrainState(), []
    for inputs_now in ticks:
        state, decision = brain.step(state, inputs_now)
        out.append(decision)
    return out


def test_a_head_held_still_becomes_an_intention_and_the_robot_drives_there(brain: Brain) -> None:
    out = think(brain, [tick(n, head_yaw=0.5) for n in range(250)])
    assert out[0].wanted == STILL
    assert out[-1].intention == 7  # half a radian to the left is wedge 7, north-west
    assert out[-1].wanted.w > 0
    assert sum(out[-1].belief) == pytest.approx(1.0)


def test_an_unarmed_robot_infers_nothing(brain: Brain) -> None:
    out = think(brain, [replace(tick(n), armed=False) for n in range(250)])
    assert out[-1].intention is None
    assert all(d.wanted == STILL for d in out)


@pytest.mark.parametrize(
    ("target_yaw", "cue"), [(math.pi / 2, Cue.LEFT), (-math.pi / 2, Cue.RIGHT), (0.1, Cue.CONFIRM), (None, Cue.NONE)]
)
def test_the_cue_points_the_short_way_to_the_target(brain: Brain, target_yaw: float | None, cue: Cue) -> None:
    out = think(brain, [tick(n, target_yaw=target_yaw) for n in range(120)])
    assert out[-1].cue is cue


def test_the_operator_is_asked_to_confirm_only_what_many_pictures_bear_out(brain: Brain) -> None:
    out = think(brain, [tick(n, target_yaw=0.1) for n in range(120)])
    asked = next(n for n, d in enumerate(out) if d.cue is Cue.CONFIRM)
    assert 20 <= asked <= 100  # one picture is not enough; a second of them is
    assert {d.cue for d in out[:asked]} == {Cue.NONE}
    at_once = replace(brain, fusion=None)
    assert think(at_once, [tick(0, target_yaw=0.1)])[0].cue is Cue.CONFIRM


def test_an_operator_asked_for_four_seconds_who_says_nothing_is_not_asked_again(brain: Brain) -> None:
    ticks = [tick(n, target_yaw=0.1) for n in range(1500)]
    out = think(brain, ticks)
    asked = [n for n, d in enumerate(out) if d.cue is Cue.CONFIRM]
    assert len(asked) * TICK_NS == pytest.approx(4e9, rel=0.02)
    assert asked == list(range(asked[0], asked[-1] + 1))
    assert {d.cue for d in out[asked[-1] + 1 :]} == {Cue.NONE}
    assert out[-1].target_yaw is None
    assert out[-1].target_chances[0] < 0.1


def test_after_a_no_another_thing_of_the_kind_is_pointed_at_and_asked_about(brain: Brain) -> None:
    ticks = [tick(n, target_yaw=0.1) for n in range(400)]
    for n in range(400, 800):
        found = tuple(Detection("bottle", 0.9, yaw, 0.0, 0.1, 0.1) for yaw in (0.1, 1.6))
        detections = Detections(n * TICK_NS, n, "test", found)
        ticks.append(replace(tick(n, head_yaw=0.0 if n < 600 else 1.6), detections=detections))
    out = think(brain, ticks)
    assert Cue.LEFT in {d.cue for d in out[400:600]}
    assert out[-1].cue is Cue.CONFIRM
    assert out[-1].target_yaw == pytest.approx(1.6)


def test_weak_sightings_are_neither_pointed_at_nor_asked_about(brain: Brain) -> None:
    """A bottle is reported from 0.2 on, and asked about from 0.3 on."""
    out: dict[tuple[float, float], set[Cue]] = {}
    for score, yaw in ((0.25, 0.1), (0.25, 1.6), (0.35, 0.1), (0.35, 1.6)):
        found = Detection("bottle", score, yaw, 0.0, 0.1, 0.1)
        ticks = [replace(tick(n), detections=Detections(n * TICK_NS, n, "test", (found,))) for n in range(300)]
        out[score, yaw] = {decision.cue for decision in think(brain, ticks)}
    assert out[0.25, 0.1] == out[0.25, 1.6] == {Cue.NONE}
    assert Cue.CONFIRM in out[0.35, 0.1]
    assert Cue.LEFT in out[0.35, 1.6]


def seen_at(n: int, *yaws: float) -> Inputs:
    """Tick `n` with a picture every tenth tick that reports the target at these yaws."""
    taken = n - n % 10
    found = tuple(Detection("bottle", 0.9, yaw, 0.0, 0.1, 0.1) for yaw in yaws)
    return replace(tick(n), detections=Detections(taken * TICK_NS, taken, "test", found))


def test_a_single_false_sighting_turns_nobody_away_from_the_target() -> None:
    """The target is on the left; one picture of ten reports it, stronger, on the right as well."""
    config = with_overrides(RobotConfig(), {"perception": {"target": "bottle"}})
    ticks = [seen_at(n, *((1.6, -1.6) if n // 10 == 8 else (1.6,))) for n in range(120)]
    on_belief = {decision.cue for decision in think(make_brain(config), ticks)[10:]}
    assert on_belief == {Cue.LEFT}
    wrong = [
        replace(each, detections=seen_at(n, -1.6).detections) if n // 10 == 8 else each for n, each in enumerate(ticks)
    ]
    on_tracks = with_overrides(config, {"guidance": {"act_on": "tracks"}})
    assert Cue.RIGHT in {decision.cue for decision in think(make_brain(on_tracks), wrong)}
    assert {decision.cue for decision in think(make_brain(config), wrong)[10:]} == {Cue.LEFT}


def test_the_values_shown_are_those_expected_over_where_the_target_may_be() -> None:
    config = with_overrides(RobotConfig(), {"perception": {"target": "bottle"}})
    ticks = [seen_at(n, *((1.6,) if n // 10 % 2 else (2.3,))) for n in range(200)]
    on_tracks = make_brain(with_overrides(config, {"guidance": {"act_on": "tracks"}}))
    values = {d.q for d in think(make_brain(config), ticks) if d.q}
    certain = {d.q for d in think(on_tracks, ticks) if d.q}
    assert values
    assert certain
    assert not values & certain


def test_the_particle_filter_of_the_configuration_decides_the_same_again() -> None:
    wanted = {"perception": {"target": "bottle"}, "intent": {"filter": "particle", "particles": 200, "seed": 7}}
    ticks = [tick(n, head_yaw=0.5 + 0.05 * math.sin(n / 9)) for n in range(200)]
    first, again, other = (
        think(
            make_brain(with_overrides(RobotConfig(), {**wanted, "intent": {**wanted["intent"], "seed": seed}})), ticks
        )
        for seed in (7, 7, 8)
    )
    assert first == again
    assert [d.belief for d in first] != [d.belief for d in other]
    assert first[-1].intention == 7


def test_a_brain_learns_how_its_operator_follows_arrows(brain: Brain) -> None:
    learning = replace(brain, learner=OnlineLearner())
    heads = [0.0] * 30 + [-math.pi / 4] * 40 + [-math.pi / 2] * 40
    state = BrainState()
    for n, head_yaw in enumerate(heads):
        state, _ = learning.step(state, tick(n, head_yaw=head_yaw, target_yaw=-math.pi / 2))
    assert state.online is not None
    assert state.online.learnt.rates == FollowRates(right=(11.0, 1.0))


def test_the_robot_holds_while_a_cue_is_shown(brain: Brain) -> None:
    out = think(brain, [tick(n, target_yaw=2.0) for n in range(190)])
    assert all(d.wanted == STILL for d in out)
    assert "cue shown" in out[-1].reasons


def test_a_gaze_held_against_a_cue_overrules_it_after_four_seconds(brain: Brain) -> None:
    out = think(brain, [tick(n, target_yaw=2.0) for n in range(300)])
    intended = next(n for n, d in enumerate(out) if d.intention is not None)
    driven = next(n for n, d in enumerate(out) if d.wanted != STILL)
    assert (driven - intended) * TICK_NS == pytest.approx(4e9, abs=TICK_NS)
    assert out[-1].cue is Cue.LEFT


def test_a_cue_that_comes_while_driving_stops_the_robot_whatever_was_intended_before(brain: Brain) -> None:
    ticks = [tick(n, target_yaw=2.0 if n >= 300 else None) for n in range(400)]
    out = think(brain, ticks)
    assert out[299].wanted != STILL
    assert all(d.wanted == STILL for d in out[305:])


def test_turning_the_base_under_a_still_head_is_no_head_motion(brain: Brain) -> None:
    turning = [tick(n, head_yaw=-0.01 * n, base_yaw=0.01 * n) for n in range(250)]
    out = think(brain, turning)
    assert out[-1].intention == 0


def test_a_target_seen_before_the_base_turned_is_where_it_was(brain: Brain) -> None:
    ticks = [tick(n, base_yaw=0.02 * n) for n in range(60)]
    seen = Detections(20 * TICK_NS, 1, "test", (Detection("bottle", 0.9, 0.3, 0.0, 0.1, 0.1),))
    ticks[40:] = [replace(t, detections=seen) for t in ticks[40:]]
    out = think(brain, ticks)
    assert out[-1].target_yaw == pytest.approx(0.3 + 0.4 - 59 * 0.02, abs=1e-6)


def test_while_a_stick_is_given_the_gaze_drives_nothing(brain: Brain) -> None:
    ticks = [tick(n, head_yaw=0.5) for n in range(250)]
    driven = replace(ticks[-1], operator=replace(ticks[-1].operator, stick=Twist(0.1, 0.2)))
    out = think(brain, [*ticks, driven])
    assert out[-2].wanted != STILL
    assert out[-1].wanted == STILL
    assert out[-1].reasons == ("stick",)


def test_the_same_inputs_give_the_same_decisions(brain: Brain) -> None:
    ticks = [tick(n, head_yaw=math.sin(n / 20), target_yaw=2.0 if n % 7 == 0 else None) for n in range(200)]
    assert think(brain, ticks) == think(brain, ticks)


def test_without_a_target_there_is_no_cue() -> None:
    out = think(make_brain(RobotConfig()), [tick(n, target_yaw=1.0) for n in range(20)])
    assert {d.cue for d in out} == {Cue.NONE}
    assert out[-1].target_yaw is None
