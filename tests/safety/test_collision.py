from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ghal360_robot.messages import STILL, Pose2, Twist
from ghal360_robot.safety.chain import Safety
from ghal360_robot.safety.collision import direction, watch
from ghal360_robot.safety.footprint import Disc
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.memory import Memory
from tests.safety.conftest import LIDAR_X, Rig, circles_ranges, scan

BACK = Twist(-0.15, 0.0)


def posts(*at: tuple[float, float], radius: float = 0.05) -> Rig:
    circles = np.array([(x, y, radius) for x, y in at])
    return Rig(seen=lambda pose: circles_ranges(pose, circles))


@pytest.mark.parametrize(
    ("degrees", "words"),
    [(0, "ahead"), (10, "ahead"), (-10, "ahead"), (11, "11 deg left"), (-30, "30 deg right"), (180, "180 deg left")],
)
def test_directions_are_words(degrees: float, words: str) -> None:
    assert direction(math.radians(degrees)) == words


@pytest.mark.parametrize("without", ["base", "surroundings"])
def test_nothing_is_judged_before_base_and_lidar_have_spoken(without: str) -> None:
    rig = Rig()
    rig.run(5)
    tick, memory = rig.inputs(), rig.state.memory
    assert not isinstance(watch(SafetyLimits(), memory, tick, "", 0.0), str)
    assert watch(SafetyLimits(), memory, replace(tick, **{without: None}), "", 0.0) == "no scan"
    assert watch(SafetyLimits(), Memory(), tick, "", 0.0) == "no scan"


def test_an_obstacle_on_the_way_is_named_with_distance_and_direction() -> None:
    rig = posts((0.9, 0.2))
    out = rig.run(60, Twist(0.5, 0.0))
    assert out[40].reasons[0] == "slowed: obstacle 0.3 m, 14 deg left"
    out = rig.run(200, Twist(0.5, 0.0))
    assert out[-1].twist == STILL
    assert out[-1].reasons == ("stopped: obstacle 0.1 m, 19 deg left",)
    assert out[-1].clearance_m == pytest.approx(0.12, abs=0.02)


def test_what_is_too_close_to_name_a_way_to_it_is_close_by() -> None:
    rig = posts((-0.02, 0.43), radius=0.02)
    assert "slowed: obstacle, close by" in rig.run(8, Twist(0.5, 0.0))[-1].reasons


def test_a_turn_is_slowed_or_stopped_by_name_as_well() -> None:
    limits = SafetyLimits(footprint=(Disc(0.0, 0.0, 0.3), Disc(0.3, 0.0, 0.3)))
    rig = Rig(Safety(limits), seen=lambda pose: circles_ranges(pose, np.array([[0.3, 0.55, 0.02]])))
    out = rig.run(200, Twist(0.0, 0.8))
    words = [reason.split(":")[0] for applied in out for reason in applied.reasons if "obstacle" in reason]
    assert words[0] == "slowed"
    assert words[-1] == "stopped"
    assert out[-1].twist == STILL
    assert out[-1].reasons[0].startswith("stopped: obstacle 0.1 m, ")


def test_a_curve_into_an_obstacle_goes_on_as_a_turn() -> None:
    rig = posts((0.75, 0.1))
    out = rig.run(200, Twist(0.2, 0.3))
    assert out[-1].twist.w == pytest.approx(0.3)


def test_nobody_but_a_hand_on_the_stick_backs_into_what_the_lidar_does_not_see() -> None:
    rig = Rig()
    rig.run(60, Twist(0.5, 0.0))
    rig.run(60, STILL)
    refused = rig.tick(BACK)
    assert refused.twist == STILL
    assert refused.reasons == ("backwards: lidar is blind there",)
    assert rig.tick(Twist(-0.1, 0.3)).twist.w > 0.0
    assert rig.tick(Twist(-0.1, 0.3)).twist.v == 0.0
    backing = [rig.stick(BACK) for _ in range(30)]
    assert backing[-1].twist == BACK
    assert backing[-1].reasons == ()


def test_the_stick_backs_over_ground_driven_lately_and_no_further() -> None:
    rig = Rig()
    rig.run(45, Twist(0.5, 0.0))
    rig.run(40, STILL)
    driven_m = rig.pose.x
    out = [rig.stick(BACK) for _ in range(300)]
    assert out[-1].twist == STILL
    assert out[-1].reasons == ("backwards: lidar is blind there, and has not seen it lately",)
    assert driven_m - rig.pose.x > 0.05
    assert rig.pose.x > -0.01


def test_ground_driven_long_ago_is_not_backed_onto() -> None:
    rig = Rig()
    rig.run(60, Twist(0.5, 0.0))
    rig.run(320, STILL)
    assert rig.stick(BACK).reasons == ("backwards: lidar is blind there, and has not seen it lately",)


def test_nobody_backs_up_where_somebody_was_about_since_the_ground_was_seen() -> None:
    rig = Rig()
    rig.run(60, Twist(0.5, 0.0))
    rig.run(60, STILL)
    memory, now_ns = rig.state.memory, rig.n * 20_000_000
    assert memory.scene is not None
    rig.state = replace(rig.state, memory=replace(memory, someone_ns=now_ns - 4_900_000_000))
    assert rig.stick(BACK).reasons == ("backwards: lidar is blind there, and somebody is about",)
    rig.state = replace(rig.state, memory=replace(memory, someone_ns=now_ns - 5_200_000_000))
    assert rig.stick(BACK).twist.v < 0.0
    rig.state = replace(rig.state, memory=replace(memory, someone_ns=None))
    assert rig.stick(BACK).twist.v < 0.0


@pytest.mark.parametrize("disc", [Disc(0.2, 0.0, 0.4), Disc(0.0, 0.2, 0.4), Disc(0.0, 0.05, 0.4)])
def test_only_what_the_outline_surely_covered_counts_as_driven_over(disc: Disc) -> None:
    rig = Rig(Safety(SafetyLimits(footprint=(disc,))))
    rig.run(60, Twist(0.5, 0.0))
    rig.run(60, STILL)
    rig.state = replace(rig.state, memory=replace(rig.state.memory, looks=(), past=()))
    assert rig.stick(BACK).reasons == ("backwards: lidar is blind there, and has not seen it lately",)


def test_a_robot_that_is_longer_behind_turns_only_over_ground_it_knows() -> None:
    footprint = (Disc(0.0, 0.0, 0.3), Disc(-0.25, 0.0, 0.3), Disc(-0.5, 0.0, 0.3))
    rig = Rig(Safety(SafetyLimits(footprint=footprint)))
    out = rig.run(10, Twist(0.0, 0.5))
    assert out[-1].reasons == ("turning: lidar is blind there, and has not seen it lately",)
    assert out[-1].twist == STILL
    assert rig.tick(Twist(0.05, 0.5)).reasons[0].startswith("curve: lidar is blind there")
    assert rig.run(10, Twist(0.2, 0.0))[-1].twist.v > 0.0
    rig.run(100, Twist(0.5, 0.0))
    rig.run(60, STILL)
    assert rig.run(10, Twist(0.0, 0.5))[-1].twist.w > 0.0


LONG = Safety(SafetyLimits(footprint=(Disc(0.0, 0.0, 0.3), Disc(-0.25, 0.0, 0.3), Disc(-0.5, 0.0, 0.3))))


def test_what_is_left_of_a_motion_is_looked_at_for_blind_ground_again() -> None:
    rig = Rig(LONG, seen=lambda pose: circles_ranges(pose, np.array([[0.42, 0.0, 0.05]])))
    rig.run(3)
    refused = rig.tick(Twist(0.3, 0.1))
    assert refused.twist == STILL
    assert refused.reasons[0].startswith("stopped: obstacle 0.0 m")
    assert refused.reasons[1] == "turning: lidar is blind there, and has not seen it lately"


def test_without_echoes_ahead_a_long_robot_does_not_turn_over_blind_ground_either() -> None:
    aside = np.full(811, np.nan)
    aside[:200] = 2.0
    rig = Rig(LONG, seen=aside)
    out = rig.run(5, Twist(0.3, 0.4))
    assert out[-1].twist == STILL
    assert out[-1].reasons == ("lidar sees nothing ahead: covered?",)


def test_a_scan_without_echoes_ahead_leaves_the_turn() -> None:
    aside = np.full(811, np.nan)
    aside[:200] = 2.0
    rig = Rig(seen=aside)
    out = rig.run(10, Twist(0.3, 0.4))
    assert out[-1].twist.v == 0.0
    assert out[-1].twist.w > 0.0
    assert out[-1].reasons[0] == "lidar sees nothing ahead: covered?"
    assert rig.run(3, Twist(0.3, 0.0))[-1].twist.v == 0.0
    assert "lidar sees nothing ahead: covered?" not in rig.tick(Twist(0.0, 0.4)).reasons


def legs(pose: Pose2, x: float, y: float) -> np.ndarray:
    return circles_ranges(pose, np.array([[x, y + 0.1, 0.07], [x, y - 0.1, 0.07]]))


def test_a_person_who_walks_up_finds_the_robot_standing_and_is_named() -> None:
    rig = Rig()
    rig.seen = lambda pose: legs(pose, 4.0 - 1.0 * max(0.0, rig.n * 0.02 - 1.0), 0.0)
    said = []
    while True:
        applied = rig.tick(Twist(0.3, 0.0))
        said += applied.reasons
        person_x = 4.0 - 1.0 * max(0.0, rig.n * 0.02 - 1.0)
        if person_x - 0.07 - 0.18 - rig.pose.x < 0.4:  # the body touches the robot
            break
        assert rig.n < 400
    assert rig.twist == STILL
    assert any(reason.startswith("slowed: person") for reason in said)
    assert said[-1].startswith("stopped: person 0.0 m, ")


def test_an_approach_to_a_noisy_wall_does_not_chatter() -> None:
    rng = np.random.default_rng(5)
    wall = np.array([[5.0 + 1.6, 0.0, 5.0]])
    rig = Rig(seen=lambda pose: circles_ranges(pose, wall) + rng.normal(0.0, 0.02, 811))
    speeds = np.array([applied.twist.v for applied in rig.run(600, Twist(0.5, 0.0))])
    starts = np.count_nonzero((speeds[1:] > 0.0) & (speeds[:-1] == 0.0))
    assert starts <= 3
    assert speeds[-300:].sum() * 0.02 < 0.02
    assert LIDAR_X < rig.pose.x < 1.6 - 0.44 - 0.08


def test_where_a_wide_stretch_ahead_is_silent_the_robot_goes_slowly_and_says_why() -> None:
    rig = Rig()
    rig.run(80, Twist(0.5, 0.0))
    assert rig.tick(Twist(0.5, 0.0)).twist.v == pytest.approx(0.5)
    yaw = scan().yaw
    rig.seen = np.where(np.abs(yaw) < math.radians(30), np.nan, 5.0).astype(np.float32)
    slow = rig.run(80, Twist(0.5, 0.2))[-1]
    assert slow.twist.v == pytest.approx(0.3)
    assert slow.twist.w == pytest.approx(0.12)
    assert "slow: lidar gets no echo over 60 deg ahead" in slow.reasons
