"""Wheels that do not do what they were told are told in words; healthy ones never, whatever the operator does."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from drivers.rmp110.codec.commands import POLL, motion, request_mode
from drivers.rmp110.codec.feedback import COMPACT, COMPACT_BITMAPS
from drivers.rmp110.codec.frames import Frame, unpack_words
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, Stored
from drivers.rmp110.device.slip import SlipWatch
from drivers.rmp110.simulator.model import RmpModel

TICK_NS = 20_000_000
FEEDBACK = {f"feedback_bitmap_{n}": word for n, word in enumerate(COMPACT_BITMAPS, start=1)}
TRACK = RMP110_STORED["track_width"]
Tamper = Callable[[dict[str, float]], None]


class Drive:
    """A simulated base, driven and watched packet by packet."""

    def __init__(self, stored: Mapping[str, float] | None = None) -> None:
        self.model = RmpModel(0, Stored.of({**RMP110_STORED, **FEEDBACK, **(stored or {})}), boot_s=0.0)
        self.watch = SlipWatch.of(self.model.stored)
        self.now_ns = 0
        self.values: dict[str, float] = {}
        self.seen: list[str] = []

    def send(self, frame: Frame, *, lost: bool = False, tamper: Tamper | None = None) -> None:
        """One tick of 20 ms that begins with this frame; its reply is judged unless it is lost."""
        words = [word for reply in self.model.receive(self.now_ns, frame) for word in unpack_words(reply.data)]
        self.now_ns += TICK_NS
        if lost or not words:
            return
        self.values = COMPACT.decode(words)
        if tamper:
            tamper(self.values)
        self.watch = self.watch.step(self.values)
        self.seen.extend(warning for warning in self.watch.warnings if warning not in self.seen)

    def run(self, seconds: float, v: float = 0.0, w: float = 0.0, tamper: Tamper | None = None) -> Drive:
        """Normalised motion at 50 Hz."""
        for _ in range(round(seconds * 50)):
            self.send(motion(v, w), tamper=tamper)
        return self

    def until_warned(self, v: float, w: float = 0.0, tamper: Tamper | None = None) -> float:
        """Seconds of driving until the first warning; fails after one second."""
        began_ns = self.now_ns
        while not self.watch.warnings:
            assert self.now_ns - began_ns < 1_000_000_000, "no warning within a second"
            self.send(motion(v, w), tamper=tamper)
        return (self.now_ns - began_ns) / 1e9


@pytest.fixture
def driving() -> Drive:
    """In TRACTOR, limits open, nothing odd."""
    drive = Drive()
    drive.send(request_mode(ModeRequest.TRACTOR))
    drive.run(1.5, 0.6)
    assert drive.seen == []
    return drive


SHARE = st.sampled_from([-1.0, -0.3, -0.1, 0.0, 0.1, 0.5, 1.0])
LEGS = st.lists(
    st.tuples(
        st.sampled_from(
            ["drive", "drive", "drive", "polls", "silence", "tractor", "standby", "lossy", "reset", "power"]
        ),
        SHARE,
        SHARE,
        st.integers(1, 60),
    ),
    min_size=1,
    max_size=25,
)
LIMITS = st.fixed_dictionaries(
    {
        "max_velocity": st.sampled_from([0.5, 2.2352, 8.0]),
        "max_yaw_rate": st.sampled_from([1.0, 4.5]),
        "max_accel": st.floats(0.2, 7.8),
        "max_decel": st.floats(0.2, 7.8),
        "max_dtz_decel": st.floats(0.2, 7.8),
        "max_yaw_accel": st.floats(0.5, 28.0),
        "track_width": st.sampled_from([TRACK, 0.569976]),
    }
)


@example([("reset", -1.0, -1.0, 1), ("lossy", -1.0, -1.0, 21), ("reset", -1.0, -1.0, 1)], {})
@given(LEGS, st.one_of(st.just({}), LIMITS))
@settings(max_examples=60, deadline=None)
def test_nothing_that_an_operator_does_raises_a_false_alarm(
    legs: list[tuple[str, float, float, int]], limits: dict[str, float]
) -> None:
    drive = Drive(limits)
    drive.send(request_mode(ModeRequest.TRACTOR))
    for leg, v, w, ticks in legs:
        if leg == "silence":  # commands time out in the base while nobody asks
            drive.now_ns += ticks * TICK_NS
        elif leg in ("tractor", "standby"):
            drive.send(request_mode(ModeRequest.TRACTOR if leg == "tractor" else ModeRequest.STANDBY))
        elif leg == "reset":
            drive.model.drive.right_m = drive.model.drive.left_m = 0.0
        elif leg == "power":
            drive.model.power_on(drive.now_ns)
        for n in range(ticks):
            drive.send(POLL if leg == "polls" else motion(v, w), lost=leg == "lossy" and n % 7 not in (0, 3))
    assert drive.seen == []


def test_wheels_that_lag_their_targets_like_heavy_ones_raise_no_alarm() -> None:
    drive = Drive()
    drive.send(request_mode(ModeRequest.TRACTOR))
    heavy = Heavy()
    for v, w in ((1.0, 0.0), (0.0, 0.0), (-1.0, 1.0), (0.6, -1.0), (0.0, 1.0), (0.0, 0.0)):
        drive.run(1.8, v, w, tamper=heavy)
    assert drive.seen == []


@pytest.mark.parametrize("v", [0.15, 0.5, 1.0])
def test_a_blocked_base_is_told_within_half_a_second_of_being_driven(v: float, driving: Drive) -> None:
    driving.run(3.0)
    driving.model.block()
    driving.run(0.2, v)  # the target has to grow first
    assert driving.until_warned(v) <= 0.5
    assert driving.watch.warnings == ("neither wheel follows: the base stands against something or its motors gave up",)


def test_running_into_something_is_told_at_once_and_then_that_it_stands(driving: Drive) -> None:
    driving.model.block()
    assert driving.until_warned(0.6) <= 0.04
    assert "both wheels changed speed faster" in driving.watch.warnings[0]
    driving.run(0.5, 0.6)
    assert "neither wheel follows" in driving.watch.warnings[0]


@pytest.mark.parametrize("side", ["right", "left"])
def test_one_blocked_wheel_is_named(side: str, driving: Drive) -> None:
    other = "left" if side == "right" else "right"
    stuck_m = driving.values[f"{side}_front_pos_m"]

    def blocked(values: dict[str, float]) -> None:
        values[f"{side}_front_vel_mps"], values[f"{side}_front_pos_m"] = 0.0, stuck_m
        values["linear_vel_mps"] = values[f"{other}_front_vel_mps"] / 2

    driving.run(0.46, 0.6, tamper=blocked)
    assert f"the {side} wheel does not follow: it is blocked or its motor gave up" in driving.watch.warnings
    assert not any(other in warning or "both" in warning for warning in driving.watch.warnings)


def test_a_base_that_is_pushed_while_it_shall_stand_is_told_within_half_a_second(driving: Drive) -> None:
    driving.run(3.0)
    pushed = _rolls(driving, 0.2)
    driving.watch = SlipWatch.of(driving.model.stored)  # however it began to roll
    driving.run(0.4, tamper=pushed)
    assert driving.until_warned(0.0, tamper=pushed) <= 0.1
    assert driving.watch.warnings[0].startswith("the base moves without a command")


def test_a_wheel_that_runs_away_is_told(driving: Drive) -> None:
    def runaway(values: dict[str, float]) -> None:
        values["left_front_vel_mps"] += 0.5

    driving.run(0.5, 0.6, tamper=runaway)
    assert "the left wheel turns without a command: the base is pushed or rolls, or a motor runs away" in (
        driving.watch.warnings
    )


def test_positions_that_do_not_move_with_their_wheel_are_told(driving: Drive) -> None:
    stuck_m = driving.values["right_front_pos_m"]
    seconds = driving.until_warned(0.6, tamper=lambda values: values.update(right_front_pos_m=stuck_m))
    assert seconds <= 0.5
    assert driving.watch.warnings[0].startswith("the right wheel's position and speed disagree")


def test_a_base_speed_that_is_not_its_wheels_is_told(driving: Drive) -> None:
    def off(values: dict[str, float]) -> None:
        values["linear_vel_mps"] += 0.2

    assert driving.until_warned(0.6, tamper=off) <= 0.5
    assert driving.watch.warnings == ("the base's speed is not that of its wheels: do not trust the odometry",)


def test_a_warning_stays_for_a_second_and_then_goes(driving: Drive) -> None:
    driving.model.block()
    driving.run(1.0, 0.6)
    driving.model.unblock()
    driving.run(0.5, 0.6)
    assert driving.watch.warnings
    driving.run(0.7, 0.6)
    assert driving.watch.warnings == ()


def test_a_flickering_stall_does_not_flicker_in_words(driving: Drive) -> None:
    driving.run(3.0)
    driving.model.block()
    driving.run(1.0, 0.6)
    for _ in range(10):
        driving.model.unblock()
        driving.run(0.04, 0.6)
        driving.model.block()
        driving.run(0.1, 0.6)
        assert "neither wheel follows" in driving.watch.warnings[0]


def test_coarse_positions_are_told_and_raise_no_other_alarm() -> None:
    drive = Drive()
    drive.model.drive.right_m = drive.model.drive.left_m = 70_000.0
    # Summed up finely and told coarsely; summed up in float32 they would be wrong, and other alarms right.
    drive.model.drive.float32 = False
    drive.send(request_mode(ModeRequest.TRACTOR))
    drive.run(4.0, 0.8, 0.2)
    (warning,) = drive.seen
    assert warning.startswith("the base's wheel positions have grown so far that their steps are 8 mm")


def test_a_month_of_uptime_raises_no_alarm_although_the_base_s_time_is_coarse_then() -> None:
    drive = Drive()
    drive.model._ticks = 30 * 24 * 3600 * 100
    drive.send(request_mode(ModeRequest.TRACTOR))
    for v in (1.0, 0.0, -1.0, 0.3):
        drive.run(2.0, v, 0.5)
    assert drive.seen == []


class Heavy:
    """Wheels that come to their targets with a time constant of a sixth of a second."""

    def __init__(self) -> None:
        self.wheels = {"right": [0.0, 0.0], "left": [0.0, 0.0]}

    def __call__(self, values: dict[str, float]) -> None:
        for side, wheel in self.wheels.items():
            before = wheel[0]
            wheel[0] += 0.12 * (values[f"{side}_front_vel_mps"] - before)
            wheel[1] += 0.01 * (before + wheel[0])
            values[f"{side}_front_vel_mps"], values[f"{side}_front_pos_m"] = wheel
        values["linear_vel_mps"] = (self.wheels["right"][0] + self.wheels["left"][0]) / 2


def _rolls(drive: Drive, speed_mps: float) -> Tamper:
    """The base rolls, positions and speeds alike."""
    start_ns = drive.now_ns

    def rolls(values: dict[str, float]) -> None:
        gone_m = speed_mps * (drive.now_ns - start_ns) / 1e9
        values["linear_vel_mps"] = speed_mps
        for side in ("right", "left"):
            values[f"{side}_front_vel_mps"] = speed_mps
            values[f"{side}_front_pos_m"] += gone_m

    return rolls
