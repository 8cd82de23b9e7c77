"""The base's fault log: what was written is read, and any words at all are read without complaint."""

from __future__ import annotations

from datetime import timedelta

from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.codec.fault_log import (
    ENTRIES,
    ENTRY_WORDS,
    EPOCH,
    FAULT_LOG_WORDS,
    HEADER_WORDS,
    PACKET_WORDS,
    PACKETS,
    FaultEntry,
    FaultLog,
    decode_fault_log,
    encode_fault_log,
)
from drivers.rmp110.codec.faults import LOG_GROUPS, dynamic_response_texts

words = st.integers(0, 0xFFFFFFFF)


def entry(index: int, *, latest: bool = False, **groups: int) -> FaultEntry:
    values = tuple(groups.get(name.replace(" ", "_"), 0) for name, _ in LOG_GROUPS)
    return FaultEntry(index, latest, EPOCH + timedelta(days=2000), 3600, 7, values, (0x3F800000, 0, 0, 0))


def log(*entries: FaultEntry, latest: int = 0) -> FaultLog:
    return FaultLog(1, 1244, len(entries), latest, 0x1234_0000_0110, 1246, 1279, 7200, 1500, 9, entries)


def test_the_log_has_311_words_and_fits_six_packets() -> None:
    assert FAULT_LOG_WORDS == 311
    assert PACKETS * PACKET_WORDS == FAULT_LOG_WORDS + 1


def test_an_entry_says_when_how_long_and_what() -> None:
    kill = entry(3, latest=True, architecture=0x40, motor_controllers=0x20)
    older = entry(2, critical=0x80, transient=0x1)
    decoded = decode_fault_log(encode_fault_log(log(kill, older, latest=3)))
    assert decoded == log(kill, older, latest=3)
    assert decoded.entries[0].texts == (
        "motor controllers: motor controller 1 failed",
        "architecture: kill switch active",
    )
    assert decoded.entries[1].texts == ("transient: unknown bit 0x1", "critical: velocity control failed")
    assert decoded.entries[0].when.isoformat() == "2016-06-23T00:00:00-05:00"
    assert decoded.serial == 0x123400000110


def test_the_ring_is_read_newest_first() -> None:
    decoded = decode_fault_log(encode_fault_log(log(*(entry(n, sensors=1) for n in (0, 1, 18, 19)), latest=1)))
    assert [one.index for one in decoded.entries] == [1, 0, 19, 18]
    assert [one.latest for one in decoded.entries] == [True, False, False, False]


def test_an_empty_or_cut_log_is_no_error() -> None:
    assert decode_fault_log([0] * FAULT_LOG_WORDS).entries == ()
    assert decode_fault_log([]).entries == ()
    assert decode_fault_log(encode_fault_log(log(entry(0, sensors=1)))[:14]).entries[0].texts == ()


@given(st.lists(words, max_size=400))
def test_any_words_are_a_log(garbage: list[int]) -> None:
    decoded = decode_fault_log(garbage)
    assert len(decoded.entries) <= ENTRIES
    for one in decoded.entries:
        assert len(one.texts) == sum(word.bit_count() for word in one.groups)


@given(st.lists(words, min_size=FAULT_LOG_WORDS, max_size=FAULT_LOG_WORDS))
def test_decoding_and_encoding_are_inverse(values: list[int]) -> None:
    assert encode_fault_log(decode_fault_log(values)) == tuple(values)
    assert len(values) == HEADER_WORDS + ENTRIES * ENTRY_WORDS


def test_the_dynamic_response_is_told_in_words() -> None:
    assert dynamic_response_texts(0) == ()
    assert dynamic_response_texts(0x201) == (
        "unknown bit 0x1",
        "it switches off after its kill switch was pressed",
    )
