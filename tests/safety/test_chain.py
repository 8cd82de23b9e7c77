from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.mounting import LidarMount, scan_points
from ghal360_robot.messages import STILL, Applied, ArmState, BaseMode, Freshness, Inputs, Twist
from ghal360_robot.safety.chain import Safety, SafetyState
from ghal360_robot.safety.stop_zone import limit
from tests.safety.conftest import TICK_NS, YAW, inputs, scan

FORWARD = Twist(0.5, 0.0)


def drive(
    safety: Safety, ticks: list[Inputs], wanted: Twist, state: SafetyState | None = None
) -> tuple[SafetyState, list[Applied]]:
    state = state or SafetyState()
    out = []
    for tick in ticks:
        state, applied = safety.step(state, tick, wanted)
        out.append(applied)
    return state, out


def armed(safety: Safety, wanted: Twist = FORWARD, ticks: int = 100) -> tuple[SafetyState, list[Applied]]:
    return drive(safety, [inputs(n) for n in range(ticks)], wanted)


def test_nothing_moves_before_the_operator_presses_arm() -> None:
    quiet = [replace(inputs(n), operator=replace(inputs(0).operator, stamp_ns=n * TICK_NS)) for n in range(50)]
    _, out = drive(Safety(), quiet, FORWARD)
    assert all(a.twist == STILL and a.arm is ArmState.DISARMED for a in out)


def test_a_held_count_from_before_the_first_message_is_no_press() -> None:
    held = [replace(inputs(n), operator=replace(inputs(1).operator, arm_presses=7)) for n in range(10)]
    _, out = drive(Safety(), held, FORWARD)
    assert out[-1].arm is ArmState.DISARMED


def test_an_armed_robot_speeds_up_by_its_limit_and_reaches_the_wanted_speed() -> None:
    _, out = armed(Safety())
    speeds = [a.twist.v for a in out]
    assert speeds[-1] == pytest.approx(0.5)
    assert max(np.diff(speeds)) <= 0.5 * 0.02 + 1e-9


@pytest.mark.parametrize("name", ["operator", "tim571", "rmp110", "theta"])
def test_a_stale_input_holds_the_robot_and_motion_resumes_by_itself(name: str) -> None:
    safety = Safety()
    state, _ = armed(safety)
    ages = dict(safety.limits.hold_s)
    stale = Freshness(alive=False, rate_ok=True, valid=True, age_s=ages[name] + 0.05)
    tick = inputs(100)
    state, out = drive(safety, [replace(tick, freshness={**tick.freshness, name: stale})], FORWARD, state)
    assert out[0].twist == STILL
    assert out[0].arm is ArmState.ARMED
    assert "stale" in out[0].reasons[0]
    state, out = drive(safety, [inputs(101), inputs(102)], FORWARD, state)
    assert out[-1].twist.v > 0


@pytest.mark.parametrize("name", ["operator", "tim571", "rmp110", "theta"])
def test_a_lost_input_disarms_and_only_a_new_press_arms_again(name: str) -> None:
    safety = Safety()
    state, _ = armed(safety)
    gone = Freshness(alive=False, rate_ok=False, valid=True, age_s=math.inf)
    tick = inputs(100)
    state, out = drive(safety, [replace(tick, freshness={**tick.freshness, name: gone})], FORWARD, state)
    assert out[0].arm is ArmState.DISARMED
    state, out = drive(safety, [inputs(n) for n in range(101, 200)], FORWARD, state)
    assert all(a.twist == STILL for a in out)
    again = replace(inputs(200), operator=replace(inputs(200).operator, arm_presses=2))
    state, out = drive(safety, [again, again], FORWARD, state)
    assert out[-1].arm is ArmState.ARMED


def test_releasing_the_dead_man_is_zero_in_the_same_tick() -> None:
    safety = Safety()
    state, _ = armed(safety)
    tick = inputs(100)
    _, out = drive(safety, [replace(tick, operator=replace(tick.operator, deadman=False))], FORWARD, state)
    assert out[0].twist == STILL


def test_after_an_emergency_stop_one_press_resets_and_a_second_arms() -> None:
    safety = Safety()
    state, _ = armed(safety)
    stop = replace(inputs(100), operator=replace(inputs(100).operator, estop_presses=1))
    state, out = drive(safety, [stop], FORWARD, state)
    assert out[0].arm is ArmState.ESTOP
    arms = []
    for presses in (2, 2, 3):
        tick = replace(inputs(101), operator=replace(stop.operator, arm_presses=presses))
        state, out = drive(safety, [tick], FORWARD, state)
        arms.append(out[0].arm)
    assert arms == [ArmState.DISARMED, ArmState.DISARMED, ArmState.ARMED]


def test_a_base_fault_disarms_and_names_itself() -> None:
    safety = Safety()
    state, _ = armed(safety)
    tick = inputs(100)
    hurt = replace(tick, base=replace(tick.base, faults=("kill switch active",)))
    _, out = drive(safety, [hurt], FORWARD, state)
    assert out[0].arm is ArmState.DISARMED
    assert "kill switch active" in out[0].reasons[0]


def test_a_base_that_leaves_the_drive_mode_is_disarmed_after_two_seconds() -> None:
    safety = Safety()
    state, _ = armed(safety, ticks=2)
    lazy = [replace(inputs(n), base=replace(inputs(n).base, mode=BaseMode.STANDBY)) for n in range(2, 150)]
    _, out = drive(safety, lazy, FORWARD, state)
    assert all(a.twist == STILL for a in out)
    assert out[10].arm is ArmState.ARMED
    assert out[-1].arm is ArmState.DISARMED


def test_the_robot_stops_before_a_wall_and_may_still_turn() -> None:
    safety = Safety()
    state = SafetyState()
    position = 0.0
    for n in range(600):
        wall = 2.0 - position - 0.2  # the lidar sits 0.2 m ahead of the base's centre
        ranges = np.where(np.abs(YAW) < 1.2, wall / np.cos(np.clip(YAW, -1.2, 1.2)), 8.0)
        state, applied = safety.step(state, inputs(n, scan=scan(ranges)), FORWARD)
        position += applied.twist.v * 0.02
    assert 2.0 - position > safety.limits.footprint_radius_m + 0.9 * safety.limits.standoff_m
    assert applied.twist.v == pytest.approx(0.0, abs=1e-3)
    assert any("obstacle" in r for r in applied.reasons)
    state, turned = safety.step(state, inputs(601, scan=scan(ranges)), Twist(0.0, 0.5))
    assert turned.twist.w > 0


def test_a_covered_lidar_stops_translation() -> None:
    safety = Safety()
    state, _ = armed(safety)
    state, out = drive(safety, [inputs(100, scan=scan(np.nan))], FORWARD, state)
    assert out[0].twist.v == 0.0
    assert "covered" in out[0].reasons[0]


def test_too_close_already_the_robot_may_only_crawl_away() -> None:
    safety = Safety()
    touching = np.where(np.abs(YAW - np.float32(math.radians(130))) < 0.05, 0.5, 6.0)
    _, out = drive(safety, [inputs(n, scan=scan(touching)) for n in range(60)], FORWARD)
    assert 0.0 < out[-1].twist.v <= 0.1 + 1e-9


twists = st.builds(Twist, st.floats(width=32), st.floats(width=32))


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(twists, st.integers(1, 500_000_000)), min_size=1, max_size=40))
def test_whatever_is_wanted_the_applied_twist_keeps_every_limit(steps: list[tuple[Twist, int]]) -> None:
    safety = Safety()
    limits = safety.limits
    state, _ = armed(safety, STILL, 3)
    stamp = 2 * TICK_NS
    for wanted, dt_ns in steps:
        stamp += dt_ns
        before = state.last
        state, applied = safety.step(state, replace(inputs(3), stamp_ns=stamp), wanted)
        v, w = applied.twist.v, applied.twist.w
        dt = min(dt_ns / 1e9, 0.1) + 1e-9
        assert math.isfinite(v)
        assert math.isfinite(w)
        assert -limits.reverse_max - 1e-9 <= v <= limits.v_max + 1e-9
        assert abs(w) <= limits.w_max + 1e-9
        if abs(v) > abs(before.v):
            assert abs(v - before.v) <= limits.accel * dt + 1e-9
        assert abs(w - before.w) <= limits.w_accel * dt + 1e-9


def press(n: int, **counts: int) -> Inputs:
    tick = inputs(n)
    assert tick.operator is not None
    return replace(tick, operator=replace(tick.operator, **counts))


def stale_operator(tick: Inputs, age_s: float) -> Inputs:
    old = Freshness(alive=False, rate_ok=True, valid=True, age_s=age_s)
    return replace(tick, freshness={**tick.freshness, "operator": old})


def test_a_message_that_both_arms_and_disarms_does_not_arm() -> None:
    _, out = drive(Safety(), [press(0, arm_presses=0), press(1, arm_presses=1, disarm_presses=1)], FORWARD)
    assert out[-1].arm is ArmState.DISARMED


@pytest.mark.parametrize("age_s", [0.4, 5.0])
def test_a_press_made_during_a_silence_does_not_arm_when_it_arrives(age_s: float) -> None:
    safety = Safety()
    state, _ = drive(safety, [press(0, arm_presses=0)], FORWARD)
    state, _ = drive(safety, [stale_operator(press(1, arm_presses=0), age_s)], FORWARD, state)
    state, out = drive(safety, [press(2, arm_presses=1)] * 3, FORWARD, state)
    assert out[-1].arm is ArmState.DISARMED
    _, out = drive(safety, [press(5, arm_presses=2)], FORWARD, state)
    assert out[-1].arm is ArmState.ARMED


def test_an_emergency_stop_pressed_during_a_silence_counts() -> None:
    safety = Safety()
    state, _ = armed(safety)
    state, _ = drive(safety, [stale_operator(press(100, arm_presses=1), 0.4)], FORWARD, state)
    _, out = drive(safety, [press(101, arm_presses=1, estop_presses=1)], FORWARD, state)
    assert out[-1].arm is ArmState.ESTOP


def test_an_operator_with_fewer_presses_is_another_one_and_disarms() -> None:
    safety = Safety()
    state, _ = armed(safety)
    _, out = drive(safety, [press(100, arm_presses=0)], FORWARD, state)
    assert out[-1].arm is ArmState.DISARMED
    assert "another operator" in out[-1].reasons[0]


def test_what_goes_out_is_exactly_what_was_checked_against_the_scan() -> None:
    """A gentle arc that is free becomes a blocked one while w ramps: the ramped twist is the one that counts."""
    safety = Safety()
    corner = np.where((YAW > -0.35) & (YAW < 0.0), 1.2, 6.0)
    state = SafetyState()
    for n in range(200):
        state, applied = safety.step(state, inputs(n, scan=scan(corner)), Twist(0.5, 0.6))
        points = scan_points(scan(corner).ranges, YAW, LidarMount())
        again, reasons, _ = limit(points, applied.twist, safety.limits)
        assert again == applied.twist
        assert reasons == ()
