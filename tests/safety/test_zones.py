from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.messages import STILL, Twist
from ghal360_robot.safety.footprint import Disc
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.zones import (
    ABEAM,
    CRAWL,
    LEAST,
    RELEASE,
    Around,
    _towards,
    approachable,
    judge,
    limit,
    stoppable,
    stopping_m,
)

LIMITS = SafetyLimits()
NONE = np.zeros((0, 2))
AHEAD = Twist(0.5, 0.0)
TRACTOR = SafetyLimits(footprint=(Disc(0.0, 0.0, 0.3), Disc(-0.5, 0.0, 0.3)))
"""A robot that is longer behind than in front."""


def things(*at: tuple[float, float]) -> Around:
    return Around(np.array(at, float).reshape(-1, 2), NONE, NONE)


def resting(*at: tuple[float, float]) -> Around:
    points = np.array(at, float).reshape(-1, 2)
    return Around(points, points, NONE)


def walking(*at: tuple[float, float]) -> Around:
    points = np.array(at, float).reshape(-1, 2)
    return Around(points, NONE, points)


def wall(free_m: float) -> Around:
    """Straight across the way, `free_m` in front of the margin."""
    return Around(np.column_stack((np.full(61, 0.44 + free_m), np.linspace(-1.5, 1.5, 61))), NONE, NONE)


def needed_m(speed: float) -> float:
    return speed * 0.25 + speed**2


def test_the_formulas_are_each_others_inverse() -> None:
    for speed in (0.05, 0.2, 0.5, 1.0):
        room_m = stopping_m(speed, 0.5, 0.25)
        assert room_m == pytest.approx(speed * 0.25 + speed**2 / 1.0)
        assert stoppable(room_m, 0.5, 0.25) == pytest.approx(speed)
        assert stopping_m(-speed, 0.5, 0.25) == pytest.approx(room_m)
        apart_m = 1.2 * (0.25 + speed / 0.5) + room_m
        assert approachable(apart_m, 0.5, 0.25, 1.2) == pytest.approx(speed)
    assert stoppable(-1.0, 0.5, 0.25) == 0.0
    assert approachable(0.29, 0.5, 0.25, 1.2) == pytest.approx(0.0, abs=1e-12)
    assert approachable(-5.0, 0.5, 0.25, 1.2) == pytest.approx(0.0, abs=1e-12)


def test_who_brakes_harder_needs_less() -> None:
    assert stopping_m(0.5, 1.0, 0.2) == pytest.approx(0.1 + 0.125)
    assert stoppable(0.225, 1.0, 0.2) == pytest.approx(0.5)


def test_slowing_down_to_a_pace_needs_the_difference_only() -> None:
    assert stoppable(0.0, 0.5, 0.25, 0.3) == pytest.approx(0.3)
    room_m = (0.5 - 0.3) * 0.25 + (0.5**2 - 0.3**2) / 1.0
    assert stoppable(room_m, 0.5, 0.25, 0.3) == pytest.approx(0.5)


def test_in_the_open_everything_is_allowed_and_nothing_named() -> None:
    twist, verdict = limit(things((5.0, 0.0)), AHEAD, LIMITS, AHEAD)
    assert twist == AHEAD
    assert verdict.free_m == math.inf
    assert verdict.at is None
    assert limit(things(), AHEAD, LIMITS, AHEAD)[0] == AHEAD


@pytest.mark.parametrize("free_m", [0.11, 0.15, 0.3, 0.45])
def test_a_wall_is_approached_so_that_the_robot_can_stop_a_standoff_before_it(free_m: float) -> None:
    twist, verdict = limit(wall(free_m), AHEAD, LIMITS, STILL)
    if twist.v:
        assert needed_m(twist.v) == pytest.approx(free_m - 0.1)
    else:
        assert stoppable(free_m - 0.1, 0.5, 0.25) < LEAST
    assert twist.w == 0.0
    assert verdict.free_m == pytest.approx(free_m, abs=1e-3)
    assert verdict.at == pytest.approx((0.44 + free_m, 0.0))
    assert not verdict.person


def test_a_wall_further_away_than_full_speed_needs_is_nothing_yet() -> None:
    assert limit(wall(0.476), AHEAD, LIMITS, AHEAD)[0] == AHEAD
    assert limit(wall(0.474), AHEAD, LIMITS, STILL)[0].v < 0.5


def test_what_the_measured_speed_cannot_stop_before_any_more_is_a_full_stop() -> None:
    fast = Twist(0.4, 0.0)
    assert limit(wall(needed_m(0.4) - 0.001), Twist(0.2, 0.0), LIMITS, fast)[0] == STILL
    assert limit(wall(needed_m(0.4) + 0.001), Twist(0.2, 0.0), LIMITS, fast)[0] == Twist(0.2, 0.0)
    backwards = Twist(-0.4, 0.0)
    assert limit(wall(needed_m(0.4) - 0.001), Twist(0.2, 0.0), LIMITS, backwards)[0] == Twist(0.2, 0.0)


def test_things_beside_the_way_are_passed_slowly_and_things_further_off_are_not() -> None:
    near, far = things((0.0, 0.51), (0.8, -0.51)), things((0.0, 0.53), (0.8, -0.53))
    assert limit(far, AHEAD, LIMITS, AHEAD)[0] == AHEAD
    twist, verdict = limit(near, AHEAD, LIMITS, AHEAD)
    gap_m = 0.8 - math.sqrt(0.52**2 - 0.51**2)
    assert twist.v == pytest.approx(stoppable(gap_m, 0.5, 0.25, 0.3)) if gap_m < 0.21 else twist == AHEAD
    twist, verdict = limit(things((0.2, -0.51)), AHEAD, LIMITS, AHEAD)
    assert 0.3 < twist.v < 0.45
    assert verdict.at == pytest.approx((0.2, -0.51))
    assert limit(things((0.09, -0.51)), AHEAD, LIMITS, AHEAD)[0].v == pytest.approx(0.3)
    assert limit(things((0.09, -0.51)), Twist(0.25, 0.0), LIMITS, AHEAD)[0].v == 0.25


def test_a_door_of_one_metre_ten_is_passed_at_a_sane_pace() -> None:
    frame = things((0.3, 0.55), (0.4, 0.55), (0.3, -0.55), (0.4, -0.55))
    assert limit(frame, AHEAD, LIMITS, AHEAD)[0].v == 0.5
    askew = things((0.3, 0.50), (0.4, 0.50), (0.3, -0.60), (0.4, -0.60))
    assert limit(askew, AHEAD, LIMITS, AHEAD)[0].v >= 0.3


def test_close_already_the_robot_crawls_where_that_takes_no_clearance_away() -> None:
    beside = things((0.0, 0.42))
    assert limit(beside, AHEAD, LIMITS, STILL)[0] == Twist(CRAWL, 0.0)
    assert limit(things((-0.3, 0.25)), AHEAD, LIMITS, STILL)[0] == Twist(CRAWL, 0.0)
    in_front = things((0.42, 0.0))
    assert limit(in_front, AHEAD, LIMITS, STILL)[0] == STILL
    assert limit(in_front, Twist(-0.15, 0.0), LIMITS, STILL)[0] == Twist(-CRAWL, 0.0)
    assert limit(in_front, Twist(0.2, 0.7), LIMITS, STILL)[0] == Twist(0.0, 0.7)


def test_what_is_on_the_robot_itself_does_not_say_how_close_the_rest_may_come() -> None:
    limits = SafetyLimits(footprint=(Disc(0.2, -0.3, 0.4),))
    cable, wall_ahead = (0.05, -0.3), (0.2 + 0.44 + 0.05, -0.3)
    assert judge(things(cable), AHEAD, limits, STILL).share * 0.5 == pytest.approx(CRAWL)
    assert judge(things(wall_ahead), AHEAD, limits, STILL).share == 0.0
    assert judge(things(cable, wall_ahead), AHEAD, limits, STILL).share == 0.0
    for at in ((0.2, 0.04), (0.2, -0.64)):  # within 5 cm of the rim it is the world's, and close
        assert judge(things(at, wall_ahead), AHEAD, limits, STILL).at == wall_ahead
    small = SafetyLimits(footprint=(Disc(0.0, 0.0, 0.04),))
    assert judge(things((0.01, 0.0)), Twist(-0.1, 0.0), small, STILL).share * 0.1 == pytest.approx(CRAWL)


def test_between_two_walls_that_are_both_too_close_the_robot_crawls_on() -> None:
    x = np.linspace(-1.0, 3.0, 200)
    aisle = np.concatenate([np.column_stack((x, np.full(200, side * 0.43))) for side in (1, -1)])
    assert limit(Around(aisle, NONE, NONE), AHEAD, LIMITS, STILL)[0] == Twist(CRAWL, 0.0)


def test_an_off_centre_robot_does_not_turn_into_what_is_beside_it() -> None:
    beside = things((-0.5, 0.4))
    twist, verdict = limit(beside, Twist(0.0, -0.8), TRACTOR, STILL)
    assert twist == STILL
    assert verdict.at == (-0.5, 0.4)
    assert limit(beside, Twist(0.0, 0.8), TRACTOR, STILL)[0].w > 0.0
    assert limit(beside, Twist(0.0, -0.8), LIMITS, STILL)[0] == Twist(0.0, -0.8)
    further = things((-0.5, 0.6))
    assert -0.8 < limit(further, Twist(0.0, -0.8), TRACTOR, STILL)[0].w < 0.0


def test_slowing_down_keeps_the_turn_that_leads_around() -> None:
    post = things((0.9, -0.35))
    twist, _ = limit(post, Twist(0.5, 0.5), LIMITS, STILL)
    assert twist.w == 0.5
    twist, _ = limit(things((0.75, 0.1)), Twist(0.5, 0.5), LIMITS, STILL)
    assert 0 < twist.v < 0.5


def test_where_the_tighter_arc_is_not_free_the_same_arc_is_driven_more_slowly() -> None:
    wanted = Twist(0.4, 0.2)
    twist, verdict = limit(things((0.6, 0.08)), wanted, LIMITS, STILL)
    assert verdict.share == pytest.approx(0.403, abs=1e-3)
    assert (twist.v, twist.w) == pytest.approx((verdict.share * 0.4, verdict.share * 0.2))
    slower, _ = limit(wall(0.3), Twist(0.5, 0.1), LIMITS, STILL)
    assert 0.0 < slower.v < 0.5
    assert slower.w == 0.1


def test_once_stopped_the_robot_starts_again_only_when_it_gets_somewhere() -> None:
    between = (LEAST + RELEASE) / 2
    room = wall(0.1 + needed_m(between))
    assert limit(room, AHEAD, LIMITS, STILL)[0].v == pytest.approx(between)
    assert limit(room, AHEAD, LIMITS, STILL, stopped=1.0)[0] == STILL
    assert limit(room, AHEAD, LIMITS, STILL, stopped=-1.0)[0].v == pytest.approx(between)
    assert limit(room, Twist(0.02, 0.0), LIMITS, STILL)[0].v == 0.02
    assert limit(room, Twist(0.02, 0.0), LIMITS, STILL, stopped=1.0)[0] == STILL
    more = wall(0.1 + needed_m(RELEASE + 0.01))
    assert limit(more, AHEAD, LIMITS, STILL, stopped=1.0)[0].v == pytest.approx(RELEASE + 0.01)
    assert limit(more, Twist(0.02, 0.0), LIMITS, STILL, stopped=1.0)[0].v == 0.02
    assert limit(wall(0.1 + needed_m(LEAST * 0.9)), AHEAD, LIMITS, STILL)[0] == STILL


def test_who_walks_is_kept_away_from_by_what_they_walk_until_the_robot_stands() -> None:
    for speed in (0.1, 0.3, 0.45):
        apart_m = 1.2 * (0.25 + speed / 0.5) + needed_m(speed)
        somebody = walking((0.4 + 0.25 + apart_m, 0.0))
        twist, verdict = limit(somebody, AHEAD, LIMITS, AHEAD)
        assert twist.v == pytest.approx(speed)
        assert verdict.person
        assert verdict.free_m == pytest.approx(apart_m)
    assert limit(walking((0.94, 0.0)), AHEAD, LIMITS, STILL)[0] == STILL


def test_who_walks_beside_the_way_counts_as_well_and_who_is_left_behind_does_not() -> None:
    assert limit(walking((0.8, 0.8)), AHEAD, LIMITS, AHEAD)[0].v < 0.2
    assert limit(walking((-0.5, 0.6)), AHEAD, LIMITS, AHEAD)[0] == AHEAD
    assert limit(walking((0.0, 0.7)), AHEAD, LIMITS, AHEAD)[0] == Twist(CRAWL, 0.0)
    assert limit(walking((0.0, 0.7), (0.7, 0.1)), AHEAD, LIMITS, AHEAD)[0] == STILL
    assert limit(walking((0.8, 0.0)), Twist(-0.15, 0.0), LIMITS, STILL)[0] == Twist(-0.15, 0.0)
    assert limit(walking((0.8, 0.0)), Twist(0.0, 0.8), LIMITS, STILL)[0] == Twist(0.0, 0.8)


def test_whom_a_turn_brings_in_front_is_not_left_behind() -> None:
    at_the_side = (-0.4, 0.75)
    left, right = Twist(0.45, 0.76), Twist(0.45, -0.76)
    assert limit(walking(at_the_side), replace_w(left, 0.0), LIMITS, STILL)[0] == replace_w(left, 0.0)
    assert limit(walking(at_the_side), right, LIMITS, STILL)[0] == right
    assert limit(walking(at_the_side), left, LIMITS, STILL)[0].v < 0.1
    assert limit(walking((at_the_side[0], -at_the_side[1])), right, LIMITS, STILL)[0].v < 0.1


def test_a_turn_that_ends_before_somebody_leaves_them_behind() -> None:
    turn = Twist(0.45, 0.3)
    ends = 0.3 * (LIMITS.reaction_s + 0.45 / LIMITS.decel)
    beyond = ends + math.acos(ABEAM) + math.radians(25)
    assert limit(walking((0.8 * math.cos(beyond), 0.8 * math.sin(beyond))), turn, LIMITS, STILL)[0] == turn


def replace_w(twist: Twist, w: float) -> Twist:
    return replace(twist, w=w)


def test_who_rests_is_passed_at_a_crawl_with_the_room_of_a_body() -> None:
    twist, verdict = limit(resting((0.2, 0.7)), AHEAD, LIMITS, AHEAD)
    assert twist.v == pytest.approx(CRAWL)
    assert verdict.person
    assert limit(resting((0.0, 0.95)), AHEAD, LIMITS, AHEAD)[0] == AHEAD
    blocked, verdict = limit(resting((0.65, 0.3)), AHEAD, LIMITS, STILL)
    assert blocked == STILL
    assert verdict.person
    assert limit(things((0.65, 0.3)), AHEAD, LIMITS, STILL)[0].v > LEAST


def test_the_room_of_a_body_is_kept_from_who_rests_and_not_from_all_that_stands() -> None:
    wall_m = (0.2, 0.5)
    somebody_far = Around(np.array([wall_m, (2.5, 2.0)]), np.array([(2.5, 2.0)]), NONE)
    assert limit(somebody_far, AHEAD, LIMITS, AHEAD) == limit(things(wall_m), AHEAD, LIMITS, AHEAD)
    assert limit(somebody_far, AHEAD, LIMITS, AHEAD)[0].v > 3 * CRAWL


def test_the_worst_of_all_is_named() -> None:
    both = Around(np.array([[1.6, 0.0], [0.6, 0.0]]), NONE, np.array([[1.6, 0.0]]))
    _, verdict = limit(both, AHEAD, LIMITS, STILL)
    assert verdict.at == (0.6, 0.0)
    assert not verdict.person


BESIDE = SafetyLimits(footprint=(Disc(0.0, 0.3, 0.2),), accel=0.3, decel=0.5, w_accel=1.5)
IN_FRONT = SafetyLimits(footprint=(Disc(0.3, 0.0, 0.2),), decel=0.5, w_accel=1.5)


@pytest.mark.parametrize(("limits", "share_of_w"), [(BESIDE, 1.0), (IN_FRONT, 1.0)])
def test_a_disc_beside_the_origin_brakes_as_the_turn_does(limits: SafetyLimits, share_of_w: float) -> None:
    """Turning by 0.8 rad/s it moves by 0.24 m/s and stands after 0.53 s: it brakes at 0.45 m/s^2."""
    (disc,) = limits.footprint
    turn = Twist(0.0, 0.8 * share_of_w)
    for gap in (0.8, 0.9, 1.0):  # rad of turn until contact
        start = math.atan2(disc.y, disc.x)
        half = 2 * math.asin(0.24 / 0.6)
        at = (0.3 * math.cos(start + gap + half), 0.3 * math.sin(start + gap + half))
        room_m = 0.3 * gap - limits.standoff_m
        allowed = stoppable(room_m, 0.45, 0.25)
        twist, verdict = limit(things(at), turn, limits, STILL)
        assert twist.w == pytest.approx(turn.w * min(1.0, allowed / 0.24), rel=1e-6)
        assert verdict.free_m == pytest.approx(0.3 * gap) or twist == turn


def test_where_drive_and_turn_mix_the_later_to_stop_counts() -> None:
    somebody = walking((1.2, 0.3))
    driven = judge(somebody, Twist(0.5, 0.1), BESIDE, STILL)  # drive: 1 s, turn: 0.07 s
    speed = 0.5 - 0.1 * 0.3
    apart_m = 1.2 - 0.2 - 0.25
    assert driven.share * speed == pytest.approx(approachable(apart_m, speed / 1.0, 0.25, 1.2))
    turned = judge(somebody, Twist(0.2, -0.75), BESIDE, STILL)  # drive: 0.4 s, turn: 0.5 s
    speed = 0.2 + 0.75 * 0.3
    assert turned.share * speed == pytest.approx(approachable(apart_m, speed / 0.5, 0.25, 1.2))
    assert turned.at == (1.2, 0.3)


def test_who_walks_is_measured_from_the_part_of_the_outline_that_moves_towards_them() -> None:
    limits = SafetyLimits(footprint=(Disc(0.2, 0.3, 0.3),))
    ahead = judge(walking((3.0, 0.3), (1.4, 0.3)), AHEAD, limits, STILL)
    assert ahead.free_m == pytest.approx(1.2 - 0.3 - 0.25)
    assert ahead.at == (1.4, 0.3)
    turning = judge(walking((0.2, 1.3)), Twist(0.0, 0.8), limits, STILL)  # the disc moves to the left, and forwards
    assert turning.free_m == pytest.approx(1.0 - 0.3 - 0.25)
    speed = 0.8 * math.hypot(0.2, 0.3)
    assert turning.share * speed == pytest.approx(approachable(0.45, speed * 1.5 / 0.8, 0.25, 1.2))
    assert judge(walking((0.9, -0.8)), Twist(0.0, 0.8), limits, STILL).share == math.inf


def test_a_disc_around_the_origin_brakes_as_the_drive_does_however_it_turns() -> None:
    curve = judge(walking((1.5, 0.0)), Twist(0.1, 0.8), LIMITS, STILL)
    assert curve.share * 0.1 == pytest.approx(approachable(1.5 - 0.4 - 0.25, 0.5, 0.25, 1.2))


def test_the_slowest_motion_that_counts_is_kept_away_from_people() -> None:
    assert judge(walking((1.5, 0.0)), Twist(1e-4, 0.0), LIMITS, STILL).share < math.inf
    assert judge(walking((1.5, 0.0)), Twist(9e-5, 0.0), LIMITS, STILL).share == math.inf
    assert judge(things((0.5, 0.0)), Twist(1e-4, 0.0), LIMITS, STILL).share < math.inf
    assert judge(things((0.5, 0.0)), Twist(9e-5, 0.0), LIMITS, STILL).share == math.inf


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_whom_a_turn_brings_in_front_counts_as_there(turn: float) -> None:
    bearings = np.array([0.0, 0.5, 1.0, 1.2, -0.3, 0.5 + math.pi, 3.0, -3.0, 6.0]) * turn
    best = [
        1.0,
        1.0,
        1.0,
        math.cos(0.2),
        math.cos(0.3),
        -math.cos(0.5),
        math.cos(2.0),
        math.cos(2.283185),
        math.cos(0.283185),
    ]
    assert _towards(bearings, turn) == pytest.approx(best, abs=1e-5)
    assert _towards(bearings, 0.0) == pytest.approx(np.cos(bearings))


def test_a_turn_of_the_robot_counts_for_who_is_beside_it() -> None:
    beside = walking((-0.3, 0.8))
    assert judge(beside, Twist(0.3, 0.0), LIMITS, STILL).share == math.inf
    assert judge(beside, Twist(0.3, 0.8), LIMITS, STILL).share < 1.0
    assert judge(beside, Twist(0.3, -0.8), LIMITS, STILL).share == math.inf


def test_the_measured_speed_counts_for_a_part_in_front_as_well() -> None:
    limits = SafetyLimits(footprint=(Disc(0.4, 0.0, 0.2),))
    blocked = things((0.4, 0.45))
    assert judge(blocked, Twist(0.0, 0.5), limits, Twist(0.0, 1.0)).share == 0.0
    assert judge(blocked, Twist(0.0, 0.5), limits, Twist(0.0, -1.0)).share > 0.0


def test_the_measured_speed_counts_for_the_part_that_goes_the_same_way() -> None:
    limits = SafetyLimits(footprint=(Disc(0.0, 0.4, 0.2),))
    turn = Twist(0.0, 0.5)  # the disc moves backwards
    blocked = things((-0.45, 0.4))
    assert judge(blocked, turn, limits, Twist(0.0, 1.0)).share == 0.0
    assert judge(blocked, turn, limits, Twist(0.0, -1.0)).share > 0.0
    assert judge(blocked, turn, limits, Twist(0.5, 0.0)).share > 0.0
    assert judge(blocked, turn, limits, Twist(-0.5, 0.0)).share == 0.0


positions = st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), max_size=6)
twists = st.builds(Twist, st.floats(-0.5, 0.5), st.floats(-0.8, 0.8))
footprints = st.sampled_from([LIMITS, TRACTOR, replace(LIMITS, standoff_m=0.0, slow_margin_m=0.04)])


@given(positions, positions, positions, twists, twists, footprints, st.sampled_from([-1.0, 0.0, 1.0]))
def test_the_zones_never_speed_up_and_never_turn_around(
    at: list[tuple[float, float]],
    still: list[tuple[float, float]],
    moving: list[tuple[float, float]],
    wanted: Twist,
    measured: Twist,
    limits: SafetyLimits,
    stopped: float,
) -> None:
    around = Around(things(*at, *still, *moving).points, things(*still).points, things(*moving).points)
    twist, verdict = limit(around, wanted, limits, measured, stopped)
    assert abs(twist.v) <= abs(wanted.v)
    assert abs(twist.w) <= abs(wanted.w)
    assert twist.v * wanted.v >= 0.0
    assert twist.w * wanted.w >= 0.0
    assert (twist == wanted) or verdict.share < 1.0 or stopped
    if twist != wanted:
        again, _ = limit(around, twist, limits, measured, 0.0)
        assert (again.v, again.w) == pytest.approx((twist.v, twist.w), abs=1e-6)


@given(positions, twists, st.floats(0.1, 1.0))
def test_what_is_allowed_as_a_whole_is_allowed_more_slowly_along_the_same_arc(
    at: list[tuple[float, float]], wanted: Twist, share: float
) -> None:
    around = things(*(one for one in at if math.hypot(*one) > 0.02))  # nothing stands in the middle of the robot
    if judge(around, wanted, LIMITS, STILL).share >= 1.0:
        slower = Twist(share * wanted.v, share * wanted.w)
        assert judge(around, slower, LIMITS, STILL).share >= 1.0 - 1e-9


@given(st.floats(0.0, 2.0), st.floats(0.05, 0.5))
def test_the_allowed_speed_can_always_be_braked_inside_the_free_distance(free_m: float, speed: float) -> None:
    twist, _ = limit(wall(free_m), Twist(speed, 0.0), LIMITS, STILL)
    assert needed_m(twist.v) <= free_m + 1e-6


@pytest.mark.parametrize("cable", [(-0.1, 0.2), (0.0, 0.3)])
def test_something_on_the_robot_itself_does_not_let_it_closer_to_anything_else(cable: tuple[float, float]) -> None:
    for wall_m in (0.40, 0.44, 0.50):
        ahead = [(wall_m, y) for y in np.linspace(-0.5, 0.5, 41)]
        with_cable, _ = limit(things(cable, *ahead), AHEAD, LIMITS, STILL)
        without, _ = limit(things(*ahead), AHEAD, LIMITS, STILL)
        assert with_cable.v <= without.v
    assert limit(things(cable), Twist(-0.1, 0.0), LIMITS, STILL)[0].v >= -CRAWL
