"""Who moves and who does not, in simulated scans: a bare room, chair legs, people's legs, noise, a moving robot."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from ghal360_robot.messages import BaseMode, BaseState, Inputs, Pose2, Twist
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.memory import Memory, remember
from ghal360_robot.safety.people import Person, about, compared, follow, moving, near, things
from ghal360_robot.safety.sight import ASTRAY_SOON, Look, look
from ghal360_robot.simulation.plant import advance
from tests.safety.conftest import FRESH, YAW, around, circles_ranges, scan

LIMITS = SafetyLimits()
SCAN_NS = 1_000_000_000 // 15
LEG_M = 0.07
NOISE_M = 0.020
NONE = np.zeros((0, 3))


def room(rng: np.random.Generator) -> np.ndarray:
    """Chair and table legs of two to six centimetres, and a few round things, anywhere but on the robot's way."""
    circles = np.column_stack((rng.uniform(-3, 6, 60), rng.uniform(-4, 4, 60), rng.uniform(0.01, 0.03, 60)))
    circles[:8, 2] = 0.25
    return circles[np.abs(circles[:, 1]) > 0.6]


class Walk:
    """A robot with a lidar in a room with something that moves; odometry is late and the lidar a little askew."""

    def __init__(self, seed: int, still: np.ndarray, legs: Callable[[float], np.ndarray], twist: Twist) -> None:
        self.rng = np.random.default_rng(seed)
        self.still, self.legs, self.twist = still, legs, twist
        self.pose = Pose2()
        self.odometry = Pose2()
        self.memory = Memory()
        self.now_ns = 0
        self.states: list[BaseState] = []

    def step(self, twist: Twist | None = None) -> Memory:
        """One scan and the base states until the next, the last of them 20 ms old."""
        moving = self.twist if twist is None else twist
        for k in range(4):
            stamp = self.now_ns - SCAN_NS + (k + 1) * SCAN_NS // 4 - 20_000_000
            state = BaseState(max(stamp, k), BaseMode.DRIVE, self.odometry, moving, 90.0)
            tick = Inputs(self.now_ns, 0, state, None, None, None, {"tim571": FRESH})
            self.memory = remember(self.memory, tick, LIMITS)
            self.pose = advance(self.pose, moving, SCAN_NS / 4e9)
            # Tires a percent off, as before any calibration.
            self.odometry = advance(self.odometry, Twist(1.01 * moving.v, 0.99 * moving.w), SCAN_NS / 4e9)
        askew = Pose2(self.pose.x, self.pose.y + 0.01, self.pose.yaw + math.radians(0.5))
        circles = np.concatenate((self.still, self.legs(self.now_ns / 1e9)))
        ranges = circles_ranges(askew, circles) + self.rng.normal(0.0, NOISE_M, len(YAW))
        seen = scan(ranges, self.now_ns)
        base = BaseState(self.now_ns - 20_000_000, BaseMode.DRIVE, self.odometry, moving, 90.0)
        tick = Inputs(self.now_ns, 0, base, seen, None, None, {"tim571": FRESH}, surroundings=around(seen))
        for _ in ("taken in", "what moves", "who moves"):
            self.memory = remember(self.memory, tick, LIMITS)
        self.now_ns += SCAN_NS
        return self.memory


def confirmed(memory: Memory) -> list[Person]:
    return [person for person in memory.people if person.confirmed]


@pytest.mark.parametrize(
    "twist",
    [Twist(0.0, 0.0), Twist(0.5, 0.0), Twist(0.0, 0.8), Twist(0.3, -0.8)],
    ids=["stand", "drive", "turn", "arc"],
)
def test_in_a_world_at_rest_nothing_moves_however_the_robot_does(twist: Twist) -> None:
    walk = Walk(1, room(np.random.default_rng(7)), lambda _: NONE, twist)
    for n in range(90):
        memory = walk.step(twist if n % 30 < 20 else Twist(0.3 * twist.v, -twist.w))
        assert memory.people == ()


def legs_from(start_s: float, x: float, y: float, vx: float, vy: float) -> Callable[[float], np.ndarray]:
    """Two legs that stand until they start to walk at a constant pace."""

    def at(now_s: float) -> np.ndarray:
        t = max(0.0, now_s - start_s)
        return np.array([[x + vx * t, y + vy * t + 0.1, LEG_M], [x + vx * t, y + vy * t - 0.1, LEG_M]])

    return at


@pytest.mark.parametrize("robot", [Twist(0.0, 0.0), Twist(0.3, 0.0), Twist(0.0, 0.6)], ids=["stand", "drive", "turn"])
@pytest.mark.parametrize(
    ("x", "y", "vx", "vy"),
    [
        (2.6, 0.0, -1.2, 0.0),
        (2.4, 0.3, -0.6, 0.0),
        (1.8, 0.8, 0.0, -1.2),
        (1.8, -0.8, 0.0, 0.6),
        (1.5, 1.0, -0.4, -0.4),
    ],
)
def test_who_starts_to_walk_is_seen_to_within_a_third_of_a_second(
    x: float, y: float, vx: float, vy: float, robot: Twist
) -> None:
    start_s = 1.5
    back = advance(Pose2(), robot, start_s)
    c, s = math.cos(back.yaw), math.sin(back.yaw)
    world = (back.x + c * x - s * y, back.y + s * x + c * y, c * vx - s * vy, s * vx + c * vy)
    walk = Walk(3, NONE, legs_from(start_s, *world), robot)
    while not confirmed(memory := walk.step()):
        assert walk.now_ns / 1e9 < start_s + 0.45, "not seen in time"
    assert (walk.now_ns - SCAN_NS) / 1e9 - start_s <= 0.37
    (first, *_) = confirmed(memory)
    assert math.dist((first.x, first.y), legs_from(start_s, *world)(walk.now_ns / 1e9).mean(axis=0)[:2]) < 0.35


def test_who_is_told_to_walk_matters_from_that_very_scan_on() -> None:
    walk = Walk(3, NONE, legs_from(1.5, 2.6, 0.0, -1.2, 0.0), Twist())
    while not confirmed(memory := walk.step()):
        assert memory.someone_ns is None
    assert memory.scene is not None
    assert len(memory.scene.points) > memory.scene.walking
    assert memory.someone_ns == memory.scene.stamp_ns


def test_who_seems_to_move_matters_from_that_very_scan_on() -> None:
    walk = Walk(3, NONE, legs_from(1.5, 2.6, 0.0, -1.2, 0.0), Twist())
    while not (memory := walk.step()).people:
        assert memory.scene is not None
        assert memory.scene.walking == len(memory.scene.points)
    assert memory.scene is not None
    assert [person.confirmed for person in memory.people] == [False]
    assert len(memory.scene.points) > memory.scene.walking
    assert memory.someone_ns is None


def test_who_strolls_is_seen_within_half_a_second_and_who_walks_on_stays_seen() -> None:
    walk = Walk(4, NONE, legs_from(1.5, 2.5, 0.0, -0.3, 0.0), Twist())
    seen = [bool(confirmed(walk.step())) for _ in range(75)]
    assert seen.index(True) * SCAN_NS / 1e9 < 1.5 + 0.55
    assert all(seen[seen.index(True) :])


def test_who_pauses_is_remembered_and_who_leaves_is_forgotten() -> None:
    def legs(now_s: float) -> np.ndarray:
        at = legs_from(1.5, 2.6, 0.0, -0.6, 0.0)(min(now_s, 3.0))
        return at if now_s < 8.0 else at + np.array((50.0, 0.0, 0.0))

    walk = Walk(5, NONE, legs, Twist())
    at_7 = [walk.step() for _ in range(105)][-1]
    (person,) = confirmed(at_7)
    assert person.moved_ns < 4.0e9
    assert person.there_ns > 6.8e9
    assert at_7.scene is not None
    assert at_7.scene.walking == len(at_7.scene.points)
    assert at_7.scene.resting < at_7.scene.walking
    for _ in range(45):
        memory = walk.step()
    assert memory.people == ()


def test_memory_of_who_stands_for_long_fades() -> None:
    at = np.column_stack((np.full(6, 1.0), np.linspace(-0.1, 0.1, 6)))
    person = Person(1.0, 0.0, 0, 0, 2)
    still = np.zeros(6, bool)
    beam = np.arange(6)
    assert follow((person,), at, still, beam, 10_000_000_000, 10.0) == (Person(1.0, 0.0, 0, 10_000_000_000, 2),)
    assert follow((person,), at, still, beam, 10_000_000_001, 10.0) == ()
    late = Person(1.0, 0.0, 100_000_000_000, 100_000_000_000, 2)
    assert follow((late,), at, still, beam, 105_000_000_000, 10.0) != ()
    once = Person(1.0, 0.0, 0, 0, 1)
    assert follow((once,), at, still, beam, 500_000_000, 10.0) != ()
    assert follow((once,), at, still, beam, 500_000_001, 10.0) == ()


FREE, WALL = (look(around(scan(np.full(len(YAW), far), 1)), Pose2(), 0.0) for far in (3.0, 0.8))


@pytest.mark.parametrize(
    ("bearing", "seen", "gone"),
    [(0.0, (FREE,), True), (0.0, (WALL,), False), (0.0, (), False), (math.pi, (FREE,), False)],
    ids=["seen to be free", "behind something", "no scan", "behind the robot"],
)
def test_who_is_not_where_they_were_is_gone_only_if_the_place_is_seen_to_be_free(
    bearing: float, seen: tuple[Look, ...], gone: bool
) -> None:
    person = Person(1.5 * math.cos(bearing), 1.5 * math.sin(bearing), 0, 0, 2)
    nothing = np.zeros((0, 2)), np.zeros(0, bool), np.zeros(0, np.intp)
    assert follow((person,), *nothing, 1_500_000_000, 10.0, seen) == (person,)
    assert follow((person,), *nothing, 1_500_000_001, 10.0, seen) == (() if gone else (person,))
    assert follow((person,), *nothing, 10_000_000_001, 10.0, seen) == ()


def test_somebody_is_about_until_they_were_missed_for_a_moment() -> None:
    assert about((Person(1.0, 0.0, 0, 0, 2),), 1_500_000_000)
    assert not about((Person(1.0, 0.0, 0, 0, 2),), 1_500_000_001)
    assert not about((Person(1.0, 0.0, 0, 0, 1),), 0)


def test_who_was_behind_the_robot_is_known_again_when_it_turns() -> None:
    legs = legs_from(1.5, 2.4, 0.3, -0.6, 0.0)
    walk = Walk(6, room(np.random.default_rng(7)), lambda now_s: legs(min(now_s, 3.5)), Twist())
    while walk.now_ns < 5e9:
        walk.step()
    assert confirmed(walk.memory)
    turned_s = 0.0
    hidden = known = 0
    while turned_s < 1.8 * math.pi:
        memory = walk.step(Twist(0.0, 1.0))
        turned_s += SCAN_NS / 1e9
        assert memory.scene is not None
        seen = memory.scene.walking > memory.scene.resting
        hidden += not seen
        known += seen and hidden > 22
    assert hidden > 22, "they were out of sight for longer than it takes to be gone"
    assert known > 10


def test_the_robot_keeps_clear_of_who_has_moved_and_for_a_moment_of_who_seems_to() -> None:
    assert Person(1.0, 0.0, 0, 0, 2).counts(10_000_000_000)
    assert Person(1.0, 0.0, 5, 5, 1).counts(100_000_005)
    assert not Person(1.0, 0.0, 5, 5, 1).counts(100_000_006)


def test_somebody_is_confirmed_by_a_second_scan_and_not_by_their_second_leg() -> None:
    leg = np.array([[1.0, 0.0], [1.0, 0.02], [1.0, 0.3], [1.0, 0.32]])
    beam = np.array([0, 1, 20, 21])
    both = np.ones(4, bool)
    people = follow((), leg, both, beam, 1, 10.0)
    assert [person.confirmed for person in people] == [False]
    people = follow(people, leg + np.array((0.1, 0.0)), both, beam, 2, 10.0)
    assert [person.confirmed for person in people] == [True]
    assert people[0].x == pytest.approx(1.1)
    assert people[0].moved_ns == people[0].there_ns == 2


def test_people_further_apart_than_a_step_are_two_and_a_crowd_is_bounded() -> None:
    at = np.repeat(np.column_stack((np.arange(20) * 0.6, np.zeros(20))), 2, axis=0)
    beam = np.repeat(np.arange(20) * 10, 2)
    people = follow((), at, np.ones(40, bool), beam, 5, 10.0)
    assert len(people) == 12
    people = follow(people[:1], at[:2] + np.array((0.0, 0.49)), np.ones(2, bool), beam[:2], 6, 10.0)
    assert len(people) == 1
    assert len(follow(people, at[:2] + np.array((0.0, 1.0)), np.ones(2, bool), beam[:2], 7, 10.0)) == 2


def test_the_nearest_of_two_is_the_one_that_moved_on() -> None:
    people = (Person(0.0, 0.0, 1, 1, 2), Person(0.6, 0.0, 1, 1, 2))
    at = np.array([[0.4, 0.0], [0.4, 0.02]])
    followed = follow(people, at, np.ones(2, bool), np.arange(2), 2, 10.0)
    assert sorted((person.x, person.moved_ns) for person in followed) == [(0.0, 1), (pytest.approx(0.4), 2)]


def test_nearest_is_measured_both_ways() -> None:
    people = (Person(0.0, 0.0, 1, 1, 2), Person(0.0, 0.6, 1, 1, 2))
    at = np.array([[0.0, 0.4], [0.0, 0.42]])
    followed = follow(people, at, np.ones(2, bool), np.arange(2), 2, 10.0)
    assert sorted((person.y, person.moved_ns) for person in followed) == [(0.0, 1), (pytest.approx(0.41), 2)]


def test_whoever_else_moves_beside_somebody_with_two_legs_is_seen_too() -> None:
    at = np.array([[1.0, 0.0], [1.0, 0.02], [1.0, 0.3], [1.0, 0.32], [1.0, 2.0], [1.0, 2.02]])
    beam = np.array([0, 1, 20, 21, 90, 91])
    people = (Person(1.0, 0.1, 1, 1, 2),)
    followed = follow(people, at, np.ones(6, bool), beam, 2, 10.0)
    assert Person(1.0, pytest.approx(2.01), 2, 2, 1) in followed
    assert len(followed) == 2


def test_of_a_crowd_those_who_moved_last_are_kept() -> None:
    at = np.array([[50.0, 0.0], [50.0, 0.02]])
    crowd = tuple(Person(float(n), 9.0, 0, 0, 2) for n in range(12))
    followed = follow(crowd, at, np.ones(2, bool), np.arange(2), 1, 10.0)
    assert len(followed) == 12
    assert followed[0].x == 50.0


def test_returns_beside_each_other_are_one_thing() -> None:
    points = np.array([[1.0, 0.0], [1.0, 0.02], [1.0, 0.04], [1.3, 0.05], [1.3, 0.07], [1.3, 0.5]])
    beam = np.array([0, 1, 2, 3, 4, 9])
    first, count = things(points, beam)
    assert (first.tolist(), count.tolist()) == ([0, 3, 5], [3, 2, 1])
    assert [len(part) for part in things(points[:0], beam[:0])] == [0, 0]
    abreast = np.array([[1.0, 0.0], [1.0, 0.3]])
    assert things(abreast, np.array([0, 1]))[1].tolist() == [1, 1]
    slanted = np.array([[1.0, 0.0], [1.2, 0.02]])
    assert things(slanted, np.array([0, 1]))[1].tolist() == [1, 1]
    assert things(slanted, np.array([0, 4]))[1].tolist() == [2]
    assert things(points[:2], np.array([0, 4]))[1].tolist() == [2]
    assert things(points[:2], np.array([0, 5]))[1].tolist() == [1, 1]


def test_near_somebody_is_within_their_reach() -> None:
    points = np.array([[1.0, 0.44], [1.0, 0.46], [1.44, 0.0], [0.0, 0.0]])
    two = (Person(1.0, 0.0, 0, 0), Person(0.0, 0.1, 0, 0))
    assert near(points, two).T.tolist() == [[True, False, True, False], [False, False, False, True]]
    assert near(points, ()).shape == (4, 0)
    assert near(np.array([[0.45, 0.0], [0.0, 0.0]]), (Person(0.0, 0.0, 0, 0),)).tolist() == [[False], [True]]


def test_scans_of_each_age_are_compared_and_none_twice() -> None:
    looks = [look(around(scan(3.0, k * 100_000_000)), Pose2(), 0.0) for k in range(11)]
    ages = [round((1_000_000_000 - past.stamp_ns) / 1e8) for past in compared(looks, 1_000_000_000)]
    assert ages == [2, 5, 9]
    assert compared(looks[:1], 100_000_000) == ()
    assert [past.stamp_ns for past in compared(looks[:1], 1_000_000_000)] == [0]


def test_only_with_a_scan_of_a_moment_ago_the_narrow_neighbourhood_of_a_direction_will_do() -> None:
    ranges = np.full(811, 3.0)
    ranges[405] = 1.0
    looks = [look(around(scan(ranges, k * 100_000_000)), Pose2(), 0.0) for k in range(11)]
    soon, *older = compared(looks, 1_000_000_000)
    assert soon.free.tolist() == looks[8].free_soon.tolist() != looks[8].free.tolist()
    assert [past.free.tolist() for past in older] == [looks[5].free.tolist(), looks[1].free.tolist()]
    for age_ns, free in ((300_000_000, looks[0].free_soon), (300_000_001, looks[0].free)):
        (only,) = compared(looks[:1], age_ns)
        assert only.free.tolist() == free.tolist()


def test_who_comes_out_from_behind_an_edge_is_seen_to_move_where_an_older_scan_saw_past_it() -> None:
    ranges = np.full(811, 3.0)
    ranges[:405] = 0.8
    past = look(around(scan(ranges)), Pose2(), 0.0)
    angle = ASTRAY_SOON + 2 * (YAW[1] - YAW[0])
    leg = np.array([[0.2 + 1.5 * math.cos(angle), 1.5 * math.sin(angle)]] * 2)
    assert moving(compared([past], 201_000_000), leg, np.array([410, 412]), 0.0).all()
    assert not moving(compared([past], 450_000_000), leg, np.array([410, 412]), 0.0).any()


def test_single_returns_do_not_move_and_neither_does_everything_at_once() -> None:
    past = look(around(scan(3.0)), Pose2(), 0.0)
    one = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, -1.0]])
    assert not moving([past], one, np.array([0, 100, 200]), 0.0).any()
    two = np.array([[1.0, 0.0], [1.0, 0.02], [1.0, -1.0], [3.2, 0.0]])
    assert moving([past], two, np.array([0, 1, 200, 300]), 0.0).tolist() == [True, True, False, False]
    assert not moving([], two, np.array([0, 1, 200, 300]), 0.0).any()
    assert moving([past], two[[0, 1, 3]], np.array([0, 1, 300]), 0.0).tolist() == [True, True, False]
    assert moving([past], one, np.array([0, 100, 200]), 0.0).dtype == bool
    assert moving([past], one[:1], np.array([0]), 0.0).dtype == bool
    many = np.column_stack((np.full(41, 1.0), np.linspace(-0.4, 0.4, 41)))
    assert not moving([past], many, np.arange(41), 0.0).any()
    assert moving([past], many[:40], np.arange(40), 0.0).all()
    half = np.concatenate((many[:20], np.column_stack((np.full(21, 3.3), np.linspace(-0.4, 0.4, 21)))))
    assert moving([past], half, np.arange(41), 0.0).sum() == 20
    assert moving([past], np.concatenate((many[:21], half[20:])), np.arange(42), 0.0).sum() == 21


def test_what_a_turning_robot_may_have_mistaken_for_free_does_not_move() -> None:
    ranges = np.full(811, 3.0)
    ranges[405] = 1.0
    past = look(around(scan(ranges)), Pose2(), 0.0)
    angles = 0.035 + np.array([0.009, 0.012])
    beside = np.column_stack((0.2 + 2 * np.cos(angles), 2 * np.sin(angles)))
    assert moving([past], beside, np.arange(2), 0.0).all()
    assert not moving([past], beside, np.arange(2), 0.8).any()
