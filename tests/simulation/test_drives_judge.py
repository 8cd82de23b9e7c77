from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest

from ghal360_robot.messages import Pose2, Twist
from ghal360_robot.simulation.drive_judge import NOTICE_S, Contact, ContactJudge, Fault, StandstillJudge
from ghal360_robot.simulation.walkers import Crowd, Moving
from ghal360_robot.simulation.world import ROBOT_RADIUS_M, World, build_world

REACTION_S, DECEL = 0.25, 0.5
DT_S = 0.02


@dataclass
class Somebody:
    """One person straight ahead of the origin, as much of a crowd as the judge looks at."""

    ahead_m: float
    speed: float = 0.0
    """Towards the robot."""
    radius: Any = field(default_factory=lambda: np.array([0.2]))

    @property
    def at(self) -> Any:
        return np.array([[self.ahead_m, 0.0]])

    @property
    def velocity(self) -> Any:
        return np.array([[-self.speed, 0.0]])

    def gaps(self, robot: Moving) -> Any:
        return np.array([abs(self.ahead_m - robot.x) - self.radius[0] - robot.radius])


def meeting(v: float, speed: float, *, seen_for_s: float, starts_v: float | None = None) -> list[Contact]:
    """Robot and person go straight at each other's place until they touch; seen in the last `seen_for_s`."""
    judge = ContactJudge(1, REACTION_S, DECEL)
    lasts_s, touch_m = 4.0, ROBOT_RADIUS_M + 0.2
    steps = round(lasts_s / DT_S)
    for k in range(steps + 1):
        left_s = lasts_s - k * DT_S
        if k % 3 == 0:
            hits = np.array([3, 1]) if left_s <= seen_for_s else np.array([0, 1])
            judge.saw(k * DT_S, hits, v if starts_v is None else starts_v)
        robot = Moving(-v * left_s + 1e-6, 0.0, v, 0.0, ROBOT_RADIUS_M)
        judge.look(k * DT_S, cast("Crowd", Somebody(touch_m + speed * left_s - 1e-6, speed)), robot, 0.0)
    return judge.contacts


@pytest.mark.parametrize(
    ("v", "seen_for_s", "fault"),
    [
        (0.3, 2.0, Fault.OWN_MOTION),
        (0.3, 1.0, Fault.OUT_OF_HIDING),  # needs 0.3 + 0.25 + 0.3 / 0.5 = 1.15 s
        (0.3, 1.3, Fault.OWN_MOTION),
        (0.3, 0.0, Fault.OUT_OF_HIDING),
        (0.0, 2.0, Fault.WALKED_INTO),
        (0.01, 2.0, Fault.WALKED_INTO),
        (-0.1, 2.0, Fault.WALKED_INTO),
        (0.03, 2.0, Fault.OWN_MOTION),
    ],
)
def test_a_contact_is_blamed_on_who_could_have_avoided_it(v: float, seen_for_s: float, fault: Fault) -> None:
    (contact,) = meeting(v, 0.8, seen_for_s=seen_for_s)
    assert contact.fault is fault
    assert contact.towards_mps == pytest.approx(v)
    assert contact.person_mps == pytest.approx(0.8)
    assert contact.foreseeable
    assert contact.bearing_deg == pytest.approx(0.0)


def test_a_robot_that_sped_up_towards_somebody_in_sight_has_no_excuse() -> None:
    (contact,) = meeting(0.4, 0.5, seen_for_s=0.7, starts_v=0.0)
    assert contact.need_s == pytest.approx(NOTICE_S + REACTION_S)
    assert contact.fault is Fault.OWN_MOTION


def test_one_contact_counts_once_until_both_have_parted() -> None:
    judge = ContactJudge(1, REACTION_S, DECEL)
    robot = Moving(0.0, 0.0, 0.0, 0.0, ROBOT_RADIUS_M)
    for k, ahead_m in enumerate((0.7, 0.57, 0.55, 0.59, 0.57, 0.7, 0.57)):
        judge.look(k * DT_S, cast("Crowd", Somebody(ahead_m)), robot, 0.0)
    assert [contact.at_s for contact in judge.contacts] == [pytest.approx(DT_S), pytest.approx(6 * DT_S)]


@pytest.mark.parametrize(("pace", "fault"), [(0.0, Fault.STEPPED_IN), (0.1, Fault.STEPPED_IN), (0.2, Fault.OWN_MOTION)])
def test_who_stands_beside_the_way_and_steps_into_it_when_it_is_too_late_causes_the_contact(
    pace: float, fault: Fault
) -> None:
    judge = ContactJudge(1, REACTION_S, DECEL)
    v = 0.5
    for k in range(101):
        now_s = k * DT_S
        judge.saw(now_s, np.array([3, 0]), v)
        # Waits 1.3 m beside the way until half a second before the robot has come there.
        aside = 1.3 if now_s < 1.5 else max(0.0, 1.3 - 2.4 * (now_s - 1.5))
        robot = Moving(v * (now_s - 2.0), aside, v, 0.0, ROBOT_RADIUS_M)
        gap = math.hypot(0.5 - robot.x, aside) - 0.58

        class Aside(Somebody):
            def gaps(self, _robot: Moving, gap: float = gap) -> Any:
                return np.array([gap])

            at = property(lambda _, now_s=now_s: np.array([[0.5, pace * now_s]]))  # strolls along beside the way

            velocity = property(lambda _: np.array([[0.0, pace]]))

        judge.look(now_s, cast("Crowd", Aside(0.5)), robot, 0.0)
    assert len(judge.contacts) == 1
    assert judge.contacts[0].fault is fault
    assert not judge.contacts[0].foreseeable


def test_what_stands_still_for_ever_is_always_the_robots_fault() -> None:
    judge = ContactJudge(0, REACTION_S, DECEL)
    judge.touched_solid(1.0, 0, 0.1)
    judge.touched_solid(2.0, 1, -0.1)
    judge.touched_solid(3.0, 1, -0.1)
    (contact,) = judge.contacts
    assert (contact.at_s, contact.fault, contact.person, contact.bearing_deg) == (2.0, Fault.OWN_MOTION, None, 180.0)


@pytest.fixture(scope="module")
def world() -> World:
    return build_world("home", 3)


def stood(
    world: World,
    seconds: float,
    crowd: Somebody,
    *,
    asked: Twist | None,
    turn: float = 0.0,
    lets: Callable[[Twist], bool] = lambda _: False,
) -> StandstillJudge:
    judge = StandstillJudge(world)
    for k in range(round(seconds / 0.2) + 1):
        pose = Pose2(world.start.x, world.start.y, k * turn)
        judge.sample(k * 0.2, pose, asked, cast("Crowd", crowd), ROBOT_RADIUS_M, lets)
    return judge


def test_ten_seconds_without_the_motion_asked_for_is_stuck(world: World) -> None:
    judge = stood(world, 12.0, Somebody(50.0), asked=Twist(0.3, 0.0))
    assert [still.at_s for still in judge.stuck] == [pytest.approx(10.0)]
    assert Twist(0.0, 0.5) in judge.stuck[0].free


def test_a_robot_that_would_do_something_else_is_asked_for_the_wrong_thing(world: World) -> None:
    asked = Twist(0.3, 0.0)
    assert stood(world, 12.0, Somebody(50.0), asked=asked, lets=lambda twist: twist == Twist(0.0, 0.5)).stuck == []
    assert stood(world, 12.0, Somebody(50.0), asked=asked, lets=lambda twist: twist == Twist(9.0, 9.0)).stuck != []


@pytest.mark.parametrize(
    ("seconds", "asked", "turn"),
    [(9.0, Twist(0.3, 0.0), 0.0), (30.0, None, 0.0), (15.0, Twist(0.0, 0.4), 0.02)],
)
def test_waiting_not_asking_and_turning_are_not_stuck(
    world: World, seconds: float, asked: Twist | None, turn: float
) -> None:
    assert stood(world, seconds, Somebody(50.0), asked=asked, turn=turn).stuck == []


def test_a_robot_that_can_only_turn_in_the_open_is_wedged(world: World) -> None:
    judge = stood(world, 12.0, Somebody(50.0), asked=Twist(0.3, 0.0), turn=0.05)
    assert judge.stuck == []
    assert len(judge.wedged) == 1


def test_a_robot_that_is_hugged_is_not_to_blame(world: World) -> None:
    class Hugging(Somebody):
        @property
        def at(self) -> Any:
            return np.array([[world.start.x + 0.3, world.start.y]])

    assert stood(world, 12.0, Hugging(0.0), asked=Twist(0.0, 0.4)).stuck == []
