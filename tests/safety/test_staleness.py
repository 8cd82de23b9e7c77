from __future__ import annotations

import math
from dataclasses import replace

import pytest

from ghal360_robot.messages import Freshness, Inputs
from ghal360_robot.safety.limits import SafetyLimits
from ghal360_robot.safety.staleness import Staleness, judge, unanswered
from tests.safety.conftest import FRESH, TICK_NS, inputs

LIMITS = SafetyLimits()
WORDS = [("operator", "operator"), ("tim571", "lidar"), ("rmp110", "base"), ("theta", "video")]


def with_one(name: str, fresh: Freshness) -> Inputs:
    tick = inputs(5)
    return replace(tick, freshness={**tick.freshness, name: fresh})


def test_all_fresh_is_nothing_to_say() -> None:
    assert judge(inputs(5), LIMITS) == Staleness()


@pytest.mark.parametrize(("name", "word"), WORDS)
def test_an_input_ages_from_fresh_over_stale_to_lost(name: str, word: str) -> None:
    hold_s, lost_s = dict(LIMITS.hold_s)[name], dict(LIMITS.lost_s)[name]
    silent = frozenset({name})
    assert judge(with_one(name, replace(FRESH, age_s=hold_s)), LIMITS) == Staleness()
    stale = Staleness(hold=(f"{word} stale",), silent=silent)
    assert judge(with_one(name, replace(FRESH, age_s=math.nextafter(hold_s, 9))), LIMITS) == stale
    assert judge(with_one(name, replace(FRESH, age_s=lost_s)), LIMITS) == stale
    lost = Staleness(lost=(f"{word} lost",), silent=silent)
    assert judge(with_one(name, replace(FRESH, age_s=math.nextafter(lost_s, 9))), LIMITS) == lost
    assert judge(with_one(name, replace(FRESH, age_s=math.nan)), LIMITS) == lost
    assert judge(with_one(name, replace(FRESH, age_s=math.inf)), LIMITS) == lost


@pytest.mark.parametrize(("name", "word"), WORDS)
def test_an_input_that_is_not_valid_is_lost_and_one_that_is_slow_holds(name: str, word: str) -> None:
    assert judge(with_one(name, replace(FRESH, valid=False)), LIMITS) == Staleness(lost=(f"{word} not valid",))
    assert judge(with_one(name, replace(FRESH, rate_ok=False)), LIMITS) == Staleness(hold=(f"{word} slow",))


def test_an_input_that_nobody_knows_is_lost() -> None:
    tick = replace(inputs(5), freshness={})
    stale = judge(tick, LIMITS)
    assert stale.lost == ("operator lost", "lidar lost", "base lost", "video lost")
    assert stale.silent == {"operator", "tim571", "rmp110", "theta"}


@pytest.mark.parametrize(("ahead_ns", "held"), [(TICK_NS, False), (TICK_NS + 1, True)])
def test_an_operator_from_the_future_is_silent(ahead_ns: int, held: bool) -> None:
    tick = inputs(5)
    assert tick.operator is not None
    tick = replace(tick, operator=replace(tick.operator, stamp_ns=tick.stamp_ns + ahead_ns))
    expected = Staleness(hold=("operator stamps from the future",), silent=frozenset({"operator"}))
    assert judge(tick, LIMITS) == (expected if held else Staleness())


def test_an_unknown_name_is_said_as_it_is() -> None:
    limits = SafetyLimits(hold_s=(("gps", 1.0),), lost_s=(("gps", 2.0),))
    assert judge(inputs(5), limits).lost == ("gps lost",)
    assert judge(replace(inputs(5), operator=None), limits).hold == ()


@pytest.mark.parametrize(
    ("age_s", "late"), [(0.0, False), (0.08, False), (0.0801, True), (math.nan, True), (math.inf, True)]
)
def test_a_base_that_answers_nothing_for_four_ticks_may_not_have_heard_the_last_commands(
    age_s: float, late: bool
) -> None:
    assert unanswered(with_one("rmp110", replace(FRESH, age_s=age_s))) == ("base answers late" if late else "")
    assert unanswered(replace(inputs(5), freshness={})) == "base answers late"
