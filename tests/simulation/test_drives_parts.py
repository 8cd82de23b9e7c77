"""What a drive is made of besides people: a lidar that sweeps, a base behind its wire, a driver without manners."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.tim571.geometry import BEAM_YAW
from ghal360_robot.intent.controller import DriveSettings
from ghal360_robot.messages import STILL, BaseMode, Pose2, Twist
from ghal360_robot.simulation.lidar_sweep import NOISE_M, STEP_NS, Sweep, SweepingLidar, circle_ranges, within
from ghal360_robot.simulation.plant import advance
from ghal360_robot.simulation.random_driver import IMPATIENT_S, STYLES, RandomDriver, Style, Wish
from ghal360_robot.simulation.raycast import Shapes
from ghal360_robot.simulation.rooms import CEILING_M
from ghal360_robot.simulation.view import LIDAR_AHEAD_M
from ghal360_robot.simulation.walking_ground import Ground
from ghal360_robot.simulation.wired_base import WiredBase
from ghal360_robot.simulation.world import World, build_world

NOBODY: NDArray[np.float64] = np.zeros((0, 3))
POINTS: NDArray[np.float64] = np.zeros((0, 2))


@cache
def world() -> World:
    return build_world("home", 3)


@cache
def ground() -> Ground:
    return Ground(world())


def swept(seconds: float, circles: NDArray[np.float64] = NOBODY, turn: float = 0.0) -> list[tuple[int, Sweep]]:
    """Sweeps with the instant at which each was given out, while the robot turns at its start."""
    lidar = SweepingLidar(world(), np.random.default_rng(1))
    start, out = world().start, []
    for k in range(1, round(seconds * 1e9 / STEP_NS) + 1):
        now_ns = k * STEP_NS
        pose = Pose2(start.x, start.y, start.yaw + turn * now_ns / 1e9)
        sweep = lidar.step(now_ns, pose, lambda: circles)
        if sweep is not None:
            out.append((now_ns, sweep))
    return out


def true_ranges(yaw: float) -> NDArray[np.float64]:
    start = world().start
    x, y = start.x + LIDAR_AHEAD_M * math.cos(yaw), start.y + LIDAR_AHEAD_M * math.sin(yaw)
    return world().ranges(x, y, yaw + np.asarray(BEAM_YAW, float))


def test_sweeps_come_fifteen_times_a_second_and_ten_milliseconds_after_their_last_beam() -> None:
    sweeps = swept(10.0)
    assert 149 <= len(sweeps) <= 150
    assert {now_ns - sweep.scan.stamp_ns for now_ns, sweep in sweeps} == {10_000_000}
    numbers = [sweep.scan.scan_counter for _, sweep in sweeps]
    assert numbers == list(range(len(numbers)))


def test_a_standing_robot_sees_the_world_with_the_noise_of_the_device() -> None:
    errors = np.concatenate([sweep.scan.ranges - true_ranges(world().start.yaw) for _, sweep in swept(2.0)])
    assert np.abs(np.nanmean(errors)) < 0.001
    assert np.nanstd(errors) == pytest.approx(NOISE_M, rel=0.05)


def test_a_turning_robot_sees_each_part_of_a_sweep_from_another_yaw() -> None:
    turn = 0.8
    _, sweep = swept(1.0, turn=turn)[-1]
    yaw_at_end = world().start.yaw + turn * sweep.scan.stamp_ns / 1e9
    wrong = np.abs(sweep.scan.ranges - true_ranges(yaw_at_end))
    right_end, right_start = wrong[-100:], np.abs(sweep.scan.ranges - true_ranges(yaw_at_end - turn * 0.04))[:100]
    assert np.median(right_end) < 2 * NOISE_M
    assert np.median(right_start) < 2 * NOISE_M


def test_a_leg_is_seen_where_it_stands_and_its_beams_are_counted() -> None:
    start = world().start
    far = 0.9
    x, y = (start.x + far * math.cos(start.yaw), start.y + far * math.sin(start.yaw))
    behind = (start.x - far * math.cos(start.yaw), start.y - far * math.sin(start.yaw))
    _, sweep = swept(0.3, np.array([[x, y, 0.07], [*behind, 0.07]]))[-1]
    middle = len(BEAM_YAW) // 2
    assert sweep.scan.ranges[middle - 2 : middle + 3].mean() == pytest.approx(far - LIDAR_AHEAD_M - 0.07, abs=0.03)
    expected = 2 * math.degrees(math.asin(0.07 / (far - LIDAR_AHEAD_M))) * 3
    assert sweep.beams_on[0] == pytest.approx(expected, abs=2)
    assert sweep.beams_on[1] == 0, "the lidar is blind behind"


def test_leaving_out_what_a_sector_cannot_meet_changes_no_range() -> None:
    solid = (item for item in world().objects if item.solid)
    shapes = Shapes.of(solid, world().plan.wall_boxes(), CEILING_M)
    rng, kept = np.random.default_rng(2), 0
    for _ in range(60):
        x, y = ground().draw(rng)
        yaw = rng.uniform(-math.pi, math.pi) + np.linspace(0.0, math.radians(54), 80)
        fewer = within(shapes, x, y, yaw)
        kept += len(fewer.boxes)
        assert np.array_equal(fewer.ranges(x, y, yaw), world().ranges(x, y, yaw))
    assert kept < 0.6 * 60 * len(shapes.boxes)


def test_rays_meet_the_near_side_of_circles_and_miss_those_behind() -> None:
    circles = np.array([[2.0, 0.0, 0.5], [-2.0, 0.0, 0.5], [0.1, 0.0, 0.5]])
    ranges = circle_ranges(0.0, 0.0, np.array([0.0, math.pi, math.pi / 2]), circles)
    assert ranges[0].tolist() == pytest.approx([1.5, math.inf, 0.0])
    assert ranges[1].tolist() == pytest.approx([math.inf, 1.5, 0.0])
    assert ranges[2, :2].tolist() == [math.inf, math.inf]


def test_odometry_of_the_wired_base_follows_the_body() -> None:
    base = WiredBase(0.5, 0.8)
    body, now_ns, armed_ns = Pose2(), 0, None
    rng = np.random.default_rng(4)
    twist = STILL
    for k in range(1500):
        if k % 60 == 0:
            twist = Twist(float(rng.uniform(-0.3, 0.5)), float(rng.uniform(-0.8, 0.8)))
        state = base.exchange(now_ns, twist, drive=now_ns > 500_000_000)
        if state.mode is BaseMode.DRIVE and armed_ns is None:
            armed_ns = now_ns
        for _ in range(2):
            now_ns += STEP_NS
            base.model.step(now_ns)
            body = advance(body, base.twist, STEP_NS / 1e9)
    assert armed_ns is not None
    assert 40_000_000 <= armed_ns - 500_000_000 <= 80_000_000
    assert state.faults == ()
    assert math.hypot(body.x - state.pose.x, body.y - state.pose.y) < 0.02
    assert math.hypot(body.x, body.y) > 0.5


def test_wrong_tyres_make_odometry_wrong_by_as_much() -> None:
    base, now_ns, x = WiredBase(0.5, 0.8, tyre=1.01), 0, 0.0
    for _ in range(500):
        state = base.exchange(now_ns, Twist(0.4, 0.0), drive=True)
        for _ in range(2):
            now_ns += STEP_NS
            base.model.step(now_ns)
            x += base.twist.v * STEP_NS / 1e9
    assert x > 3.0
    assert state.pose.x / x == pytest.approx(1.01, abs=0.004)


def test_a_base_that_is_not_to_drive_stops_and_goes_to_standby() -> None:
    base = WiredBase(0.5, 0.8)
    now_ns, modes = 0, []
    for k in range(300):
        state = base.exchange(now_ns, Twist(0.4, 0.0), drive=20 < k < 150)
        modes.append(state.mode)
        now_ns += 2 * STEP_NS
        base.model.step(now_ns)
    assert modes[140] is BaseMode.DRIVE
    assert modes[-1] is BaseMode.STANDBY
    assert base.twist == STILL


def wishes(style: Style, seconds: float, *, moves: bool) -> list[Wish]:
    driver = RandomDriver(ground(), 11, style, DriveSettings())
    pose, out = world().start, []
    for k in range(round(seconds * 15)):
        out.append(driver.step(k / 15, pose, POINTS))
        if moves and out[-1].finite:
            pose = advance(pose, Twist(0.0, 0.5), 1 / 15)
    return out


@pytest.mark.parametrize("style", STYLES)
def test_drivers_ask_for_everything_and_for_nonsense(style: Style) -> None:
    # On the way to a place they have a whim every twelfth time only.
    asked = wishes(style, 600.0 if style.endswith("places") else 240.0, moves=True)
    finite = [wish.twist for wish in asked if wish.finite]
    assert any(not wish.finite for wish in asked)
    assert any(not wish.deadman for wish in asked)
    assert {math.copysign(1.0, twist.v) for twist in finite if twist.v} == {1.0, -1.0}
    assert any(twist.v == 0.0 and twist.w for twist in finite)
    assert sum(wish.motion for wish in asked) > 0.8 * len(asked)


def test_a_driver_whose_robot_stands_tries_turns_and_reverse() -> None:
    asked = wishes("stick", 20.0, moves=False)
    late = {wish.twist for wish in asked[round((IMPATIENT_S + 3.0) * 15) :] if wish.finite}
    assert any(twist.v == 0.0 and twist.w != 0.0 for twist in late)
    assert any(twist.v < 0.0 for twist in late)
