"""Whatever operator, devices, bus and base do, and in whatever order: the frames on the wire stay within bounds.

The robot's own driver, safety chain, loop and base output run against the simulated base in simulated time.
The judge (`virtual_time.checker`) reads the wire, knows the protocol from its fact sheet and calls none of
the code that it judges.
"""

from __future__ import annotations

import contextlib
import logging
import math
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from drivers.rmp110.codec.commands import motion
from drivers.rmp110.codec.parameters import OperationalState
from drivers.rmp110.simulator.faults import FaultPlan
from ghal360_robot.messages import HeadPose, OperatorInput, Twist
from tests.virtual_time.clock import Clock, virtual_loop
from tests.virtual_time.stage import FAR_M, Hands, Stage, Surround

ODD = [math.nan, math.inf, -math.inf, 1e308, -1e30, 1e-300, -0.0]
SPEEDS = st.one_of(st.floats(-0.6, 0.6), st.sampled_from([0.5, 0.4, -0.15, 2.0, -5.0]), st.sampled_from(ODD))
MOMENTS = st.sampled_from([0.0, 0.01, 0.05, 0.1, 0.3, 0.6])
PAUSES = st.sampled_from([0.05, 0.15, 0.25, 0.4, 0.9, 1.3, 2.5])
COUNTS = st.one_of(st.integers(0, 6), st.sampled_from([-1, 10**8, 10**30]))
SHIFTS = st.sampled_from([-3.0, -0.5, -0.25, -0.1, 0.0, 0.0, 0.05, 0.5, 10.0])
"""Seconds by which a stamp differs from the truth."""


class Robot(RuleBasedStateMachine):
    """One robot and one base for the length of an example."""

    def __init__(self) -> None:
        super().__init__()
        logging.getLogger("drivers").setLevel(logging.CRITICAL)
        logging.getLogger("ghal360_robot").setLevel(logging.CRITICAL)
        self.clock = Clock()
        self.context = contextlib.ExitStack()
        self.loop = self.context.enter_context(virtual_loop(self.clock))
        self.unhandled: list[str] = []
        self.loop.set_exception_handler(lambda _, context: self.unhandled.append(repr(context)))
        self.stage = self.wait(self._made())

    async def _made(self) -> Stage:
        stage = Stage(self.clock)
        await stage.open()
        return stage

    def wait(self, coroutine: Any) -> Any:
        return self.loop.run_until_complete(coroutine)

    def teardown(self) -> None:
        try:
            stage = self.stage
            stage.bus.go_up()
            self.wait(stage.run(0.2))
            self.wait(stage.close())
            self.judge()
            assert stage.bus.connections == 0, "a transport was left open"
        finally:
            self.context.close()

    def judge(self) -> None:
        wrong = self.stage.problems() + self.unhandled
        if wrong:
            raise AssertionError("\n".join(wrong[:5]))

    @initialize(v=st.sampled_from([0.5, 0.3, 0.1]), w=st.sampled_from([0.0, 0.3, -0.8]))
    def drives(self, v: float, w: float) -> None:
        self.wait(self.stage.armed_and_driving(Twist(v, w), 1.0))
        assert self.stage.checker.moving, "a healthy robot does not drive"

    @invariant()
    def nothing_on_the_wire_that_must_not_be(self) -> None:
        self.judge()

    @rule(seconds=PAUSES)
    def time_passes(self, seconds: float) -> None:
        self.wait(self.stage.run(seconds))

    @rule(v=SPEEDS, w=SPEEDS, seconds=MOMENTS)
    def stick(self, v: float, w: float, seconds: float) -> None:
        self.stage.hands.stick = Twist(v, w)
        self.wait(self.stage.run(seconds))

    @rule(seconds=MOMENTS)
    def by_gaze(self, seconds: float) -> None:
        """The paper's way: the robot goes where the operator looks."""
        self.stage.hands.stick = None
        self.wait(self.stage.run(seconds))

    @rule(held=st.booleans(), seconds=MOMENTS)
    def deadman(self, held: bool, seconds: float) -> None:
        self.stage.hands.deadman = held
        self.wait(self.stage.run(seconds))

    @rule(button=st.sampled_from(["arm", "arm", "disarm", "estop"]), seconds=MOMENTS)
    def press(self, button: str, seconds: float) -> None:
        hands = self.stage.hands
        setattr(hands, button, getattr(hands, button) + 1)
        self.wait(self.stage.run(seconds))

    @rule(seconds=PAUSES, press=st.sampled_from([None, "arm", "estop"]))
    def operator_silent(self, seconds: float, press: str | None) -> None:
        """And perhaps a button pressed while nobody hears it."""
        self.get_going()
        hands = self.stage.hands
        hands.sending = False
        self.wait(self.stage.run(seconds))
        if press:
            setattr(hands, press, getattr(hands, press) + 1)
        hands.sending = True
        self.wait(self.stage.run(0.1))

    @rule(shift=SHIFTS, seconds=MOMENTS)
    def messages_with_odd_stamps(self, shift: float, seconds: float) -> None:
        self.stage.hands.stamp_shift_s = shift
        self.wait(self.stage.run(seconds))

    @rule(
        stick=st.none() | st.builds(Twist, SPEEDS, SPEEDS),
        yaw=st.sampled_from([0.0, *ODD]),
        arm=COUNTS,
        disarm=COUNTS,
        estop=COUNTS,
        shift=SHIFTS,
        deadman=st.booleans(),
        times=st.integers(1, 3),
    )
    def any_message(
        self,
        stick: Twist | None,
        yaw: float,
        arm: int,
        disarm: int,
        estop: int,
        shift: float,
        deadman: bool,
        times: int,
    ) -> None:
        """One from another operator, or from a broken page; perhaps several times over."""
        stamp_ns = self.clock.now_ns + round(shift * 1e9)
        message = OperatorInput(stamp_ns, HeadPose(yaw), deadman, stick, arm, disarm, estop)
        for _ in range(times):
            self.stage.message(message)
        self.wait(self.stage.run(0.05))

    def get_going(self) -> None:
        """Most of what happens only matters to a robot that drives."""
        self.wait(self.stage.run(0.1))
        if self.clock.seconds() - self.stage.checker.moving_s > 0.1:
            self.all_is_well_again(0.5, 0.0)

    @rule(wall=st.sampled_from([FAR_M, 0.7, 0.45, 0.35, 0.28, 0.22, 0.05]), seconds=MOMENTS)
    def walls_come_near(self, wall: float, seconds: float) -> None:
        self.get_going()
        self.stage.surround.wall_m = wall
        self.wait(self.stage.run(seconds))

    @rule(
        what=st.sampled_from(["none", "stale", "covered", "unfit", "no pictures", "well"]),
        shift=SHIFTS, seconds=PAUSES,
    )  # fmt: skip
    def senses(self, what: str, shift: float, seconds: float) -> None:
        self.stage.surround = Surround(
            self.stage.surround.wall_m,
            scans=what != "none",
            covered=what == "covered",
            healthy=what != "unfit",
            scan_shift_s=shift if what == "stale" else 0.0,
            pictures=what != "no pictures",
        )
        self.wait(self.stage.run(seconds))

    @rule(drop=st.sampled_from([0.0, 0.02, 0.2, 1.0]), corrupt=st.sampled_from([0.0, 0.02, 0.3]), jitter=MOMENTS)
    def feedback_is_damaged(self, drop: float, corrupt: float, jitter: float) -> None:
        self.stage.bus.plan_faults(FaultPlan(seed=1, drop=drop, corrupt=corrupt))
        self.stage.bus.jitter_s = jitter
        self.wait(self.stage.run(0.3))

    @rule(what=st.sampled_from(["silent", "deaf", "full"]), seconds=PAUSES)
    def bus_gives_trouble(self, what: str, seconds: float) -> None:
        setattr(self.stage.bus, what, True)
        self.wait(self.stage.run(seconds))
        setattr(self.stage.bus, what, False)
        self.wait(self.stage.run(0.1))

    @rule(seconds=PAUSES)
    def bus_goes_down(self, seconds: float) -> None:
        self.stage.bus.go_down()
        self.wait(self.stage.run(seconds))
        self.stage.bus.go_up()
        self.wait(self.stage.run(0.1))

    @rule(v=st.sampled_from([0.0, 0.2]), times=st.integers(1, 5))
    def somebody_else_commands(self, v: float, times: int) -> None:
        for _ in range(times):
            self.stage.bus.foreign(motion(v, 0.0))
            self.wait(self.stage.run(0.02))

    @rule(seconds=PAUSES, kill=st.booleans())
    def base_off_and_on(self, seconds: float, kill: bool) -> None:
        bus = self.stage.bus
        (bus.kill_switch if kill else bus.power_off)()
        self.wait(self.stage.run(seconds))
        bus.power_on()
        self.wait(self.stage.run(0.5))

    @rule(what=st.sampled_from(["block", "unblock", "fault", "standby", "reset", "cycle"]))
    def base_by_itself(self, what: str) -> None:
        bus, model = self.stage.bus, self.stage.bus.model
        bus.step()
        if what == "fault":
            model.fault_words[3] |= 0x20
        elif what == "standby" and model.state is OperationalState.TRACTOR:
            model.state = OperationalState.STANDBY
        elif what == "reset":
            model.drive.right_m = model.drive.left_m = 0.0
        elif what == "cycle":
            model.power_on(self.clock.now_ns)
        elif what in ("block", "unblock"):
            getattr(model, what)()
        self.wait(self.stage.run(0.3))

    @rule(orderly=st.booleans(), seconds=MOMENTS)
    def robot_restarts(self, orderly: bool, seconds: float) -> None:
        self.wait(self.stage.stop_robot(orderly=orderly))
        self.wait(self.stage.run(seconds))
        self.wait(self.stage.start_robot())
        self.wait(self.stage.run(0.1))

    @rule(seconds=st.sampled_from([0.03, 0.1, 0.25, 0.4, 1.2]))
    def computer_is_busy(self, seconds: float) -> None:
        """The event loop does nothing for a while; then everything that was due."""
        self.clock.busy(seconds)
        self.stage.checker.look(self.clock.seconds())
        self.wait(self.stage.run(0.1))

    @rule(v=st.sampled_from([0.5, 0.3]), w=st.sampled_from([0.0, 0.5]))
    def all_is_well_again(self, v: float, w: float) -> None:
        """Faults off, base on, and the operator starts anew: without this, most examples would stand still."""
        stage, bus = self.stage, self.stage.bus
        bus.silent = bus.deaf = bus.full = False
        bus.jitter_s = 0.0
        bus.plan_faults(FaultPlan())
        bus.model.unblock()
        if not bus.model.powered or any(bus.model.fault_words) or bus.model.state > OperationalState.TRACTOR:
            bus.power_on()
        stage.surround = Surround()
        hands = stage.hands
        stage.hands = Hands(arm=hands.arm + 2, disarm=hands.disarm, estop=hands.estop, deadman=True)
        self.wait(stage.until_streaming())
        self.wait(stage.run(2.2 + stage.future_s))  # rates recover, old losses and odd stamps are over
        moving = stage.checker.moving
        stage.hands.arm += 1
        self.wait(stage.run(0.1))
        stage.hands.arm += 1  # where the first only reset an emergency stop
        self.wait(stage.run(0.3))
        stage.hands.stick = Twist(v, w)
        self.wait(stage.run(1.0))
        assert stage.checker.moving > moving or self.stage.problems(), "a healthy robot does not drive"


COMMON: dict[str, Any] = {
    "deadline": None,
    "print_blob": True,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
}


@pytest.mark.timeout(600)
def test_the_wire_stays_within_bounds_whatever_happens() -> None:
    run_state_machine_as_test(
        Robot, settings=settings(max_examples=20, stateful_step_count=15, derandomize=True, database=None, **COMMON)
    )


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_the_wire_stays_within_bounds_over_many_more_and_longer_sequences() -> None:
    run_state_machine_as_test(Robot, settings=settings(max_examples=1500, stateful_step_count=50, **COMMON))
