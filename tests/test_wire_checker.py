"""The judge of the wire complains about each thing that must not be, and about nothing else."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest

from tests.virtual_time.checker import WireChecker, Witness
from tests.virtual_time.wire import OnWire

NOW_S = 100.0
Wrong = Callable[[WireChecker], None]


def motion(checker: WireChecker, at_s: float, v: float, w: float = 0.0) -> None:
    """A motion frame in m/s and rad/s, for stored limits of 0.5 m/s and 1 rad/s."""
    checker.feed(OnWire(round(at_s * 1e9), True, 0x500, struct.pack(">2f", v / 0.5, -w)))


def config(checker: WireChecker, at_s: float, number: int, word: int) -> None:
    checker.feed(OnWire(round(at_s * 1e9), True, 0x501, struct.pack(">2I", number, word)))


def feedback(checker: WireChecker, at_s: float, state: int = 4, fault: int = 0, time_s: float = 10.0) -> None:
    words = struct.pack(">4I f 2I f I 4f", fault, 0, 0, 0, time_s, state, 0, 90.0, 0, 1.0, 0.5, 0.0, 0.0)
    data = words.ljust(88, b"\0")
    for k in range(11):
        checker.feed(OnWire(round(at_s * 1e9), False, 0x502 + k, data[8 * k : 8 * k + 8]))


def well() -> WireChecker:
    """Armed, all inputs fresh, the base in tractor mode."""
    witness = Witness(deadman=True, presses_needed=0, arm_count=1, wall_m=5.0)
    checker = WireChecker(witness)
    feedback(checker, NOW_S)
    for name in ("operator", "lidar", "video"):
        witness.lives(name, NOW_S, NOW_S)
    motion(checker, NOW_S, 0.0)
    return checker


def witness_of(checker: WireChecker) -> Witness:
    assert checker.witness
    return checker.witness


def test_a_gentle_start_and_a_stop_are_all_right() -> None:
    checker = well()
    for k in range(10):
        motion(checker, NOW_S + 0.02 * k, 0.01 * k, 0.03 * k)
    motion(checker, NOW_S + 0.2, 0.0)
    checker.look(NOW_S + 5.0)
    assert checker.violations == []
    assert checker.moving == 9


def moves(checker: WireChecker) -> None:
    """A small motion that would be all right by itself."""
    motion(checker, NOW_S + 0.02, 0.01)


def presses(checker: WireChecker, arm: int, disarm: int, estop: int) -> None:
    witness_of(checker).presses(NOW_S, arm, disarm, estop, steers=True, first=False)


WRONG: dict[str, tuple[str, *tuple[Wrong, ...]]] = {
    "not a number": ("motion (nan", lambda c: motion(c, NOW_S + 0.02, float("nan"))),
    "too fast": ("beyond the limits", lambda c: motion(c, NOW_S + 2.0, 0.0, 0.9)),
    "too fast backwards": ("beyond the limits", lambda c: motion(c, NOW_S + 0.3, -0.16)),
    "a jump": ("v from 0.000", lambda c: motion(c, NOW_S + 0.02, 0.1)),
    "a turn's jump": ("w from", lambda c: motion(c, NOW_S + 0.02, 0.0, 0.2)),
    "too often": ("ms apart", moves, lambda c: motion(c, NOW_S + 0.025, 0.01)),
    "too many": ("101 frames", *[lambda c, k=k: config(c, NOW_S + 0.009 * k, 0, 0) for k in range(101)]),
    "a forbidden command": ("configuration command 32 with 0x1", lambda c: config(c, NOW_S, 32, 1)),
    "a written parameter": ("configuration command 1 ", lambda c: config(c, NOW_S, 1, 0)),
    "a foreign id": ("id 0x600", lambda c: c.feed(OnWire(0, True, 0x600, bytes(8)))),
    "a short frame": ("3 bytes", lambda c: c.feed(OnWire(0, True, 0x500, bytes(3)))),
    "a fault": ("trouble True", lambda c: feedback(c, NOW_S, fault=0x40), moves),
    "standby": ("reports state 3", lambda c: feedback(c, NOW_S, state=3), moves),
    "left by itself": ("by itself", lambda c: feedback(c, NOW_S, state=3), lambda c: feedback(c, NOW_S), moves),
    "a restart": ("restarted", lambda c: feedback(c, NOW_S, time_s=1.0), moves),
    "no dead man": ("dead man", lambda c: setattr(c.witness, "deadman", False), moves),
    "an emergency stop": ("2 press(es)", lambda c: presses(c, 1, 0, 1), moves),
    "one press after it": ("1 press(es)", lambda c: presses(c, 1, 0, 1), lambda c: presses(c, 2, 0, 1), moves),
    "a disarm": ("1 press(es)", lambda c: presses(c, 1, 1, 0), moves),
    "a wall": (
        "0.00 m of room",
        lambda c: setattr(c.witness, "wall_m", 0.1),
        lambda c: motion(c, NOW_S + 0.28, 0.12),
    ),
    "a loss in between": (
        "the lidar was lost",
        lambda c: witness_of(c).lives("lidar", NOW_S + 2.0, NOW_S + 2.0),
        lambda c: motion(c, NOW_S + 2.0, 0.01),
    ),
    "left standing": ("left standing", moves, lambda c: c.look(NOW_S + 0.4)),
    "left without zero": ("without saying zero", moves, lambda c: c.robot_gone(NOW_S + 0.1, orderly=True)),
    "tractor unasked": (
        "TRACTOR without a press",
        lambda c: witness_of(c).revoke("the test"),
        lambda c: config(c, NOW_S, 32, 5),
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_must_not_be_is_complained_about(name: str) -> None:
    complaint, *steps = WRONG[name]
    checker = well()
    for step in steps:
        step(checker)
    assert any(complaint in violation for violation in checker.violations), checker.violations


@pytest.mark.parametrize(("name", "age_s"), [("operator", 0.31), ("lidar", 0.31), ("base", 0.33), ("video", 0.73)])
def test_motion_after_an_input_s_deadline_is_complained_about(name: str, age_s: float) -> None:
    checker = well()
    now_s = NOW_S + age_s
    for other in {"operator", "lidar", "base", "video"} - {name}:
        witness_of(checker).lives(other, now_s, now_s)
    motion(checker, now_s, 0.01)
    assert checker.violations == [f"{now_s:.3f}: motion {age_s:.3f} s after the {name}'s last sign of life"]


def test_a_stamp_from_the_future_is_worth_its_arrival_and_an_old_one_its_age() -> None:
    witness = Witness()
    witness.lives("operator", 10.0, 20.0)
    assert witness.alive_s["operator"] == 10.0
    witness.lives("lidar", 10.0, 9.5)
    assert witness.alive_s["lidar"] == 9.5
