"""The chain under anything that can happen to it, against a model of what it owes: motion only by right."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from ghal360_robot.messages import (
    STILL,
    ArmState,
    BaseMode,
    BaseState,
    Command,
    Freshness,
    HeadPose,
    Inputs,
    Lease,
    Lock,
    OperatorInput,
    Pose2,
    Stops,
    Twist,
)
from ghal360_robot.safety.chain import Safety, SafetyState
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.mux import LockRule
from tests.safety.conftest import TICK_NS, around, scan

LIMITS = SafetyLimits(locks=(LockRule("pause", 255, 0.5),))
ODD = [math.nan, math.inf, -math.inf, 1e308, -1e30, 5e-324, 0.0, -0.0, 0.5, -0.5, 0.1]
NAMES = ("operator", "tim571", "rmp110", "theta")
HOLDERS = ("", "a", "b")
OPEN = scan(5.0)
twists = st.builds(Twist, st.sampled_from(ODD), st.sampled_from(ODD)) | st.builds(
    Twist, st.floats(-1, 1), st.floats(-2, 2)
)


class Anything(RuleBasedStateMachine):
    """`owed` is what the model grants: whether a press has armed, and nothing has taken that away since."""

    @initialize()
    def begin(self) -> None:
        self.safety, self.state = Safety(LIMITS), SafetyState()
        self.now_ns = 10**12
        self.holder, self.sender, self.lease_age_ns = "", "", 0
        self.counts = {holder: [0, 0, 0] for holder in HOLDERS}
        self.stops = Stops()
        self.deadman, self.wanted, self.stick = True, Twist(0.3, 0.1), None
        self.ages = dict.fromkeys(NAMES, 0.01)
        self.valid = True
        self.mode, self.faults, self.battery, self.latency = BaseMode.DRIVE, (), 90.0, 0.05
        self.lock: Lock | None = Lock("pause", self.now_ns, engaged=False)
        self.publishing = True
        self.commands: tuple[Command, ...] = ()
        self.twist = STILL
        self.follows = True
        self.operator_stamp_ns = 0
        self.armable = self.drove = False
        self.last_counts: tuple[str, list[int]] | None = None
        self.stopped = False
        self.tick()
        self.press_arm()

    def inputs(self) -> Inputs:
        arm, disarm, estop = self.counts[self.sender]
        base = BaseState(
            self.now_ns, self.mode, Pose2(), self.twist if self.follows else STILL, self.battery, self.faults
        )
        operator = OperatorInput(
            self.now_ns + self.operator_stamp_ns,
            HeadPose(),
            self.deadman,
            self.stick,
            arm,
            disarm,
            estop,
            holder=self.sender,
            latency_s=self.latency,
        )
        seen = replace(OPEN, stamp_ns=self.now_ns)
        fresh = {
            name: Freshness(age < 0.2, True, self.valid or name != "tim571", age) for name, age in self.ages.items()
        }
        lease = None if self.holder == "" else Lease(self.holder, self.now_ns - self.lease_age_ns)
        if self.lock is not None and self.publishing:
            self.lock = replace(self.lock, stamp_ns=self.now_ns)
        return Inputs(
            self.now_ns,
            0,
            base,
            seen,
            None,
            operator,
            fresh,
            commands=self.commands,
            locks=() if self.lock is None else (self.lock,),
            lease=lease,
            stops=self.stops,
            surroundings=replace(AROUND, stamp_ns=self.now_ns),
        )

    def lost(self, gap_ns: int) -> bool:
        """What takes the right to move away for good."""
        return (
            any(not age <= dict(LIMITS.lost_s)[name] for name, age in self.ages.items())
            or not self.valid
            or bool(self.faults)
            or (self.drove and self.mode is not BaseMode.DRIVE)
            or self.battery <= 8.0
            or self.sender != self.holder
            or (self.holder != "" and self.lease_age_ns > LIMITS.lease_s * 1e9)
            or gap_ns > 200_000_000
            or gap_ns < 0
        )

    def tick(self, gap_ns: int = TICK_NS) -> None:
        self.now_ns += gap_ns
        tick = self.inputs()
        before, first = self.state, self.last_counts is None
        self.state, applied = self.safety.step(self.state, tick, self.wanted)
        counts = list(self.counts[self.sender])
        same = self.last_counts is not None and self.last_counts[0] == self.sender
        old = self.last_counts[1] if self.last_counts is not None and same else [0, 0, 0]
        fresh_press = same and counts[0] > old[0] and self.ages["operator"] <= 0.2
        changed = not same and not first
        if self.lost(gap_ns) or changed or counts[1] > old[1] or counts[2] > old[2] or self.stopped:
            self.armable = self.drove = False
        elif fresh_press and not self.armable:
            self.armable, self.drove = True, False
        elif self.mode is BaseMode.DRIVE:
            self.drove = True
        self.last_counts, self.stopped = (self.sender, counts), False
        self.check(applied.twist, before.last, tick, max(gap_ns, 0))
        assert (applied.twist == STILL) or applied.arm is ArmState.ARMED
        assert applied.arm is not ArmState.ARMED or self.armable, "armed without a fresh press"
        self.twist = applied.twist

    def check(self, twist: Twist, last: Twist, tick: Inputs, gap_ns: int) -> None:
        assert math.isfinite(twist.v)
        assert math.isfinite(twist.w)
        assert -LIMITS.reverse_max - 1e-9 <= twist.v <= LIMITS.v_max + 1e-9
        assert abs(twist.w) <= LIMITS.w_max + 1e-9
        if twist == STILL:
            return
        assert self.armable
        assert self.deadman
        assert self.mode is BaseMode.DRIVE
        assert all(age <= dict(LIMITS.hold_s)[name] for name, age in self.ages.items())
        assert self.operator_stamp_ns <= TICK_NS
        assert self.latency < 0.8
        assert tick.locks
        assert not tick.locks[0].engaged
        assert 0 <= tick.stamp_ns - tick.locks[0].stamp_ns <= 500_000_000
        assert tick.base is not None
        dt_s = min(gap_ns / 1e9, 0.1) + 1e-9
        for now, before, measured, limit in (
            (twist.v, last.v, tick.base.twist.v, LIMITS.accel),
            (twist.w, last.w, tick.base.twist.w, LIMITS.w_accel),
        ):
            if abs(now) > max(abs(before), abs(measured)):
                assert abs(now) <= max(abs(before), abs(measured)) + limit * dt_s + 1e-9

    @rule(ticks=st.integers(1, 12))
    def time_goes_on(self, ticks: int) -> None:
        for _ in range(ticks):
            self.tick()

    @rule(gap_ns=st.sampled_from([0, 1, 100_000_000, 199_000_000, 201_000_000, 10**9, -1, -(10**9)]))
    def a_tick_is_not_in_time(self, gap_ns: int) -> None:
        self.tick(gap_ns)

    @rule()
    def press_arm(self) -> None:
        self.counts[self.sender][0] += 1
        self.tick()

    @rule()
    def all_is_well_and_somebody_arms(self) -> None:
        """Without this most examples would stand still."""
        self.ages, self.valid = dict.fromkeys(NAMES, 0.01), True
        self.mode, self.faults, self.battery, self.latency = BaseMode.DRIVE, (), 90.0, 0.05
        self.lock, self.publishing = Lock("pause", self.now_ns, engaged=False), True
        self.sender, self.lease_age_ns, self.deadman, self.operator_stamp_ns = self.holder, 0, True, 0
        self.wanted, self.stick, self.commands = Twist(0.3, 0.1), None, ()
        for _ in range(2):
            self.tick()
        for _ in range(2):  # the first may only reset an emergency stop
            if self.state.arming.state is not ArmState.ARMED:
                self.press_arm()
        self.time_goes_on(3)
        assert self.twist.v > 0.0, "a healthy robot does not drive"

    @rule(button=st.sampled_from([1, 2]))
    def press_a_stop(self, button: int) -> None:
        self.counts[self.sender][button] += 1
        self.tick()
        assert self.twist == STILL

    @rule(estop=st.booleans())
    def somebody_else_stops(self, estop: bool) -> None:
        more = Stops(self.stops.disarm + (not estop), self.stops.estop + estop)
        self.stops, self.stopped = more, True
        self.tick()
        assert self.twist == STILL

    @rule(held=st.booleans())
    def dead_man(self, held: bool) -> None:
        self.deadman = held

    @rule(wanted=twists, stick=st.none() | twists)
    def want(self, wanted: Twist, stick: Twist | None) -> None:
        self.wanted, self.stick = wanted, stick

    @rule(
        source=st.sampled_from(["test", "teleop", "autonomy", "stranger", ""]),
        age_ns=st.sampled_from([0, 200_000_000, 400_000_000, 2 * 10**9, -(10**10), 10**12]),
        twist=twists,
        copies=st.integers(0, 2),
    )
    def others_ask(self, source: str, age_ns: int, twist: Twist, copies: int) -> None:
        self.commands = (Command(source, self.now_ns - age_ns, twist),) * copies

    @rule(name=st.sampled_from(NAMES), age_s=st.sampled_from([0.01, 0.3, 0.8, 1.5, 3.0, math.inf, math.nan]))
    def an_input_ages(self, name: str, age_s: float) -> None:
        self.ages[name] = age_s
        self.tick()

    @rule(valid=st.booleans())
    def the_lidar_says_whether_it_is_well(self, valid: bool) -> None:
        self.valid = valid

    @rule(
        mode=st.sampled_from([BaseMode.DRIVE, BaseMode.DRIVE, BaseMode.STANDBY, BaseMode.OFF]),
        faults=st.sampled_from([(), (), ("fault",)]),
        battery=st.sampled_from([90.0, 12.0, 5.0]),
        follows=st.booleans(),
    )
    def the_base_changes(self, mode: BaseMode, faults: tuple[str, ...], battery: float, follows: bool) -> None:
        self.mode, self.faults, self.battery, self.follows = mode, faults, battery, follows
        self.tick()

    @rule(latency_s=st.sampled_from([0.0, 0.4, 0.6, 0.9, 100.0]))
    def the_link_changes(self, latency_s: float) -> None:
        self.latency = latency_s

    @rule(shift_ns=st.sampled_from([0, TICK_NS, TICK_NS + 1, 10**10, -(10**10)]))
    def the_operators_clock_shifts(self, shift_ns: int) -> None:
        self.operator_stamp_ns = shift_ns

    @rule(holder=st.sampled_from(HOLDERS), age_ns=st.sampled_from([0, 10**9, 2_999_999_999, 3_000_000_001]))
    def the_lease_changes(self, holder: str, age_ns: int) -> None:
        self.holder, self.lease_age_ns = holder, age_ns
        self.tick()

    @rule(sender=st.sampled_from(HOLDERS))
    def somebody_sends(self, sender: str) -> None:
        self.sender = sender
        self.tick()

    @rule(
        lock=st.none() | st.builds(Lock, st.just("pause"), st.integers(0, 10**12 + 10**10), st.booleans()),
        publishing=st.booleans(),
    )
    def the_lock_changes(self, lock: Lock | None, publishing: bool) -> None:
        self.lock, self.publishing = lock, publishing

    @invariant()
    def memory_is_bounded(self) -> None:
        if hasattr(self, "state"):
            memory = self.state.memory
            assert len(memory.looks) <= 18
            assert len(memory.past) <= 16
            assert len(memory.driven) <= 128
            assert len(memory.people) <= 12


AROUND = around(OPEN)
assert np.isfinite(AROUND.points).all()

TestAnything = Anything.TestCase
TestAnything.settings = settings(max_examples=40, stateful_step_count=30, deadline=None)
