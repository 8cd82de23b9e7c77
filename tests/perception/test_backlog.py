"""What waits to be decoded: newest wins, chains stay whole."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.perception.backlog import (
    IDR_PATIENCE_UNITS,
    AccessUnit,
    Backlog,
    access_unit,
    nal_types,
)


def unit(number: int, kind: str = "P") -> AccessUnit:
    return AccessUnit(b"", number, number, tainted=False, idr=kind == "I", parameters=kind in "IS")


def drain(backlog: Backlog) -> list[int]:
    numbers = []
    while (waiting := backlog.pop()) is not None:
        numbers.append(waiting.number)
    return numbers


def test_nothing_is_dropped_while_there_is_room() -> None:
    backlog = Backlog(4)
    for number in range(4):
        backlog.push(unit(number))
    assert drain(backlog) == [0, 1, 2, 3]
    assert backlog.dropped == 0


def test_an_overflow_jumps_to_the_newest_idr_that_waits() -> None:
    backlog = Backlog(4)
    for number, kind in enumerate("IPIPP"):
        backlog.push(unit(number, kind))
    assert drain(backlog) == [2, 3, 4]
    assert backlog.dropped == 2


def test_an_overflow_without_idr_waits_for_the_next_one() -> None:
    backlog = Backlog(3)
    for number, kind in enumerate("PPPPPPIP"):
        backlog.push(unit(number, kind))
    assert drain(backlog) == [6, 7]
    assert backlog.dropped == 6


def test_parameter_sets_pass_while_waiting_for_an_idr() -> None:
    backlog = Backlog(2)
    for number, kind in enumerate("PPPPSPI"):
        backlog.push(unit(number, kind))
    assert drain(backlog) == [4, 6]


def test_a_stream_without_idrs_is_taken_up_again_after_a_while() -> None:
    backlog = Backlog(1)
    for number in range(2 + IDR_PATIENCE_UNITS):
        backlog.push(unit(number))
    assert len(backlog) == 0
    backlog.push(unit(1000))
    assert drain(backlog) == [1000]


@given(st.text("PPPPIS", max_size=300), st.integers(1, 9), st.integers(1, 12))
def test_what_comes_out_is_in_order_bounded_and_accounted_for(kinds: str, capacity: int, take_every: int) -> None:
    backlog = Backlog(capacity)
    out: list[int] = []
    for number, kind in enumerate(kinds):
        backlog.push(unit(number, kind))
        assert len(backlog) <= capacity
        if number % take_every == 0 and (waiting := backlog.pop()) is not None:
            out.append(waiting.number)
    out += drain(backlog)
    assert out == sorted(set(out))
    assert len(out) + backlog.dropped == len(kinds)


@given(st.text("PPPPI", max_size=IDR_PATIENCE_UNITS), st.integers(1, 9), st.integers(2, 12))
def test_after_every_gap_the_first_unit_is_an_idr(kinds: str, capacity: int, take_every: int) -> None:
    backlog = Backlog(capacity)
    out = []
    for number, kind in enumerate("I" + kinds):
        backlog.push(unit(number, kind))
        if number % take_every == 0 and (waiting := backlog.pop()) is not None:
            out.append(waiting)
    while (waiting := backlog.pop()) is not None:
        out.append(waiting)
    previous = -1
    for waiting in out:
        assert waiting.number == previous + 1 or waiting.idr
        previous = waiting.number


def test_a_backlog_without_room_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        Backlog(0)


def test_nal_headers_tell_what_a_unit_is(stream: list[bytes]) -> None:
    kinds = [access_unit(data, 0, 0, tainted=False) for data in stream]
    assert [i for i, kind in enumerate(kinds) if kind.idr] == [0, 5, 10, 15]
    assert [i for i, kind in enumerate(kinds) if kind.parameters] == [0, 5, 10, 15]
    assert nal_types(stream[1])[-1] == 1


@given(st.binary(max_size=400))
def test_nal_headers_of_hostile_bytes_are_bounded_and_never_raise(data: bytes) -> None:
    assert len(nal_types(data)) <= 16
    assert len(nal_types(b"\0\0\1\7" * 100 + data)) == 16


@pytest.mark.parametrize("data", [b"", b"\0\0\1", b"\0\0\0\1", b"\xff" * 50])
def test_bytes_without_a_nal_unit_have_no_types(data: bytes) -> None:
    assert nal_types(data) == ()
