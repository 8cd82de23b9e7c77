from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.messages import STILL, Command, Lock, Twist
from ghal360_robot.safety.mux import FUTURE_NS, SOURCES, LockRule, Source, Taken, asked, take
from tests.safety.conftest import inputs

NOW = 10_000_000_000
HIGH, LOW = Source("high", 100, 0.2, 1.0), Source("low", 10, 0.3, 2.0)
BOTH = (LOW, HIGH)
GO, BACK = Twist(0.3, 0.1), Twist(-0.1, 0.0)


def ago(source: str, seconds: float, twist: Twist = GO) -> Command:
    return Command(source, NOW - round(seconds * 1e9), twist)


def chosen(*commands: Command, locks: tuple[Lock, ...] = (), rules: tuple[LockRule, ...] = ()) -> Taken:
    return take(commands, locks, NOW, BOTH, rules)


def test_the_live_source_of_the_highest_priority_wins_whatever_the_order() -> None:
    high, low = ago("high", 0.0, BACK), ago("low", 0.0)
    assert chosen(high, low) == chosen(low, high) == Taken("high", BACK)
    assert chosen(low) == Taken("low", GO)


def test_a_source_holds_at_its_limit_and_one_nanosecond_later_it_is_silent() -> None:
    assert chosen(ago("high", 0.2), ago("low", 0.0)) == Taken("high", GO)
    late = replace(ago("high", 0.2), stamp_ns=NOW - 200_000_001)
    assert chosen(late, ago("low", 0.0)) == Taken("high", STILL, ("high is silent",))


def test_a_source_that_was_silent_for_long_gives_way() -> None:
    assert chosen(ago("high", 1.0), ago("low", 0.0)).source == "high"
    gone = replace(ago("high", 1.0), stamp_ns=NOW - 1_000_000_001)
    assert chosen(gone, ago("low", 0.0)) == Taken("low", GO)


def test_nobody_asking_is_a_standstill_with_a_reason() -> None:
    assert chosen() == chosen(ago("stranger", 0.0)) == Taken(held=("nobody asks for motion",))


def test_a_stamp_from_the_future_is_not_followed_and_does_not_give_way() -> None:
    near, far = NOW + FUTURE_NS, NOW + FUTURE_NS + 1
    assert chosen(Command("high", near, GO)) == Taken("high", GO)
    assert chosen(Command("high", far, GO), ago("low", 0.0)) == Taken("high", STILL, ("high: stamp from the future",))


@pytest.mark.parametrize(("priority", "held"), [(100, False), (101, True), (10, False)])
def test_an_engaged_lock_holds_sources_of_lower_priority_only(priority: int, held: bool) -> None:
    lock, rule = Lock("pause", NOW, engaged=True), LockRule("pause", priority)
    expected = Taken("high", STILL, ("held by lock 'pause'",)) if held else Taken("high", GO)
    assert chosen(ago("high", 0.0), locks=(lock,), rules=(rule,)) == expected


def test_a_lock_that_is_open_and_fresh_lets_pass() -> None:
    lock = Lock("pause", NOW - 500_000_000, engaged=False)
    assert chosen(ago("high", 0.0), locks=(lock,), rules=(LockRule("pause"),)).held == ()


@pytest.mark.parametrize("stamp_ns", [NOW - 500_000_001, NOW + FUTURE_NS + 1, None])
def test_a_lock_whose_publisher_is_silent_holds(stamp_ns: int | None) -> None:
    locks = () if stamp_ns is None else (Lock("pause", stamp_ns, engaged=False),)
    held = chosen(ago("high", 0.0), locks=locks, rules=(LockRule("pause"),))
    assert held == Taken("high", STILL, ("lock 'pause' is silent",))


def test_a_lock_that_nobody_configured_holds_everybody_while_engaged_or_silent() -> None:
    assert chosen(ago("high", 0.0), locks=(Lock("x", NOW, engaged=False),)).held == ()
    assert chosen(ago("high", 0.0), locks=(Lock("x", NOW, engaged=True),)).held == ("held by lock 'x'",)
    assert chosen(ago("high", 0.0), locks=(Lock("x", 0, engaged=False),)).held == ("lock 'x' is silent",)


def test_the_highest_of_several_locks_counts_and_is_named() -> None:
    locks = (Lock("a", NOW, engaged=True), Lock("b", NOW, engaged=True))
    rules = (LockRule("a", 150), LockRule("b", 60))
    assert chosen(ago("high", 0.0), locks=locks, rules=rules).held == ("held by lock 'a'",)
    assert chosen(ago("high", 0.0), locks=locks[1:], rules=rules[1:]) == Taken("high", GO)
    assert chosen(ago("low", 0.0), locks=locks[1:], rules=rules[1:]).held == ("held by lock 'b'",)


def test_the_first_of_locks_that_hold_alike_is_named() -> None:
    locks = (Lock("a", NOW, engaged=True), Lock("b", NOW, engaged=True))
    assert chosen(ago("high", 0.0), locks=locks, rules=(LockRule("a"), LockRule("b"))).held == ("held by lock 'a'",)


def test_a_lock_as_fresh_as_can_be_is_not_silent_and_the_lowest_source_is_held_by_locks_only() -> None:
    lowest, command = (Source("low", 0, 0.3, 2.0),), ago("low", 0.0)
    assert take((command,), (), NOW, lowest) == Taken("low", GO)
    fresh = Lock("a", NOW + FUTURE_NS, engaged=False)
    assert take((command,), (fresh,), NOW, lowest, (LockRule("a", 1),)) == Taken("low", GO)
    engaged = replace(fresh, engaged=True)
    assert take((command,), (engaged,), NOW, lowest, (LockRule("a", 1),)).held == ("held by lock 'a'",)


def test_everybody_asks_at_each_tick_and_nobody_borrows_a_name() -> None:
    tick = inputs(3)
    assert tick.operator is not None
    forged = (Command("teleop", 1, BACK), Command("autonomy", 1, BACK), Command("test", 2, BACK))
    tick = replace(tick, commands=forged)
    assert asked(tick, GO) == (Command("autonomy", tick.stamp_ns, GO), forged[2])
    stick = replace(tick, operator=replace(tick.operator, stick=BACK, stamp_ns=7))
    assert asked(stick, GO) == (Command("teleop", 7, BACK), Command("autonomy", tick.stamp_ns, GO), forged[2])
    assert asked(replace(tick, operator=None), GO) == asked(tick, GO)


def test_a_stick_overrides_a_test_and_both_override_the_gaze() -> None:
    order = sorted(SOURCES, key=lambda source: -source.priority)
    assert [source.name for source in order] == ["teleop", "test", "autonomy"]
    assert all(0 < source.hold_s <= 0.3 and source.gone_s == 1.0 for source in SOURCES)


stamps = st.one_of(st.integers(NOW - 3_000_000_000, NOW + 100_000_000), st.integers(-(2**62), 2**62))
commands = st.lists(st.builds(Command, st.sampled_from(["high", "low", "x"]), stamps, st.just(GO)), max_size=6)
locks = st.lists(st.builds(Lock, st.sampled_from(["a", "b"]), stamps, st.booleans()), max_size=4)


@given(commands, locks, st.lists(st.builds(LockRule, st.sampled_from(["a", "b"]), st.integers(1, 255)), max_size=2))
def test_whatever_comes_only_a_fresh_command_moves_and_everything_else_is_zero_with_a_reason(
    commands: list[Command], locks: list[Lock], rules: list[LockRule]
) -> None:
    taken = take(commands, locks, NOW, BOTH, rules)
    if taken.held:
        assert taken.twist == STILL
        return
    source = next(source for source in BOTH if source.name == taken.source)
    newest = {command.source: command for command in commands}[taken.source]
    assert NOW - source.hold_s * 1e9 <= newest.stamp_ns <= NOW + FUTURE_NS
    assert all(
        lock.name in {rule.name for rule in rules} or not lock.engaged for lock in {k.name: k for k in locks}.values()
    )
