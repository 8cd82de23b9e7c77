from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from calibration.mounting import LidarMount
from ghal360_robot.messages import LidarScan, Surroundings, Twist
from ghal360_robot.safety.footprint import Disc
from ghal360_robot.safety.view import out_of_sight, scan_fault, view_ahead
from ghal360_robot.surroundings import look_around
from tests.safety.conftest import YAW, around, scan

ROUND = (Disc(0.0, 0.0, 0.4),)
LONG = (Disc(0.0, 0.0, 0.3), Disc(-0.5, 0.0, 0.3))
WHOLE = around(scan(3.0))


def ranges(default: float, **parts: float) -> np.ndarray:
    """A scan whose first, `n`th.. beams are others: `at_400_10=0.1` sets ten beams from the 400th on."""
    values = np.full(811, default, np.float32)
    for name, value in parts.items():
        _, first, count = name.split("_")
        values[int(first) : int(first) + int(count)] = value
    return values


def blind_ahead(around: Surroundings) -> str:
    return view_ahead(around)[0]


def silent_ahead(around: Surroundings) -> str:
    return view_ahead(around)[1]


def test_a_scan_that_sees_something_says_something() -> None:
    assert scan_fault(WHOLE, ROUND) == ""


@pytest.mark.parametrize(("seen", "fault"), [(40, "lidar sees nothing: covered?"), (41, "")])
def test_a_lidar_that_gets_hardly_any_beam_back_is_covered(seen: int, fault: str) -> None:
    assert scan_fault(around(scan(ranges(np.nan, **{f"at_300_{seen}": 3.0}))), ROUND) == fault


@pytest.mark.parametrize(("beams", "fault"), [(15, "the scan has too few beams"), (16, "")])
def test_a_scan_of_a_few_beams_is_none(beams: int, fault: str) -> None:
    some = LidarScan(0, np.full(beams, 3.0, np.float32), YAW[:beams], 0, 0, 0)
    assert scan_fault(look_around(some, LidarMount()), ROUND) == fault


@pytest.mark.parametrize(("beams", "dirty"), [(24, False), (25, True)])
def test_returns_from_inside_the_outline_are_dirt_on_the_window(beams: int, dirty: bool) -> None:
    near = around(scan(ranges(3.0, **{f"at_400_{beams}": 0.1})))
    said = "lidar sees something on the robot itself: is its window dirty?" if dirty else ""
    assert scan_fault(near, ROUND) == said
    assert scan_fault(near, (*ROUND, Disc(-0.5, 0.0, 0.3))) == said
    assert scan_fault(near, (Disc(0.3, 0.2, 0.4),)) == said
    assert scan_fault(near, (Disc(0.3, 0.5, 0.4),)) == ""
    aside = around(scan(ranges(3.0, **{f"at_480_{beams}": 0.3})))  # 25 to 33 degrees to the left
    assert scan_fault(aside, (Disc(0.46, 0.35, 0.3),)) == said
    assert scan_fault(around(scan(ranges(3.0, at_400_100=0.16))), ROUND) == ""  # within 5 cm of the rim
    assert scan_fault(near, (Disc(-0.5, 0.0, 0.3),)) == ""
    assert ("window dirty" in scan_fault(near, (Disc(-0.5, 0.0, 0.3), *ROUND))) is dirty
    assert scan_fault(near, (Disc(0.3, 0.0, 0.04),)) == ""


def test_dirt_is_looked_for_as_far_as_the_outline_reaches_from_the_lidar() -> None:
    mount = LidarMount(x=0.2, y=0.2)
    ahead_right = Disc(0.6, -0.1, 0.2)  # 0.5 m from the lidar, at -37 degrees: beam 294 of 811
    seen = look_around(scan(ranges(3.0, at_280_28=0.63)), mount)
    assert "window dirty" in scan_fault(seen, (ahead_right,))


def test_shares_are_counted_to_the_beam() -> None:
    yaw = np.linspace(-0.8, 0.8, 100).astype(np.float32)
    seen = np.full(100, np.nan, np.float32)
    seen[:5] = 3.0
    assert scan_fault(look_around(LidarScan(0, seen, yaw, 0, 0, 0), LidarMount()), ROUND) == ""
    seen[:] = 3.0
    seen[50:53] = 0.1
    assert scan_fault(look_around(LidarScan(0, seen, yaw, 0, 0, 0), LidarMount()), ROUND) == ""
    values = ranges(np.nan, at_0_150=2.0, at_661_150=2.0, at_400_15=2.0)
    assert blind_ahead(around(scan(values))) == ""


def test_a_scan_that_looks_elsewhere_says_nothing_about_the_way_ahead() -> None:
    elsewhere = "the scan does not cover the way ahead"
    assert blind_ahead(WHOLE) == ""
    assert blind_ahead(replace(WHOLE, bearings=WHOLE.bearings + math.pi)) == elsewhere
    for half in (WHOLE.bearings < 0, WHOLE.bearings > 0, np.abs(WHOLE.bearings) > 2.0):
        assert blind_ahead(replace(WHOLE, bearings=WHOLE.bearings[half], ranges=WHOLE.ranges[half])) == elsewhere
    enough = np.abs(WHOLE.bearings) < math.radians(46)
    assert blind_ahead(replace(WHOLE, bearings=WHOLE.bearings[enough], ranges=WHOLE.ranges[enough])) == ""


def test_echoes_beside_and_behind_do_not_make_up_for_none_ahead() -> None:
    values = ranges(np.nan, at_0_150=2.0, at_661_150=2.0)
    assert blind_ahead(around(scan(values))) == "lidar sees nothing ahead: covered?"
    values[400:414] = 2.0  # of 300 beams within 50 degrees
    assert blind_ahead(around(scan(values))) == "lidar sees nothing ahead: covered?"
    values[400:416] = 2.0
    assert blind_ahead(around(scan(values))) == ""


@pytest.mark.parametrize("mount", [LidarMount(), LidarMount(yaw=0.3), LidarMount(yaw=0.3, upside_down=True)])
@pytest.mark.parametrize("place", ["first", "middle", "last"])
def test_a_wide_stretch_without_an_echo_ahead_is_said(mount: LidarMount, place: str) -> None:
    ahead = np.flatnonzero(np.abs(look_around(scan(3.0), mount).bearings) <= math.radians(50))
    widest = math.ceil(math.radians(20.0) / (math.radians(270) / 810) - 1e-4) - 1
    for silent, said in ((widest, ""), (widest + 1, "slow: lidar gets no echo over 20 deg ahead")):
        begin = {"first": ahead[0], "middle": ahead[100], "last": ahead[-1] + 1 - silent}[place]
        values = np.full(811, 3.0, np.float32)
        values[begin : begin + silent] = np.nan
        assert silent_ahead(look_around(scan(values), mount)) == said
        values[begin + silent // 2] = 3.0
        assert silent_ahead(look_around(scan(values), mount)) == ""
    beyond = np.full(811, 3.0, np.float32)
    beyond[: ahead[0]] = beyond[ahead[-1] + 1 :] = np.nan
    assert silent_ahead(look_around(scan(beyond), mount)) == ""


@pytest.mark.parametrize("twist", [Twist(0.5, 0.0), Twist(0.2, 0.8), Twist(0.2, -0.8), Twist(0.0, 0.8)])
def test_forwards_and_turning_a_round_robot_goes_where_its_lidar_looks(twist: Twist) -> None:
    assert out_of_sight(WHOLE, twist, [(ROUND[0], 0.3)]) == []


def test_backwards_it_goes_where_the_lidar_is_blind() -> None:
    hidden = out_of_sight(WHOLE, Twist(-0.1, 0.0), [(ROUND[0], 0.1)])
    assert (pytest.approx(-0.6), pytest.approx(0.0, abs=1e-9)) in hidden
    assert all(x < -0.25 for x, _ in hidden)
    assert all(abs(math.atan2(y, x - 0.2)) > math.radians(135) for x, y in hidden)
    assert all(math.hypot(x, y) > 0.4 for x, y in hidden)


def test_what_the_robot_stands_on_need_not_be_seen() -> None:
    backwards = Twist(-0.1, 0.0)
    assert len(out_of_sight(WHOLE, backwards, [(ROUND[0], 0.0)])) == 5
    shadowed = (*ROUND, Disc(-0.35, 0.0, 0.4))
    hidden = out_of_sight(WHOLE, backwards, [(disc, 0.0) for disc in shadowed])
    assert hidden
    assert all(math.hypot(x + 0.35, y) > 0.45 for x, y in hidden)
    assert out_of_sight(WHOLE, backwards, [(ROUND[0], -0.049)]) == [(pytest.approx(-0.451), pytest.approx(0.0))]
    assert out_of_sight(WHOLE, backwards, [(ROUND[0], -0.051)]) == []


def test_the_slowest_motion_that_counts_is_looked_after() -> None:
    assert out_of_sight(WHOLE, Twist(-1e-4, 0.0), [(ROUND[0], 0.1)]) != []
    assert out_of_sight(WHOLE, Twist(-9e-5, 0.0), [(ROUND[0], 0.1)]) == []


def expected(seen: Surroundings, twist: Twist, parts: list[tuple[Disc, float]], within: float) -> list[complex]:
    """The same with complex numbers, for a lidar that sees `within` radians to either side."""
    hidden = []
    for disc, way_m in parts:
        velocity = complex(twist.v - twist.w * disc.y, twist.w * disc.x)
        unit = velocity / abs(velocity)
        for degrees in (-75, -50, -25, 0, 25, 50, 75):
            turn = complex(math.cos(math.radians(degrees)), math.sin(math.radians(degrees)))
            at = complex(disc.x, disc.y) + unit * (way_m + 0.1 + disc.radius * turn)
            sight = at - complex(*seen.origin)
            own = any(abs(at - complex(d.x, d.y)) <= d.radius + 0.05 for d, _ in parts)
            if abs(math.atan2(sight.imag, sight.real)) > within and not own:
                hidden.append(at)
    return hidden


@pytest.mark.parametrize("mount", [LidarMount(x=0.1, y=0.05), LidarMount(x=-0.1, y=-0.2), LidarMount(x=0.0, y=0.0)])
@pytest.mark.parametrize(
    "twist", [Twist(0.3, 0.0), Twist(0.2, 0.5), Twist(0.2, -0.5), Twist(0.0, 0.6), Twist(-0.1, 0.1)]
)
def test_what_is_hidden_from_a_lidar_that_sees_little(mount: LidarMount, twist: Twist) -> None:
    yaw = np.radians(np.linspace(-40, 40, 17)).astype(np.float32)
    seen = look_around(LidarScan(0, np.full(17, 3.0, np.float32), yaw, 0, 0, 0), mount)
    for way_m in np.arange(-0.05, 0.6, 0.01):
        parts = [(Disc(0.05, 0.1, 0.3), way_m), (Disc(-0.2, -0.15, 0.2), way_m / 2)]
        found = [complex(x, y) for x, y in out_of_sight(seen, twist, parts)]
        assert found == pytest.approx(expected(seen, twist, parts, math.radians(40)))


def test_a_long_robot_sweeps_blind_ground_when_it_turns() -> None:
    left = out_of_sight(WHOLE, Twist(0.0, 0.5), [(disc, 0.1) for disc in LONG])
    right = out_of_sight(WHOLE, Twist(0.0, -0.5), [(disc, 0.1) for disc in LONG])
    assert left
    assert all(y < 0 for _, y in left)
    assert np.array(right) * (1, -1) == pytest.approx(np.array(left)[::-1])


@pytest.mark.parametrize("mount", [LidarMount(upside_down=True), LidarMount(yaw=0.1), LidarMount(x=-0.2)])
def test_what_is_in_sight_follows_the_mounting(mount: LidarMount) -> None:
    seen = look_around(scan(3.0), mount)
    assert out_of_sight(seen, Twist(0.5, 0.0), [(ROUND[0], 0.3)]) == []
    assert out_of_sight(seen, Twist(-0.1, 0.0), [(ROUND[0], 0.1)]) != []


def test_a_lidar_that_looks_backwards_lets_the_robot_back_and_not_drive() -> None:
    seen = look_around(scan(3.0), LidarMount(x=-0.2, yaw=math.pi))
    assert out_of_sight(seen, Twist(-0.1, 0.0), [(ROUND[0], 0.1)]) == []
    assert out_of_sight(seen, Twist(0.1, 0.0), [(ROUND[0], 0.1)]) != []


@pytest.mark.parametrize(
    ("from_deg", "wide_deg", "said"), [(-10, 21, True), (-10, 19, False), (35, 30, False), (28, 30, True)]
)
def test_a_wide_stretch_without_echo_ahead_is_said(from_deg: float, wide_deg: float, said: bool) -> None:
    yaw = np.radians(np.linspace(-135, 135, 811)).astype(np.float32)
    ranges = np.full(811, 3.0, np.float32)
    degrees = np.degrees(yaw)
    ranges[(degrees > from_deg) & (degrees < from_deg + wide_deg)] = np.nan
    around = look_around(LidarScan(0, ranges, yaw, 0, 0, 0), LidarMount())
    assert bool(silent_ahead(around)) is said
    assert not blind_ahead(around)


def test_a_scan_too_coarse_to_show_a_leg_is_no_scan() -> None:
    yaw = np.radians(np.linspace(-135, 135, 100)).astype(np.float32)
    around = look_around(LidarScan(0, np.full(100, 3.0, np.float32), yaw, 0, 0, 0), LidarMount())
    assert scan_fault(around, ROUND) == "the scan has too few beams"
