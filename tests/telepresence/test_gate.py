from __future__ import annotations

from typing import Any

import pytest

from ghal360_robot.telepresence.gate import FUTURE_US, MAX_AGE_US, TAKEN, Gate, judge
from ghal360_robot.telepresence.protocol import Operate
from tests.telepresence.test_protocol import OPERATE

NOW_US = 5_000_000
GATE = Gate("abc")


def wish(**changes: Any) -> Operate:
    return Operate.model_validate({**OPERATE, "stick": None, **changes})


def test_a_fresh_wish_of_the_driver_is_taken_once() -> None:
    gate, verdict = judge(GATE, wish(seq=7, arm=1), NOW_US, drives=True)
    assert (verdict, gate.seq, gate.arm) == (TAKEN, 7, 1)
    again, verdict = judge(gate, wish(seq=7, arm=1), NOW_US, drives=True)
    assert again is gate
    assert "replayed" in verdict


@pytest.mark.parametrize(
    ("changes", "drives", "words"),
    [
        ({"conn": "xyz"}, True, "another connection"),
        ({"sent_us": NOW_US + FUTURE_US + 1}, True, "in the future"),
        ({"sent_us": NOW_US - MAX_AGE_US - 1}, True, "s old"),
        ({}, False, "not the driver's"),
    ],
)
def test_what_is_not_taken_leaves_no_trace(changes: dict[str, Any], drives: bool, words: str) -> None:
    gate, verdict = judge(GATE, wish(**changes), NOW_US, drives=drives)
    assert gate is GATE
    assert words in verdict


@pytest.mark.parametrize("sent_us", [NOW_US - MAX_AGE_US, NOW_US, NOW_US + FUTURE_US])
def test_the_limits_themselves_are_inside(sent_us: int) -> None:
    assert judge(GATE, wish(sent_us=sent_us), NOW_US, drives=True)[1] == TAKEN


@pytest.mark.parametrize("count", ["arm", "disarm", "found"])
def test_presses_never_count_backwards(count: str) -> None:
    gate, _ = judge(GATE, wish(seq=1, **{count: 2}), NOW_US, drives=True)
    assert "backwards" in judge(gate, wish(seq=2, **{count: 1}), NOW_US, drives=True)[1]


def test_a_stamp_of_the_future_does_not_make_what_follows_old() -> None:
    gate, _ = judge(GATE, wish(seq=1, sent_us=NOW_US * 100), NOW_US, drives=True)
    assert judge(gate, wish(seq=2), NOW_US, drives=True)[1] == TAKEN
