from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ghal360_robot.messages import (
    Applied,
    ArmState,
    BaseMode,
    BaseState,
    Cue,
    Decision,
    Detection,
    Detections,
    Freshness,
    HeadPose,
    Inputs,
    LinkStats,
    OperatorInput,
    Pose2,
    Surroundings,
    Twist,
)
from ghal360_robot.safety.people import Person
from ghal360_robot.telepresence.protocol import FROM_SERVER, MAX_BOXES, Scan, State
from ghal360_robot.telepresence.state import Watch, blind_sector, scan, state

S = 1_000_000_000
BASE = BaseState(S, BaseMode.DRIVE, Pose2(1.0, 2.0, 3.0), Twist(0.1, 0.2), 87.5)
FRESH = Freshness(alive=True, rate_ok=True, valid=True, age_s=0.02)
DECISION = Decision(Cue.LEFT, 0.5, (0,) * 8, (1.0, 2.0, 3.0), (0.125,) * 8, 2, Twist(0.3, 0.1), ("why",))
APPLIED = Applied(Twist(0.2, 0.1), ArmState.ARMED, ("obstacle ahead",), 0.7, "teleop")


def around(points: list[tuple[float, float]]) -> Surroundings:
    empty = np.zeros(0, np.float32)
    beam = np.arange(len(points), dtype=np.intp)
    return Surroundings(S, np.array(points, float).reshape(-1, 2), beam, np.zeros(0), empty, empty)


def inputs(**changes: object) -> Inputs:
    return replace(Inputs(S, 7, BASE, None, None, None, dict.fromkeys(("theta", "tim571"), FRESH)), **changes)  # type: ignore[arg-type]


def told(seen: Inputs, decision: Decision = DECISION, applied: Applied = APPLIED) -> State:
    fields = state(
        seen, decision, applied, blockers=("lidar silent",), links={"theta": LinkStats("streaming")}, found=False,
        cue_ns=S, target="backpack", approaching=(0.1,),
    )  # fmt: skip
    message = FROM_SERVER.validate_python({"kind": "state", **fields}, strict=False)
    assert isinstance(message, State)
    return message


def test_what_the_page_is_told_fits_the_protocol() -> None:
    message = told(inputs(surroundings=around([(2.0 * math.cos(0.5), 2.0 * math.sin(0.5))])))
    assert (message.arm, message.cue, message.tick, message.t_us) == ("armed", "left", 7, 1_000_000)
    assert message.target_m == 2.0
    assert message.devices["theta"].ok
    assert message.reasons == ("obstacle ahead",)
    assert message.intention == pytest.approx(math.remainder(-2 * math.tau / 8 - 3.0, math.tau))


def test_numbers_that_are_none_never_reach_the_page() -> None:
    wild = replace(BASE, pose=Pose2(math.nan, math.inf, math.nan), twist=Twist(math.nan, -math.inf))
    message = told(
        inputs(base=replace(wild, battery_percent=math.nan), freshness={"theta": replace(FRESH, age_s=math.inf)}),
        replace(DECISION, wanted=Twist(math.nan, math.inf)),
        replace(APPLIED, clearance_m=math.inf),
    )
    assert message.pose is not None
    assert (message.pose.x, message.pose.y, message.battery_percent, message.clearance_m) == (0.0, 0.0, None, None)
    assert message.wanted.v == 0.0


def test_before_anything_is_there_it_says_so() -> None:
    message = told(Inputs(S, 0, None, None, None, None, {}), replace(DECISION, target_yaw=None, intention=None))
    assert (message.pose, message.speed, message.target, message.base) == (None, None, None, "unknown")
    assert not message.devices["theta"].ok


def test_the_targets_box_is_among_the_ones_told() -> None:
    objects = tuple(Detection("chair", 0.9, 0.0, 0.0, 0.1, 0.1) for _ in range(60))
    found = Detections(S, 1, "painted", (*objects, Detection("backpack", 0.5, 1.0, 0.0, 0.1, 9.0)))
    message = told(inputs(detections=found))
    assert len(message.boxes) == MAX_BOXES
    assert message.boxes[0].target
    assert not any(box.target for box in message.boxes[1:])


def test_the_hands_wish_is_told_as_asked_for() -> None:
    operator = OperatorInput(S, HeadPose(), stick=Twist(-0.1, 0.7))
    assert (told(inputs(operator=operator)).wanted.v, told(inputs()).wanted.v) == (-0.1, 0.3)


def test_the_ring_has_the_nearest_return_of_each_direction() -> None:
    fields = scan(around([(2.0, 0.001), (3.0, 0.0), (0.0, 1.5), (500.0, 500.0)]))
    message = FROM_SERVER.validate_python({"kind": "scan", **fields}, strict=False)
    assert isinstance(message, Scan)
    by_yaw = {round(message.first + (k + 0.5) * message.step, 2): cm for k, cm in enumerate(message.cm) if cm}
    assert by_yaw[0.01] == 200
    assert by_yaw[1.58] == 150
    assert max(by_yaw.values()) == 10_000
    assert len(by_yaw) == 3


def test_the_blind_sector_is_the_widest_gap() -> None:
    assert blind_sector(np.radians(np.linspace(-135, 135, 811)).tolist()) == pytest.approx(
        (math.radians(135), math.radians(-135))
    )
    assert blind_sector(np.radians(np.linspace(0, 270, 811)).tolist()) == pytest.approx((math.radians(-90), 0.0))


def test_who_comes_closer_is_told_and_who_walks_by_is_not() -> None:
    def person(x: float, y: float, now: int) -> Person:
        return Person(x, y, now, now, 2)

    for speed, expected in (((-1.0, 0.0), [0.0]), ((0.0, 1.0), []), ((1.0, 0.0), [])):
        watch = Watch()
        for step in range(16):
            now = S + step * 50_000_000
            x, y = 4.0 + speed[0] * step * 0.05, speed[1] * step * 0.05
            watch = watch.step((person(x, y, now), person(9.0, 0.0, now)), now)
        assert [round(yaw, 1) for yaw in watch.approaching(Pose2())] == expected


def test_who_stands_is_no_threat_and_who_moves_close_by_always_is() -> None:
    still = Person(1.0, 1.0, S, 9 * S, 2)
    assert Watch().step((still,), 9 * S).approaching(Pose2()) == []
    assert Watch().step((still,), S).approaching(Pose2()) == [pytest.approx(math.pi / 4)]
    assert Watch().step((replace(still, times=1),), S).approaching(Pose2()) == []
