from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.messages import Inputs, Twist
from ghal360_robot.safety.derating import (
    BATTERY,
    LATENCY,
    RULES,
    TEMPERATURE,
    WHEELS,
    Derating,
    Level,
    Reading,
    derate,
    step,
    stops,
)
from tests.safety.conftest import TICK_NS, inputs

FULL = Twist(0.4, -0.6)


def tick(n: int = 0, *, latency_s: float = 0.0, warnings: tuple[str, ...] = (), **base: object) -> Inputs:
    healthy = inputs(n)
    assert healthy.base is not None
    assert healthy.operator is not None
    return replace(
        healthy,
        base=replace(healthy.base, warnings=warnings, **base),  # type: ignore[arg-type]
        operator=replace(healthy.operator, latency_s=latency_s),
    )


def levels(values: list[Inputs]) -> list[list[str]]:
    state, said = Derating(), []
    for value in values:
        state, readings = step(state, value)
        said.append([f"{reading.level.name} {reading.words}" for reading in readings])
    return said


def test_a_healthy_robot_has_nothing_to_say_and_keeps_its_speed() -> None:
    state, readings = step(Derating(), inputs(0))
    assert readings == ()
    assert state.levels == (Level.FINE,) * len(RULES)
    assert derate(FULL, readings) == (FULL, ())


def test_latency_warns_slows_and_stops_and_comes_back_with_hysteresis() -> None:
    course = [0.299, 0.3, 0.49, 0.5, 0.799, 0.8, 0.76, 0.75, 0.46, 0.45, 0.26, 0.25]
    said = levels([tick(latency_s=value) for value in course])
    assert [one[0].split()[0] if one else "" for one in said] == [
        "", "WARN", "WARN", "DERATE", "DERATE", "STOP", "STOP", "DERATE", "DERATE", "WARN", "WARN", "",
    ]  # fmt: skip
    assert said[3] == ["DERATE latency 0.5 s"]


def test_a_battery_gets_worse_downwards() -> None:
    course = [25.1, 25.0, 15.0, 8.1, 8.0, 9.9, 10.0, 16.9, 17.0, 26.9, 27.0]
    said = levels([tick(battery_percent=value) for value in course])
    assert [one[0].split()[0] if one else "" for one in said] == [
        "", "WARN", "DERATE", "DERATE", "STOP", "STOP", "DERATE", "DERATE", "WARN", "WARN", "",
    ]  # fmt: skip
    assert said[2] == ["DERATE battery 15 %"]


def test_a_jump_over_levels_takes_the_right_one_in_both_directions() -> None:
    assert levels([tick(temperature_degc=v) for v in (20.0, 61.0, 20.0)]) == [[], ["STOP temperature 61 degC"], []]


def test_what_nobody_tells_is_fine_and_what_is_no_number_is_the_worst() -> None:
    assert levels([tick(temperature_degc=None)]) == [[]]
    assert levels([tick(temperature_degc=math.nan)])[0][0].startswith("STOP temperature nan")
    assert levels([tick(latency_s=math.inf)])[0][0].startswith("STOP latency")
    assert levels([replace(tick(), base=None, operator=None)]) == [[]]


def test_wheels_that_warn_slow_down_at_once_and_stop_after_a_while() -> None:
    course = [tick(n, warnings=("it slips",) if 5 <= n < 90 else ()) for n in range(100)]
    said = levels(course)
    assert said[4] == []
    assert said[5] == ["DERATE it slips"]
    assert said[79] == ["DERATE it slips"]
    assert said[80] == ["STOP it slips"]  # 75 ticks of 20 ms
    assert said[90] == []
    assert course[80].stamp_ns - course[5].stamp_ns == 75 * TICK_NS


def test_every_warning_is_said() -> None:
    said = levels([tick(warnings=("left slips", "right stalls"), latency_s=0.4)])
    assert said == [["WARN latency 0.4 s", "DERATE left slips, right stalls"]]


def test_the_least_share_counts_and_slows_drive_and_turn_alike() -> None:
    rules = {rule.name: rule for rule in RULES}
    slow = Reading(rules[LATENCY], Level.DERATE, "a")
    slower = Reading(rules[WHEELS], Level.DERATE, "b")
    warning = Reading(rules[BATTERY], Level.WARN, "c")
    assert derate(FULL, (slow,)) == (Twist(0.2, -0.3), ("slow: a",))
    twist, said = derate(FULL, (slow, slower, warning))
    assert (twist.v, twist.w) == pytest.approx((0.16, -0.24))
    assert said == ("slow: a", "slow: b", "c")


def test_what_stops_either_holds_or_disarms() -> None:
    rules = {rule.name: rule for rule in RULES}
    readings = tuple(Reading(rules[name], Level.STOP, name) for name in (LATENCY, BATTERY, TEMPERATURE, WHEELS))
    assert stops(readings, disarms=False) == (LATENCY,)
    assert stops(readings, disarms=True) == (BATTERY, TEMPERATURE, WHEELS)
    assert stops(tuple(replace(r, level=Level.DERATE) for r in readings), disarms=True) == ()


@given(st.lists(st.one_of(st.floats(), st.floats(0.0, 1.0)), min_size=1, max_size=20))
def test_a_level_is_never_lower_than_its_thresholds_say(values: list[float]) -> None:
    state = Derating()
    rule = RULES[0]
    for value in values:
        state, _ = step(state, tick(latency_s=value), (rule,))
        level = state.levels[0]
        assert level is Level.STOP or (value < rule.stop and math.isfinite(value))
        assert level >= Level.DERATE or value < rule.derate
        assert level >= Level.WARN or value < rule.warn
        if math.isfinite(value) and value <= rule.warn - rule.hysteresis:
            assert level is Level.FINE
