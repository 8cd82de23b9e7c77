"""The chain as a whole: what arms, what stops, and that nothing leaves it which was not checked."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ghal360_robot.messages import (
    STILL,
    ArmState,
    BaseMode,
    BaseState,
    Command,
    Freshness,
    Inputs,
    Lease,
    Lock,
    Pose2,
    Stops,
    Twist,
)
from ghal360_robot.safety.chain import Safety, SafetyState
from ghal360_robot.safety.derating import Rule
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.mux import LockRule
from ghal360_robot.safety.zones import Around, limit
from tests.safety.conftest import FRESH, TICK_NS, TICK_S, YAW, Rig, circles_ranges, inputs

FORWARD = Twist(0.5, 0.0)
NAMES = ["operator", "tim571", "rmp110", "theta"]


def driving(ticks: int = 100, wanted: Twist = FORWARD, safety: Safety | None = None) -> Rig:
    rig = Rig(safety)
    rig.run(ticks, wanted)
    return rig


def fresh(**changes: Freshness) -> dict[str, Freshness]:
    return {**dict.fromkeys(NAMES, FRESH), **changes}


def operator(rig: Rig, **changes: object) -> Inputs:
    tick = rig.inputs()
    assert tick.operator is not None
    return replace(tick, operator=replace(tick.operator, **changes))  # type: ignore[arg-type]


def test_nothing_moves_before_the_operator_presses_arm() -> None:
    rig = Rig()
    out = [rig.give(operator(rig, arm_presses=0), FORWARD) for _ in range(50)]
    assert all(a.twist == STILL and a.arm is ArmState.DISARMED and a.source == "autonomy" for a in out)
    assert out[-1].reasons == ("not armed yet",)


def test_a_held_count_from_before_the_first_message_is_no_press() -> None:
    rig = Rig()
    out = [rig.give(operator(rig, arm_presses=7), FORWARD) for _ in range(10)]
    assert out[-1].arm is ArmState.DISARMED


def test_an_armed_robot_speeds_up_by_its_limit_and_reaches_the_wanted_speed() -> None:
    rig = Rig()
    out = rig.run(100, FORWARD)
    speeds = [a.twist.v for a in out]
    assert speeds[-1] == pytest.approx(0.5)
    assert max(np.diff(speeds)) == pytest.approx(0.5 * TICK_S)
    assert out[20].reasons == ("ramp",)
    assert out[-1].reasons == ()
    assert out[-1].source == "autonomy"
    assert out[-1].clearance_m is None


def test_a_base_that_lags_a_little_is_sped_up_from_the_command_and_not_from_what_it_does() -> None:
    rig = driving(20)
    assert rig.applied is not None
    before = rig.applied.twist.v
    rig.twist = Twist(before - 0.05, 0.0)
    assert rig.tick(FORWARD).twist.v == pytest.approx(before + 0.5 * TICK_S)


def test_every_limit_is_a_setting() -> None:
    gentle = Rule("latency", "s", 0.1, 0.2, 0.3, 0.05)
    rig = Rig(Safety(SafetyLimits(deratings=(gentle,), tick_gap_s=0.5, lease_s=10.0)))
    rig.run(50, FORWARD)
    rig.n += 20
    assert rig.tick(FORWARD).arm is ArmState.ARMED
    held = rig.give(operator(rig, latency_s=0.35), FORWARD)
    assert held.twist == STILL
    assert held.reasons == ("latency 0.3 s",)
    for _ in range(300):
        rig.give(replace(operator(rig, holder="a"), lease=Lease("a", 0)), FORWARD)
    rig.presses += 1
    assert rig.give(replace(operator(rig, holder="a"), lease=Lease("a", 0)), FORWARD).arm is ArmState.ARMED
    empty = Safety(SafetyLimits(deratings=(Rule("battery", "%", 99.0, 98.0, 97.0, 0.1, disarms=True),)))
    assert empty.not_ready(SafetyState(), inputs(5)) == ("battery 90 %",)


def test_a_hold_forgets_neither_the_surroundings_nor_what_is_slow() -> None:
    rig = driving()
    held = rig.give(operator(rig, latency_s=0.9), FORWARD)
    assert held.reasons == ("latency 0.9 s",)
    assert len(rig.state.memory.looks) == 18
    assert rig.give(operator(rig, latency_s=0.78), FORWARD).reasons == ("latency 0.8 s",)
    assert rig.give(operator(rig, latency_s=0.74), FORWARD).twist.v > 0.0


@pytest.mark.parametrize("name", NAMES)
def test_a_stale_input_is_zero_at_once_and_motion_resumes_by_itself_from_the_measured_speed(name: str) -> None:
    rig = driving()
    hold_s = dict(rig.safety.limits.hold_s)[name]
    held = rig.tick(FORWARD, freshness=fresh(**{name: replace(FRESH, alive=False, age_s=hold_s + 0.01)}))
    assert held.twist == STILL
    assert held.arm is ArmState.ARMED
    assert "stale" in held.reasons[0]
    rig.twist = Twist(0.4, 0.0)  # the base brakes by its own limit
    assert rig.tick(FORWARD).twist.v == pytest.approx(0.4 + 0.5 * TICK_S)


@pytest.mark.parametrize("name", NAMES)
def test_a_lost_input_disarms_and_only_a_new_press_arms_again(name: str) -> None:
    rig = driving()
    lost = rig.tick(FORWARD, freshness=fresh(**{name: Freshness(False, False, True, math.inf)}))
    assert lost.twist == STILL
    assert lost.arm is ArmState.DISARMED
    assert all(a.twist == STILL for a in rig.run(100, FORWARD))
    rig.presses += 1
    assert rig.tick(FORWARD).arm is ArmState.ARMED


def test_releasing_the_dead_man_is_zero_in_the_same_tick() -> None:
    rig = driving()
    applied = rig.give(operator(rig, deadman=False), FORWARD)
    assert applied.twist == STILL
    assert applied.arm is ArmState.ARMED
    assert applied.reasons == ("dead man released",)


def test_after_an_emergency_stop_one_press_resets_and_a_second_arms() -> None:
    rig = driving()
    assert rig.give(operator(rig, estop_presses=1), FORWARD).arm is ArmState.ESTOP
    arms = [rig.give(operator(rig, estop_presses=1, arm_presses=n), FORWARD).arm for n in (1, 2, 2, 3)]
    assert arms == [ArmState.ESTOP, ArmState.DISARMED, ArmState.DISARMED, ArmState.ARMED]


def test_a_base_fault_disarms_and_names_itself() -> None:
    rig = driving()
    base = replace(rig.inputs().base, faults=("kill switch active",))  # type: ignore[type-var]
    applied = rig.tick(FORWARD, base=base)
    assert applied.arm is ArmState.DISARMED
    assert applied.reasons == ("base fault: kill switch active",)


def test_a_base_that_never_gets_into_the_drive_mode_stands_and_is_disarmed_after_two_seconds() -> None:
    rig = Rig()
    out = []
    for _ in range(110):
        base = replace(rig.inputs().base, mode=BaseMode.STANDBY)  # type: ignore[type-var]
        out.append(rig.tick(FORWARD, base=base))
    assert all(a.twist == STILL for a in out)
    assert out[10].reasons == ("base is not in drive mode yet",)
    arms = [a.arm for a in out]
    assert arms.index(ArmState.ARMED) == 1
    assert arms.index(ArmState.DISARMED, 1) == 102
    assert out[-1].reasons == ("base left the drive mode (standby)",)


def test_a_base_that_drove_and_leaves_the_drive_mode_is_disarmed_at_once() -> None:
    rig = driving(10)
    base = replace(rig.inputs().base, mode=BaseMode.STANDBY)  # type: ignore[type-var]
    assert rig.tick(FORWARD, base=base).arm is ArmState.DISARMED


def test_two_senders_who_take_turns_do_not_arm_the_robot() -> None:
    rig = driving()
    assert rig.give(operator(rig, arm_presses=0), FORWARD).arm is ArmState.DISARMED
    for _ in range(30):
        assert rig.give(operator(rig, arm_presses=1), FORWARD).arm is ArmState.DISARMED
        assert rig.give(operator(rig, arm_presses=0), FORWARD).arm is ArmState.DISARMED
    out = [rig.give(operator(rig, arm_presses=0), FORWARD) for _ in range(49)]
    assert rig.give(operator(rig, arm_presses=1), FORWARD).arm is ArmState.ARMED
    assert all(a.arm is ArmState.DISARMED for a in out)


def test_a_tick_that_comes_too_late_disarms() -> None:
    rig = driving()
    rig.n += 6  # the next tick is 140 ms after the last: just in time
    assert rig.tick(FORWARD).arm is ArmState.ARMED
    rig.n += 7
    late = rig.tick(FORWARD)
    assert late.twist == STILL
    assert late.arm is ArmState.DISARMED
    assert late.reasons == ("the control loop stood still for 0.16 s",)


def test_a_clock_that_runs_backwards_disarms() -> None:
    rig = driving()
    rig.n -= 5
    assert rig.tick(FORWARD).reasons == ("the clock ran backwards",)


def test_only_the_holder_of_the_lease_drives() -> None:
    rig = Rig()
    assert rig.tick(lease=Lease("a", 0)).arm is ArmState.DISARMED
    for _ in range(5):
        tick = replace(operator(rig, holder="b"), lease=Lease("a", rig.n * TICK_NS))
        assert rig.give(tick, FORWARD).arm is ArmState.DISARMED
    rig.presses += 1
    for _ in range(2):
        tick = replace(operator(rig, holder="a"), lease=Lease("a", rig.n * TICK_NS))
        assert rig.give(tick, FORWARD).arm is ArmState.DISARMED  # a first message arms nothing
    rig.presses += 1
    tick = replace(operator(rig, holder="a"), lease=Lease("a", rig.n * TICK_NS))
    assert rig.give(tick, FORWARD).arm is ArmState.ARMED


def leased() -> Rig:
    """Driving with a lease of "a" granted at time 0 and never renewed."""
    rig = Rig()
    for _ in range(50):
        rig.give(replace(operator(rig, holder="a"), lease=Lease("a", 0)), FORWARD)
    assert rig.applied is not None
    assert rig.applied.twist.v > 0.3
    return rig


def test_a_lease_that_expires_disarms() -> None:
    rig = leased()
    arms = []
    while rig.n * TICK_NS <= 3.1e9:
        arms.append((rig.n * TICK_NS, rig.give(replace(operator(rig, holder="a"), lease=Lease("a", 0)), FORWARD)))
    expired_ns, applied = next((ns, a) for ns, a in arms if a.arm is ArmState.DISARMED)
    assert expired_ns == 3_020_000_000
    assert applied.reasons == ("the lease has expired",)


@pytest.mark.parametrize("lease", [None, Lease("b", 10**9)])
def test_a_lease_that_is_withdrawn_or_passed_on_disarms_and_a_stale_press_does_not_arm(lease: Lease | None) -> None:
    rig = leased()
    assert rig.give(replace(operator(rig, holder="a"), lease=lease), FORWARD).arm is ArmState.DISARMED
    rig.presses += 1
    assert rig.give(replace(operator(rig, holder="b"), lease=Lease("b", 10**9)), FORWARD).arm is ArmState.DISARMED


def test_anybody_can_stop_without_a_lease() -> None:
    rig = leased()
    tick = replace(operator(rig, holder="a"), lease=Lease("a", 0))
    assert rig.give(replace(tick, stops=Stops(disarm=1)), FORWARD).reasons == ("disarmed by somebody else",)
    rig = leased()
    tick = replace(operator(rig, holder="a"), lease=Lease("a", 0))
    assert rig.give(replace(tick, stops=Stops(estop=1)), FORWARD).arm is ArmState.ESTOP


def test_a_hand_on_the_stick_overrides_everybody_else() -> None:
    rig = driving(wanted=Twist(0.3, 0.0))
    test = Command("test", rig.n * TICK_NS, Twist(0.2, 0.0))
    assert rig.tick(Twist(0.3, 0.0), commands=(test,)).source == "test"
    out = [rig.stick(Twist(0.1, 0.0), commands=(test,)) for _ in range(30)]
    assert out[0].source == "teleop"
    assert out[-1].twist.v == pytest.approx(0.1)


def test_a_source_that_falls_silent_is_zero_before_the_next_one_is_taken() -> None:
    rig = driving(wanted=Twist(0.2, 0.0))
    test = Command("test", rig.n * TICK_NS, Twist(0.4, 0.0))
    out = rig.run(80, Twist(0.2, 0.0), commands=(test,))
    silent = [n for n, a in enumerate(out) if a.reasons == ("test is silent",)]
    assert silent == list(range(16, 51))
    assert all(out[n].twist == STILL for n in silent)
    assert out[51].source == "autonomy"


def test_what_the_others_want_is_checked_like_everything_else() -> None:
    rig = driving(10, STILL)
    wild = Command("test", rig.n * TICK_NS, Twist(math.inf, math.nan))
    assert rig.tick(commands=(wild,)).twist == STILL
    forged = (Command("teleop", rig.n * TICK_NS, FORWARD), Command("autonomy", rig.n * TICK_NS, FORWARD))
    assert rig.tick(commands=forged).twist == STILL


def test_a_lock_holds_what_is_below_it_and_lets_pass_what_is_above() -> None:
    safety = Safety(SafetyLimits(locks=(LockRule("pause", 50),)))
    rig = Rig(safety)
    assert rig.run(5, FORWARD)[-1].reasons == ("lock 'pause' is silent",)
    free = [rig.tick(FORWARD, locks=(Lock("pause", rig.n * TICK_NS, engaged=False),)) for _ in range(5)]
    assert free[-1].twist.v > 0
    engaged = Lock("pause", rig.n * TICK_NS, engaged=True)
    held = rig.tick(FORWARD, locks=(engaged,))
    assert held.twist == STILL
    assert held.reasons == ("held by lock 'pause'",)
    assert rig.stick(FORWARD, locks=(engaged,)).twist.v > 0


def test_the_robot_stops_before_a_wall_and_may_still_turn() -> None:
    rig = Rig(seen=lambda pose: np.where(np.abs(YAW) < 1.2, (1.8 - pose.x) / np.cos(np.clip(YAW, -1.2, 1.2)), 8.0))
    out = rig.run(600, FORWARD)
    room_m = 2.0 - rig.pose.x - 0.4
    assert 0.1 <= room_m < 0.2
    assert out[-1].twist == STILL
    assert out[-1].reasons == (f"stopped: obstacle {room_m - 0.04:.1f} m, ahead",)
    assert rig.tick(Twist(0.0, 0.5)).twist.w > 0


def test_a_standing_robot_says_nothing_about_obstacles() -> None:
    rig = Rig(seen=0.65)
    assert rig.run(10, STILL)[-1].reasons == ()


def test_while_the_base_answers_late_it_is_told_zero_and_then_ramped_up_from_what_it_does() -> None:
    rig = driving()
    assert rig.twist == FORWARD
    tick = rig.inputs()
    late = replace(tick.freshness["rmp110"], age_s=0.09)
    held = rig.give(replace(tick, freshness={**tick.freshness, "rmp110": late}), FORWARD)
    assert (held.twist, held.reasons, held.arm) == (STILL, ("base answers late",), ArmState.ARMED)
    slower = BaseState(rig.n * TICK_NS, BaseMode.DRIVE, rig.pose, Twist(0.2, 0.0), 90.0)
    assert rig.tick(FORWARD, base=slower).twist.v == pytest.approx(0.2 + SafetyLimits().accel * TICK_S)


def test_a_covered_lidar_allows_no_motion_at_all() -> None:
    rig = Rig(seen=np.nan)
    out = rig.run(10, Twist(0.2, 0.5))
    assert all(a.twist == STILL for a in out)
    assert out[-1].reasons == ("lidar sees nothing: covered?",)


def test_a_scan_that_was_measured_long_ago_allows_no_motion_however_freshly_it_came() -> None:
    rig = driving(10)
    old = rig.inputs()
    out = [rig.tick(FORWARD, scan=old.scan, surroundings=old.surroundings) for _ in range(40)]
    ages_s = [round((n + 1 + (10 - 1) % 3) * TICK_S, 3) for n in range(40)]
    assert [a.reasons == ("the scan is old",) for a in out] == [age_s > 0.3 for age_s in ages_s]
    assert all((a.twist == STILL) == (a.reasons == ("the scan is old",)) for a in out)


def test_without_a_scan_there_is_no_motion() -> None:
    rig = Rig()
    assert rig.run(5, FORWARD, scan=None, surroundings=None)[-1].reasons == ("no scan",)
    assert rig.tick(FORWARD).twist.v > 0.0
    assert rig.tick(FORWARD, scan=None, surroundings=None).reasons == ("no scan",)


def test_too_close_already_the_robot_may_only_crawl_away() -> None:
    rig = Rig(seen=lambda pose: circles_ranges(pose, np.array([[-0.02, 0.43, 0.02]])))
    out = rig.run(40, FORWARD)
    assert out[15].twist.v == pytest.approx(0.1)
    assert out[-1].twist.v > 0


def test_a_slow_operator_link_halves_the_speed_and_a_dead_one_holds() -> None:
    rig = driving(wanted=FORWARD)
    for _ in range(60):
        slow = rig.give(operator(rig, latency_s=0.6), FORWARD)
    assert slow.twist.v == pytest.approx(0.25)
    assert slow.reasons == ("slow: latency 0.6 s",)
    held = rig.give(operator(rig, latency_s=0.9), FORWARD)
    assert held.twist == STILL
    assert held.arm is ArmState.ARMED
    assert held.reasons == ("latency 0.9 s",)


def test_an_empty_battery_disarms_and_keeps_from_arming() -> None:
    rig = driving()
    base = replace(rig.inputs().base, battery_percent=7.0)  # type: ignore[type-var]
    assert rig.tick(FORWARD, base=base).arm is ArmState.DISARMED
    rig.presses += 1
    base = replace(rig.inputs().base, battery_percent=7.0)  # type: ignore[type-var]
    assert rig.tick(FORWARD, base=base).reasons == ("cannot arm: battery 7 %",)
    assert rig.safety.not_ready(rig.state, rig.inputs(base=base)) == ("battery 7 %",)


def test_wheels_that_do_not_follow_slow_the_robot_down_and_then_disarm_it() -> None:
    rig = driving()
    out = []
    for _ in range(90):
        base = replace(rig.inputs().base, warnings=("the left wheel slips",))  # type: ignore[type-var]
        out.append(rig.tick(FORWARD, base=base))
    assert out[60].twist.v == pytest.approx(0.2)
    assert out[60].reasons == ("slow: the left wheel slips",)
    assert [a.arm for a in out].index(ArmState.DISARMED) == 75


def test_a_base_that_stopped_by_itself_is_started_gently() -> None:
    """The base's own watchdog tripped: the command before says nothing about its speed any more."""
    rig = driving()
    rig.twist = STILL
    assert rig.tick(FORWARD).twist.v <= 0.5 * 0.25 + 0.5 * TICK_S


def test_what_goes_out_is_exactly_what_was_checked_against_the_scan() -> None:
    """A gentle arc that is free becomes a blocked one while w ramps: the ramped twist is the one that counts."""
    corner = np.where((YAW > -0.35) & (YAW < 0.0), 1.2, 6.0)
    rig = Rig(seen=corner)
    for _ in range(150):
        measured = rig.twist
        tick = rig.inputs()
        applied = rig.give(tick, Twist(0.5, 0.6))
        assert tick.surroundings is not None
        none = np.zeros((0, 2))
        turned = Around(_moved(tick.surroundings.points, Pose2()), none, none)
        again, _ = limit(turned, applied.twist, rig.safety.limits, measured)
        assert again.v == pytest.approx(applied.twist.v, abs=1e-6)
        rig.pose = Pose2()  # a tread mill


def _moved(points: np.ndarray, pose: Pose2) -> np.ndarray:
    return points - (pose.x, pose.y)


def test_a_message_that_both_arms_and_disarms_does_not_arm() -> None:
    rig = Rig()
    rig.tick()
    assert rig.give(operator(rig, arm_presses=1, disarm_presses=1), FORWARD).arm is ArmState.DISARMED


def stale_operator(tick: Inputs, age_s: float) -> Inputs:
    return replace(tick, freshness=fresh(operator=replace(FRESH, alive=False, age_s=age_s)))


@pytest.mark.parametrize("age_s", [0.4, 5.0])
def test_a_press_made_during_a_silence_does_not_arm_when_it_arrives(age_s: float) -> None:
    rig = Rig()
    rig.give(operator(rig, arm_presses=0))
    rig.give(stale_operator(operator(rig, arm_presses=0), age_s))
    for _ in range(3):
        assert rig.give(operator(rig, arm_presses=1), FORWARD).arm is ArmState.DISARMED
    assert rig.give(operator(rig, arm_presses=2), FORWARD).arm is ArmState.ARMED


def test_an_emergency_stop_pressed_during_a_silence_counts() -> None:
    rig = driving()
    rig.give(stale_operator(operator(rig), 0.4), FORWARD)
    assert rig.give(operator(rig, estop_presses=1), FORWARD).arm is ArmState.ESTOP


def test_an_operator_with_fewer_presses_is_another_one_and_disarms() -> None:
    rig = driving()
    applied = rig.give(operator(rig, arm_presses=0), FORWARD)
    assert applied.arm is ArmState.DISARMED
    assert applied.reasons == ("another operator took over",)


def test_stamps_from_the_future_are_silence() -> None:
    rig = driving()
    held = rig.give(operator(rig, stamp_ns=(rig.n + 2) * TICK_NS), FORWARD)
    assert held.twist == STILL
    assert held.reasons == ("operator stamps from the future",)
    assert rig.give(operator(rig, stamp_ns=(rig.n + 1) * TICK_NS), FORWARD).twist.v > 0


def test_not_ready_says_what_a_press_would_meet() -> None:
    safety = Safety()
    assert safety.not_ready(SafetyState(), inputs(5)) == ()
    assert safety.not_ready(SafetyState(), inputs(5, lease=Lease("a", 0))) == ("another operator holds the lease",)
    off = replace(inputs(5).base, mode=BaseMode.OFF, faults=("flat",))  # type: ignore[type-var]
    assert safety.not_ready(SafetyState(), inputs(5, base=off)) == ("flat", "base is off")
    stale = fresh(theta=replace(FRESH, age_s=1.0), tim571=replace(FRESH, age_s=2.0))
    assert safety.not_ready(SafetyState(), inputs(5, freshness=stale)) == ("lidar lost", "video stale")
