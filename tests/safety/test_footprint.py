"""Contacts against a brute-force simulation of the motion in small steps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ghal360_robot.messages import Pose2, Twist
from ghal360_robot.safety.footprint import NEVER, Contact, Disc, disc_velocity, first_contacts
from ghal360_robot.simulation.plant import advance

CENTRE = Disc(0.0, 0.0, 0.4)
BACK = Disc(-0.3, 0.1, 0.2)


def contact(x: float, y: float, twist: Twist, disc: Disc = CENTRE, radius: float = 0.5) -> Contact:
    return first_contacts(np.array([[x, y]]), twist, disc, (radius,))[0]


def apart(x: float, y: float, twist: Twist, disc: Disc, seconds: float) -> float:
    """Distance of a point from the disc's centre after `seconds` of the twist."""
    pose = advance(Pose2(), twist, seconds)
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return math.hypot(x - pose.x - c * disc.x + s * disc.y, y - pose.y - s * disc.x - c * disc.y)


def test_a_point_straight_ahead_is_met_after_its_distance_less_the_radius() -> None:
    assert contact(1.6, 0.0, Twist(0.5, 0.0)).seconds == pytest.approx(2.2)
    assert contact(-1.6, 0.0, Twist(-0.1, 0.0)).seconds == pytest.approx(11.0)
    assert contact(1.6, 0.3, Twist(0.5, 0.0)).seconds == pytest.approx((1.6 - 0.4) / 0.5)


def test_a_disc_beside_the_origin_meets_what_is_in_front_of_it() -> None:
    left = Disc(0.1, 0.3, 0.2)
    assert contact(1.0, 0.3, Twist(0.5, 0.0), left, 0.2).seconds == pytest.approx((0.9 - 0.2) / 0.5)
    assert contact(-1.0, 0.3, Twist(-0.5, 0.0), left, 0.2).seconds == pytest.approx((1.1 - 0.2) / 0.5)
    assert contact(1.0, -0.3, Twist(0.5, 0.0), left, 0.2) == NEVER


@pytest.mark.parametrize("at", [(1.0, 0.5), (1.0, -0.5), (1.0, 0.6), (-1.0, 0.0)])
def test_a_point_beside_or_behind_is_never_met(at: tuple[float, float]) -> None:
    assert contact(*at, Twist(0.5, 0.0)) == NEVER


def test_an_arc_sweeps_where_it_leads_and_not_straight_ahead() -> None:
    left_turn = Twist(0.4, 0.8)
    assert contact(1.6, 0.0, left_turn) == NEVER
    # About the centre (0, 0.5): the point is at 0.9 m, the disc at 0.5 m, half a turn before it.
    assert contact(0.0, 1.4, left_turn).seconds == pytest.approx((math.pi - math.acos(0.9)) / 0.8)
    assert contact(0.0, 1.5, left_turn) == NEVER


def test_a_disc_in_the_middle_sweeps_nothing_when_it_turns_and_one_beside_does() -> None:
    turn = Twist(0.0, 0.5)
    assert contact(0.45, 0.0, turn) == NEVER
    assert contact(0.0, -0.5, turn, Disc(-0.5, 0.0, 0.2), 0.2).seconds == pytest.approx(
        (math.pi / 2 - 2 * math.asin(0.2)) / 0.5
    )
    assert contact(0.0, -0.5, Twist(0.0, -0.5), Disc(-0.5, 0.0, 0.2), 0.2).seconds == pytest.approx(
        (3 * math.pi / 2 - 2 * math.asin(0.2)) / 0.5
    )


def test_what_is_inside_already_is_met_at_once_unless_the_disc_moves_off_it() -> None:
    assert contact(0.3, 0.1, Twist(0.5, 0.0)).seconds == 0.0
    assert contact(-0.3, 0.1, Twist(0.5, 0.0)) == NEVER
    assert contact(0.3, 0.1, Twist(0.5, 0.4)).seconds == 0.0
    assert contact(-0.3, 0.1, Twist(0.5, 0.4)).seconds > 10.0  # once around
    assert contact(0.0, 0.1, Twist(0.3, 0.5)).seconds == 0.0  # neither before the middle nor behind it
    assert contact(-0.3, 0.0, Twist(-0.1, 0.0)).seconds == 0.0


def test_nothing_is_met_by_a_disc_that_stands_or_in_an_empty_world() -> None:
    assert contact(0.1, 0.0, Twist(0.0, 0.0)) == NEVER
    assert contact(0.1, 0.0, Twist(9e-5, 0.0)) == NEVER
    assert first_contacts(np.zeros((0, 2)), Twist(0.5, 0.0), CENTRE, (0.4, 0.5)) == (NEVER, NEVER)
    assert first_contacts(np.zeros((0, 2)), Twist(0.5, 0.5), CENTRE, (0.4,)) == (NEVER,)


def test_the_first_of_many_is_named_for_each_radius() -> None:
    points = np.array([[2.0, 0.0], [1.5, 0.45], [1.2, 0.0], [0.9, 2.0]])
    tight, wide = first_contacts(points, Twist(0.5, 0.0), CENTRE, (0.4, 1.0))
    assert (tight.point, wide.point) == (2, 2)
    tight, wide = first_contacts(points[:2], Twist(0.5, 0.0), CENTRE, (0.4, 0.9))
    assert (tight.point, wide.point) == (0, 1)
    tight, wide = first_contacts(points[[3, 1]], Twist(0.5, 0.2), CENTRE, (0.2, 0.6))
    assert tight.seconds > wide.seconds
    assert wide.point == 1


def test_a_disc_as_big_as_its_way_around_covers_the_middle_for_ever() -> None:
    assert contact(0.0, 0.25, Twist(0.1, 0.4)).seconds == 0.0  # the centre it turns about, half a metre deep inside


def test_grazing_is_not_touching() -> None:
    straight = first_contacts(np.array([[1.0, 0.5]]), Twist(0.5, 0.0), CENTRE, (0.5, 0.6))
    assert straight[0] == NEVER
    assert straight[1].point == 0
    arc = first_contacts(np.array([[0.0, 1.5]]), Twist(0.4, 0.8), CENTRE, (0.5, 0.6))
    assert arc[0] == NEVER
    assert arc[1].point == 0


def test_the_slowest_motion_that_counts_is_a_tenth_of_a_millimetre_a_second() -> None:
    assert contact(0.6, 0.0, Twist(1e-4, 0.0)).seconds == pytest.approx(1000.0)


def test_the_velocity_of_a_disc_is_that_of_a_point_of_a_turning_body() -> None:
    assert disc_velocity(BACK, Twist(0.4, 0.5)) == pytest.approx((0.4 - 0.05, -0.15))


def test_a_hardly_curved_arc_is_as_long_as_a_straight_line() -> None:
    straight = contact(1.6, 0.2, Twist(0.5, 0.0)).seconds
    for w in (1e-3, 6e-5, 4e-5, -4e-5, -6e-5):
        assert contact(1.6, 0.2, Twist(0.5, w)).seconds == pytest.approx(straight, abs=5e-3)
    assert contact(1.6, 0.2, Twist(0.5, 6e-5)).seconds == pytest.approx(straight, abs=1e-3)


coordinates = st.floats(-2.0, 2.0)
discs = st.builds(Disc, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(0.1, 0.5))
twists = st.builds(Twist, st.floats(-0.5, 0.5), st.floats(-1.0, 1.0))


@given(coordinates, coordinates, twists, discs)
def test_contact_is_when_the_distance_first_falls_to_the_radius(x: float, y: float, twist: Twist, disc: Disc) -> None:
    speed = math.hypot(*disc_velocity(disc, twist))
    now = math.hypot(x - disc.x, y - disc.y)
    assume(speed > 0.01)
    assume(now > disc.radius + 1e-6)
    (met,) = first_contacts(np.array([[x, y]]), twist, disc, (disc.radius,))
    horizon = min(met.seconds, 6.0)
    times = np.linspace(0.0, horizon, 60)[:-1]
    assert all(apart(x, y, twist, disc, t) > disc.radius - 1e-6 for t in times)
    if met.seconds < 6.0:
        assert apart(x, y, twist, disc, met.seconds) == pytest.approx(disc.radius, abs=1e-4)
        assert apart(x, y, twist, disc, met.seconds + 1e-3) < disc.radius + 1e-6
        assert met.point == 0


@given(st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=8), twists, discs)
def test_many_points_are_met_as_the_first_of_them(points: list[tuple[float, float]], twist: Twist, disc: Disc) -> None:
    (met,) = first_contacts(np.array(points), twist, disc, (disc.radius,))
    each = [first_contacts(np.array([p]), twist, disc, (disc.radius,))[0].seconds for p in points]
    assert met.seconds == pytest.approx(min(each))
    assert met.point is None or each[met.point] == pytest.approx(min(each))
