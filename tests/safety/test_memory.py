from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ghal360_robot.messages import BaseMode, BaseState, Inputs, Pose2, Twist
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.memory import DRIVEN, LOOKS, PAST, Memory, Scene, here, known_free, remember
from ghal360_robot.safety.people import Person
from ghal360_robot.safety.sight import MIDDLE_NS
from tests.safety.conftest import TICK_NS, around, circles_ranges, inputs, scan

LIMITS = SafetyLimits()
SECOND = 1_000_000_000


def at(stamp_ns: int, pose: Pose2, *, w: float = 0.0, ranges: np.ndarray | float | None = None) -> Inputs:
    base = BaseState(stamp_ns, BaseMode.DRIVE, pose, Twist(0.0, w), 90.0)
    seen = None if ranges is None else scan(ranges, stamp_ns)
    tick = inputs(0, base=base, scan=seen, surroundings=None if seen is None else around(seen))
    return replace(tick, stamp_ns=stamp_ns)


def after(*ticks: Inputs, memory: Memory | None = None) -> Memory:
    memory = memory or Memory()
    for tick in ticks:
        memory = remember(memory, tick, LIMITS)
    return memory


def test_nothing_is_remembered_before_the_base_speaks() -> None:
    memory = Memory()
    assert remember(memory, replace(at(0, Pose2(), ranges=2.0), base=None), LIMITS) is memory
    points = here(memory, 5).points
    assert len(points) == len(here(memory, 5).resting) == len(here(memory, 5).walking) == 0


def test_the_last_scan_is_seen_from_where_the_base_is_now() -> None:
    post = circles_ranges(Pose2(), np.array([[1.0, 0.0, 0.05]]))
    first = after(at(0, Pose2(), ranges=post))
    assert here(first, 0).points[:, 0].min() == pytest.approx(0.95, abs=0.01)
    moved = after(at(SECOND, Pose2(0.2, 0.0, 0.0)), memory=first)
    assert here(moved, SECOND).points[:, 0].min() == pytest.approx(0.75, abs=0.01)
    turned = after(at(2 * SECOND, Pose2(0.2, 0.0, 0.4)), memory=moved)
    x, y = here(turned, 2 * SECOND).points.mean(axis=0)
    assert math.atan2(y, x) == pytest.approx(-0.4, abs=0.02)


def test_a_scan_belongs_to_where_the_base_was_in_the_middle_of_its_sweep() -> None:
    memory = after(at(0, Pose2()), at(2 * MIDDLE_NS, Pose2(0.2, 0.0, 0.0), ranges=0.8))
    assert memory.scene is not None
    assert memory.scene.points[:, 0].max() == pytest.approx(0.1 + 0.2 + 0.8, abs=0.01)
    assert memory.looks[-1].x == pytest.approx(0.1 + 0.2)


def test_only_what_matters_is_kept_and_people_matter_from_further_away() -> None:
    reach_m, people_m = LIMITS.reach_m, LIMITS.people_reach_m
    assert len(here(after(at(0, Pose2(), ranges=reach_m - 0.25)), 0).points) > 400
    far = after(at(0, Pose2(), ranges=reach_m + 0.25))
    assert far.scene is not None
    assert len(far.scene.points) == 0
    somebody = Memory(people=(Person(people_m - 0.1, 0.0, 0, 0, 2), Person(0.0, people_m - 0.3, -SECOND, 0, 2)))
    seen = remember(somebody, at(1, Pose2(), ranges=people_m - 0.25), LIMITS)
    assert seen.scene is not None
    now = here(seen, 1)
    assert len(now.walking) > 10
    assert np.abs(now.walking[:, 1]).max() < 0.5
    assert len(now.resting) > 10
    assert now.resting[:, 1].min() > 2.0
    assert len(now.points) == len(now.walking) + len(now.resting)


def test_nothing_further_away_than_it_matters_is_kept() -> None:
    for ranges in (LIMITS.reach_m - 0.1, LIMITS.reach_m + 0.1):
        points = here(after(at(0, Pose2(), ranges=ranges)), 0).points
        assert 0 < len(points) < 811
        assert np.hypot(*points.T).max() < LIMITS.reach_m
    people_m = LIMITS.people_reach_m
    far = Memory(people=(Person(people_m, 0.0, 0, 0, 2),))
    seen = here(remember(far, at(1, Pose2(), ranges=people_m - 0.1989), LIMITS), 1)
    assert len(seen.walking) > 0
    assert np.hypot(*seen.walking.T).max() < people_m


@pytest.mark.parametrize(("age_ns", "walks"), [(SECOND, True), (SECOND + 1, False)])
def test_who_has_not_moved_for_a_second_rests(age_ns: int, walks: bool) -> None:
    seen = remember(Memory(people=(Person(1.0, 0.0, 5, 5, 2),)), at(5 + age_ns, Pose2(), ranges=0.8), LIMITS)
    now = here(seen, 5 + age_ns)
    assert (len(now.walking) > 0) is walks
    assert (len(now.resting) > 0) is not walks


def test_when_somebody_was_about_is_remembered_even_when_the_odometry_begins_anew() -> None:
    somebody = Memory(people=(Person(1.0, 0.0, 5, 5, 2),))
    seen = remember(somebody, at(7, Pose2(), ranges=0.8), LIMITS)
    assert seen.someone_ns == 7
    alone = remember(replace(seen, people=()), at(9, Pose2(), ranges=0.8), LIMITS)
    assert alone.someone_ns == 7
    anew = remember(alone, at(10, Pose2(5.0, 0.0, 0.0)), LIMITS)
    assert anew.looks == ()
    assert anew.someone_ns == 7
    assert remember(Memory(people=(Person(1.0, 0.0, 5, 5, 1),)), at(7, Pose2(), ranges=0.8), LIMITS).someone_ns is None


@pytest.mark.parametrize(("stamp_ns", "counts"), [(7, True), (100_000_005, True), (100_000_006, False)])
def test_somebody_seen_moving_only_once_is_braked_for_until_the_next_scan_tells(stamp_ns: int, counts: bool) -> None:
    once = Memory(people=(Person(1.0, 0.0, 5, 5, 1),))
    seen = remember(once, at(stamp_ns, Pose2(), ranges=0.8), LIMITS)
    assert (len(here(seen, stamp_ns).walking) > 0) is counts
    assert seen.someone_ns is None


def test_finding_out_who_moves_changes_nothing_of_what_a_scan_says_about_the_way_ahead() -> None:
    covered, silent = np.full(811, 2.0), np.full(811, 2.0)
    covered[100:711] = silent[370:440] = np.nan
    for ranges in (covered, silent):
        scenes = [after(*[at(5, Pose2(), ranges=ranges)] * ticks).scene for ticks in (1, 2, 3)]
        said = {(scene.fault, scene.blind_ahead, scene.silent_ahead) for scene in scenes if scene is not None}
        assert len(said) == 1
        (_, blind_ahead, silent_ahead) = said.pop()
        assert bool(blind_ahead) is (ranges is covered)
        assert bool(silent_ahead) is (ranges is silent)


def test_only_the_newest_scan_tells_who_is_gone() -> None:
    gone = Memory(people=(Person(1.5, 0.0, 5, 5, 2),))
    for newest, left in ((3.0, 0), (0.8, 1)):
        ticks = [at(2 * SECOND + k, Pose2(), ranges=3.0) for k in (0, 1)]
        ticks += [at(2 * SECOND + 2, Pose2(), ranges=newest)] * 3
        once = after(*ticks[2:], memory=replace(gone, looks=after(*ticks[:2]).looks))
        assert len(once.people) == left


def test_each_scan_is_taken_in_once_and_the_number_kept_is_bounded() -> None:
    tick = at(5, Pose2(), ranges=2.0)
    memory = after(tick, tick, tick)
    assert len(memory.looks) == 1
    again = remember(memory, tick, LIMITS)
    assert again.scene is memory.scene
    for n in range(1, 40):
        memory = remember(memory, at(n * TICK_NS, Pose2(), ranges=2.0), LIMITS)
    assert len(memory.looks) == LOOKS
    assert memory.looks[-1].stamp_ns == 39 * TICK_NS


def test_older_scans_are_kept_now_and_then_for_as_long_as_ground_is_remembered() -> None:
    memory = after(*(at(n * 100_000_000, Pose2(), ranges=2.0) for n in range(101)))
    assert [old.stamp_ns for old in memory.past] == [n * 500_000_000 for n in range(10, 21)]
    forgetful = SafetyLimits(ground_memory_s=60.0)
    for n in range(100):
        memory = remember(memory, at((101 + 5 * n) * 100_000_000, Pose2(), ranges=2.0), forgetful)
    assert len(memory.past) == PAST


@pytest.mark.parametrize(
    ("pose", "stamp_ns", "jumped"),
    [
        (Pose2(1.29, 0.0, 0.0), 2 * SECOND, False),
        (Pose2(1.31, 0.0, 0.0), 2 * SECOND, True),
        (Pose2(0.0, 0.0, 2.09), 2 * SECOND, False),
        (Pose2(0.0, 0.0, -2.11), 2 * SECOND, True),
        (Pose2(0.0, 0.81, 0.0), SECOND, True),
        (Pose2(0.0, 0.79, 0.0), SECOND, False),
        (Pose2(0.0, 0.0, 0.0), 5, True),
    ],
)
def test_when_the_odometry_begins_anew_everything_is_forgotten(pose: Pose2, stamp_ns: int, jumped: bool) -> None:
    memory = after(at(10, Pose2(), ranges=2.0))
    later = remember(memory, at(stamp_ns, pose), LIMITS)
    assert (later.looks == ()) is jumped
    assert (later.scene is None) is jumped
    assert len(later.driven) == (1 if jumped else 2)
    away = remember(after(at(10, Pose2(3.0, 5.0, 0.0))), at(SECOND, Pose2(3.1, 5.1, 0.0)), LIMITS)
    assert len(away.driven) == 2


def test_the_way_is_noted_every_few_centimetres_or_degrees_for_some_seconds() -> None:
    memory = after(*(at(n * TICK_NS, Pose2(0.0125 * n, 0.0, 0.0)) for n in range(41)))
    gaps = np.diff([place.pose.x for place in memory.driven])
    assert all(0.05 - 1e-9 <= gap < 0.063 for gap in gaps)
    assert len(gaps) >= 8
    assert memory.driven[0].stamp_ns == 3 * TICK_NS  # it was there until then
    spun = after(*(at(n * TICK_NS, Pose2(0.0, 0.0, 0.0251 * n)) for n in range(13)))
    assert [place.pose.yaw for place in spun.driven] == pytest.approx([0.0, 0.1004, 0.2008, 0.3012])
    stood = after(*(at(SECOND + n * TICK_NS, Pose2(0.5, 0.0, 0.0)) for n in range(300)), memory=memory)
    assert len(stood.driven) == 1
    aside = after(*(at(100 * SECOND + n * SECOND, Pose2(0.0, 7.0 + 0.06 * n, 0.0)) for n in range(5)))
    assert [place.pose.y for place in aside.driven] == pytest.approx([7.0, 7.06, 7.12, 7.18, 7.24])
    later = remember(aside, at(105 * SECOND + SECOND // 2, Pose2(0.0, 7.3, 0.0)), LIMITS)
    assert [place.pose.y for place in later.driven] == pytest.approx([7.06, 7.12, 7.18, 7.24, 7.3])
    near = remember(later, at(106 * SECOND + SECOND // 2, Pose2(0.0, 7.26, 0.0)), LIMITS)
    assert [place.pose.y for place in near.driven] == pytest.approx([7.12, 7.18, 7.24, 7.3])
    far = after(*(at(n, Pose2(0.06 * n, 0.0, 0.0)) for n in range(300)))
    assert len(far.driven) == DRIVEN


def test_ground_on_the_robots_way_and_ground_seen_free_is_known() -> None:
    memory = after(at(0, Pose2()), at(SECOND, Pose2(0.2, 0.0, 0.0)), at(2 * SECOND, Pose2(0.4, 0.0, math.pi / 8)))
    behind = np.array([[-0.7, 0.0], [-0.9, 0.0], [0.0, 0.41]])
    straight = after(at(SECOND, Pose2()), at(2 * SECOND, Pose2(0.25, 0.0, 0.0)))
    assert known_free(straight, behind, 0.4, 2 * SECOND).tolist() == [False, False, False]
    assert known_free(straight, np.array([[-0.64, 0.0], [0.39, 0.0]]), 0.4, 2 * SECOND).tolist() == [True, True]
    assert known_free(Memory(), behind, 0.4, 0).tolist() == [False] * 3
    c, s = math.cos(math.pi / 8), math.sin(math.pi / 8)
    started = np.array([[-0.4 * c, 0.4 * s]])  # the origin, from where the base is now
    assert known_free(memory, started, 0.01, 2 * SECOND).tolist() == [True]
    assert known_free(memory, started * (1, -1), 0.01, 2 * SECOND).tolist() == [False]
    sideways = after(at(SECOND, Pose2(0.0, 1.0, math.pi / 2)), at(2 * SECOND, Pose2(0.0, 1.25, math.pi / 2)))
    assert known_free(sideways, np.array([[-0.64, 0.0], [0.0, 0.5]]), 0.4, 2 * SECOND).tolist() == [True, False]
    seen = after(at(0, Pose2(0.0, 0.0, 0.45), ranges=3.0), at(SECOND, Pose2()))
    left_behind = np.array([[-1.0, 1.0], [-1.0, -1.0]])
    assert known_free(seen, left_behind, 0.0, SECOND).tolist() == [True, False]


def test_a_scan_remembers_what_is_wrong_with_it() -> None:
    covered = after(at(0, Pose2(), ranges=np.nan))
    assert covered.scene is not None
    assert covered.scene.fault == "lidar sees nothing: covered?"
    assert covered.scene.blind_ahead == ""
    aside = np.full(811, np.nan)
    aside[:200] = 2.0
    half = after(at(0, Pose2(), ranges=aside))
    assert isinstance(half.scene, Scene)
    assert half.scene.fault == ""
    assert half.scene.blind_ahead == "lidar sees nothing ahead: covered?"
