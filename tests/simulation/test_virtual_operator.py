"""The virtual operator, one behaviour at a time, in a small drawn world of its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ghal360_robot.messages import Cue, OperatorInput, Pose2
from ghal360_robot.simulation.eyes import LOOKS_PER_TURN, RECOGNISED_M, VIEW_M, Eyes, Sight, View, look
from ghal360_robot.simulation.recollection import (
    FLOOR,
    HIDING,
    SOLID,
    SPACE,
    Recollection,
    forget_tries,
    give_up,
    remember,
)
from ghal360_robot.simulation.virtual_operator import Doing, OperatorState, Temper, start, step
from ghal360_robot.simulation.wayfinding import next_way
from ghal360_robot.simulation.world import World, build_world

MS = 1_000_000
TICK_MS = 50
HERE = Pose2(0.0, 0.0, 0.0)
YAWS = -math.pi + math.tau / LOOKS_PER_TURN * np.arange(LOOKS_PER_TURN)


def hall(pose: Pose2 = HERE, *, target_yaw: float | None = None) -> View:
    """What one sees in a hall from x = -2 to 2 and y = -2 to 2 with a door of 1.2 m in the middle of its east wall."""
    cos, sin = np.cos(YAWS + 1e-9), np.sin(YAWS + 1e-9)
    to_x = np.where(cos > 0, 2.0 - pose.x, -2.0 - pose.x) / cos
    to_y = np.where(sin > 0, 2.0 - pose.y, -2.0 - pose.y) / sin
    wall = np.minimum(to_x, to_y)
    through = (wall == to_x) & (cos > 0) & (np.abs(pose.y + to_x * sin) < 0.6)
    free = np.minimum(np.where(through, VIEW_M, wall), VIEW_M)
    return View(pose, YAWS, free, free, target_yaw)


def run(
    state: OperatorState, sight: Sight, seconds: float, from_ms: int = 0
) -> tuple[OperatorState, list[OperatorInput]]:
    """Show the same sight for a while."""
    messages = []
    for ms in range(from_ms + TICK_MS, from_ms + round(1000 * seconds) + 1, TICK_MS):
        state, message = step(state, sight, ms * MS)
        messages.append(message)
    return state, messages


def fresh(seed: int = 0, **temper: float) -> OperatorState:
    return start(Temper(seed=seed, **temper), HERE, 0)


@pytest.fixture(scope="module")
def office() -> World:
    return build_world("office", 0)


def test_the_same_seed_and_sights_give_the_same_messages() -> None:
    sight = Sight(hall(), armed=True)
    assert run(fresh(3), sight, 20)[1] == run(fresh(3), sight, 20)[1]
    assert run(fresh(3), sight, 20)[1] != run(fresh(4), sight, 20)[1]


def test_a_robot_that_is_ready_is_armed_by_one_press_after_a_second() -> None:
    _, messages = run(fresh(), Sight(hall(), ready=True), 2.5)
    pressed = [message.stamp_ns / 1e9 for message in messages if message.arm_presses]
    assert pressed[0] == pytest.approx(1.05, abs=0.06)
    assert messages[-1].arm_presses == 1


def test_nobody_presses_arm_while_the_robot_is_not_ready_or_the_link_in_trouble() -> None:
    _, messages = run(fresh(), Sight(hall(), ready=False), 10)
    assert messages[-1].arm_presses == 0
    _, messages = run(fresh(), Sight(hall(), ready=True, trouble=True), 10)
    assert messages[-1].arm_presses == 0


def test_a_press_without_effect_is_repeated_after_a_while() -> None:
    _, messages = run(fresh(), Sight(hall(), ready=True), 10)
    assert messages[-1].arm_presses == 3


def test_after_a_stop_the_robot_is_armed_again_when_it_is_ready_for_a_second() -> None:
    state, _ = run(fresh(), Sight(hall(), ready=True), 1.5)
    state, messages = run(state, Sight(hall(), armed=True), 3, from_ms=1500)
    assert messages[-1].arm_presses == 1
    state, messages = run(state, Sight(hall(), trouble=True), 3, from_ms=4500)
    assert messages[-1].arm_presses == 1
    state, messages = run(state, Sight(hall(), ready=True), 0.9, from_ms=7500)
    assert messages[-1].arm_presses == 1
    _, messages = run(state, Sight(hall(), ready=True), 0.4, from_ms=8400)
    assert messages[-1].arm_presses == 2


def test_the_operator_first_looks_around_faster_than_the_intent_filter_takes_for_a_wish() -> None:
    _, messages = run(fresh(1), Sight(hall(), armed=True), 5)
    yaws = np.unwrap([message.head.yaw for message in messages])
    assert np.ptp(yaws) > math.radians(150)
    assert np.abs(np.diff(yaws)).max() < math.radians(60) * 0.05 + math.radians(4)


@pytest.mark.parametrize(("cue", "sign"), [(Cue.LEFT, 1), (Cue.RIGHT, -1)])
def test_a_cue_turns_the_gaze_one_wedge_as_indicated_once_in_two_seconds(cue: Cue, sign: int) -> None:
    state, messages = run(fresh(follow=1.0, jitter=0.0), Sight(hall(), cue, armed=True), 2.2)
    assert state.doing is Doing.FOLLOWING
    assert messages[-1].head.yaw == pytest.approx(sign * math.pi / 4, abs=0.01)
    _, messages = run(state, Sight(hall(), cue, armed=True), 2.0, from_ms=2200)
    assert messages[-1].head.yaw == pytest.approx(sign * math.pi / 2, abs=0.01)


def test_about_one_decision_in_thirty_goes_against_the_cue() -> None:
    """With probability 0.05 the human does any of left, right, nothing: one third of that each."""
    astray = 0
    for seed in range(600):
        state, _ = run(fresh(seed), Sight(hall(), Cue.LEFT, armed=True), 0.5)
        astray += state.aim < 0.4
    assert 8 <= astray <= 36


def test_confirm_with_the_target_in_view_makes_one_press_of_found_after_a_moment() -> None:
    sight = Sight(hall(target_yaw=0.1), Cue.CONFIRM, armed=True)
    _, messages = run(fresh(), sight, 2.0)
    pressed = [message.stamp_ns / 1e9 for message in messages if message.found_presses]
    assert pressed[0] == pytest.approx(0.55, abs=0.06)
    assert messages[-1].found_presses == 1


def test_found_is_not_pressed_without_the_target_in_view_or_without_being_asked() -> None:
    _, messages = run(fresh(), Sight(hall(), Cue.CONFIRM, armed=True), 5)
    assert messages[-1].found_presses == 0
    _, messages = run(fresh(), Sight(hall(target_yaw=0.1), Cue.NONE, armed=True), 5)
    assert messages[-1].found_presses == 0


def test_a_glimpse_shorter_than_recognition_is_no_find() -> None:
    state = fresh()
    for i in range(10):
        seen = 0.1 if i % 2 else None
        sight = Sight(hall(target_yaw=seen), Cue.CONFIRM, armed=True)
        state, messages = run(state, sight, 0.4, from_ms=400 * i)
    assert messages[-1].found_presses == 0


def test_the_gaze_goes_through_the_only_door_and_the_deadman_is_held() -> None:
    state, messages = run(fresh(jitter=0.0), Sight(hall(), armed=True), 15)
    assert state.doing is Doing.GOING
    assert messages[-1].deadman
    assert abs(messages[-1].head.yaw) < math.radians(15)


def test_the_deadman_is_released_while_disarmed_and_while_following_a_cue() -> None:
    _, messages = run(fresh(), Sight(hall(), ready=True), 15)
    assert not any(message.deadman for message in messages)
    _, messages = run(fresh(), Sight(hall(), Cue.LEFT, armed=True), 15)
    assert not any(message.deadman for message in messages)


def test_the_gaze_stays_in_the_world_while_the_robot_turns() -> None:
    state, messages = run(fresh(jitter=0.0), Sight(hall(), Cue.CONFIRM, armed=True), 1)
    before = messages[-1].head.yaw
    turned = replace(hall(), pose=Pose2(0.0, 0.0, 0.5))
    _, messages = run(state, Sight(turned, Cue.CONFIRM, armed=True), 0.1, from_ms=1000)
    assert messages[-1].head.yaw == pytest.approx(before - 0.5, abs=1e-6)


def test_a_robot_that_stays_still_makes_the_operator_turn_away_and_try_elsewhere() -> None:
    state, _ = run(fresh(jitter=0.0), Sight(hall(), armed=True), 9)
    assert state.way is not None
    goal = state.way.goal
    state, _ = run(state, Sight(hall(), armed=True), 8, from_ms=9000)
    assert state.way is None or math.dist(state.way.goal, goal) > 0.3


def test_a_target_in_view_is_approached_but_not_for_ever_if_the_robot_cannot_get_there() -> None:
    sight = Sight(hall(target_yaw=2.0), armed=True)
    state, messages = run(fresh(jitter=0.0), sight, 4)
    assert messages[-1].head.yaw == pytest.approx(2.0, abs=0.01)
    assert messages[-1].deadman
    _, messages = run(state, sight, 6, from_ms=4000)
    assert abs(messages[-1].head.yaw - 2.0) > 0.2


def test_presses_never_go_back_and_the_step_survives_odd_times() -> None:
    state = fresh()
    sight = Sight(hall(), ready=True)
    state, first = step(state, sight, 10**9)
    state, back = step(state, sight, 10**9 - 1)
    state, far = step(state, sight, 10**13)
    assert first.arm_presses <= back.arm_presses <= far.arm_presses
    assert all(math.isfinite(message.head.yaw) for message in (first, back, far))


def test_eyes_see_no_further_than_walls_and_the_end_of_the_view(office: World) -> None:
    view = Eyes(office).look(office.start, 0.0, math.pi / 2)
    truth = office.ranges(office.start.x, office.start.y, view.yaws)
    np.testing.assert_allclose(view.floor_m, np.minimum(truth, VIEW_M))
    assert (view.space_m >= view.floor_m - 1e-9).mean() > 0.99
    assert look(office, office.start, 0.0, math.pi / 2).floor_m == pytest.approx(view.floor_m)


def test_the_target_is_recognised_only_near_in_line_of_sight_and_inside_the_view(office: World) -> None:
    target, eyes = office.target_object(), Eyes(office)
    rng = np.random.default_rng(2)
    recognised = 0
    for _ in range(2000):
        pose = Pose2(rng.uniform(0.5, 13.5), rng.uniform(0.5, 9.5), rng.uniform(-3, 3))
        head = rng.uniform(-3, 3)
        yaw = eyes.look(pose, head, math.pi / 2).target_yaw
        bearing = math.atan2(target.y - pose.y, target.x - pose.x)
        aside = abs(math.remainder(bearing - pose.yaw - head, math.tau))
        near = math.dist((pose.x, pose.y), (target.x, target.y)) <= RECOGNISED_M
        in_view = near and aside <= math.pi / 4
        if in_view and office.visible(pose.x, pose.y, 1.2, target):
            assert yaw == pytest.approx(bearing)
            recognised += 1
        assert yaw is None or in_view
    assert recognised > 5


def test_memory_holds_the_floor_of_the_hall_and_its_walls_and_nothing_behind_them() -> None:
    memory = remember(Recollection.empty(HERE), hall())
    assert memory.marks[memory.cell(1.0, 1.0)] & (FLOOR | SPACE) == FLOOR | SPACE
    assert memory.marks[memory.cell(3.5, 0.0)] & FLOOR
    assert memory.marks[memory.cell(0.0, 2.05)] & (SOLID | HIDING) == SOLID | HIDING
    assert not memory.marks[memory.cell(3.5, 1.9)]
    assert not memory.marks[memory.cell(-2.5, 0.0)]


def test_remembering_adds_and_never_takes_away() -> None:
    memory = remember(Recollection.empty(HERE), hall())
    more = remember(memory, hall(Pose2(1.0, 0.5, 0.0)))
    assert np.all(more.marks & memory.marks == memory.marks)
    assert np.array_equal(forget_tries(give_up(more, 0, 0, 1)).marks & (FLOOR | SOLID), more.marks & (FLOOR | SOLID))


def test_the_memory_of_a_step_cannot_be_written() -> None:
    memory = remember(Recollection.empty(HERE), hall())
    with pytest.raises(ValueError, match="read-only"):
        memory.marks[0, 0] = 1


def test_the_way_leads_to_the_door_and_a_door_given_up_is_not_chosen_again() -> None:
    memory = remember(Recollection.empty(HERE), hall())
    way = next_way(memory, HERE, None)
    assert way is not None
    assert way.goal[0] > 1.0
    assert abs(way.goal[1]) < 1.5
    elsewhere = next_way(give_up(memory, *way.goal, 0.6), HERE, None)
    assert elsewhere is None or math.dist(elsewhere.goal, way.goal) > 0.5


def test_places_outside_of_what_can_be_remembered_do_no_harm() -> None:
    memory = Recollection.empty(HERE)
    far = remember(memory, hall(Pose2(500.0, -500.0, 0.0)))
    assert next_way(far, Pose2(15.95, 15.95, 0.0), None) is None or far.marks.any()
