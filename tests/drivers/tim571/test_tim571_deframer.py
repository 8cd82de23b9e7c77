"""Frames survive any cut and any damage of the stream around them."""

from __future__ import annotations

import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.tim571.codec import commands
from drivers.tim571.codec.deframer import MAX_PAYLOAD, Damage, Deframer, Frame
from drivers.tim571.codec.dialect import Dialect, checksum, frame

GOOD = {d: commands.read(d, "FirmwareVersion").to_wire() for d in Dialect}
HARD_BYTES = st.sampled_from([b"\x02", b"\x03", b"\x02\x02\x02\x02", b"\x00\x00", b"sRN", b"sRA x", b" ", b"\x00\x05"])


def pieces_of(dialect: Dialect) -> st.SearchStrategy[list[bytes]]:
    """Streams made of good frames, cut frames, spoilt frames and noise that looks like framing."""
    good = st.binary(max_size=40).map(
        lambda b: frame(dialect, b"sRN " + (b.hex().encode() if dialect is Dialect.A else b))
    )
    cut = st.tuples(good, st.integers(0, 30)).map(lambda t: t[0][: t[1]])
    spoilt = st.tuples(good, st.integers(0, 30), st.integers(1, 255)).map(
        lambda t: bytes(b ^ t[2] if i == t[1] else b for i, b in enumerate(t[0]))
    )
    noise = st.one_of(HARD_BYTES, st.binary(max_size=20))
    return st.lists(st.one_of(good, cut, spoilt, noise), max_size=12)


def everything(dialect: Dialect, chunks: list[bytes]) -> list[Frame | Damage]:
    deframer = Deframer(dialect)
    events = [event for chunk in chunks for event in deframer.feed(chunk)]
    return events + deframer.close()


@given(data=st.data())
@settings(max_examples=60, deadline=None)
@pytest.mark.parametrize("dialect", list(Dialect), ids=str)
def test_events_do_not_depend_on_how_the_stream_is_cut(dialect: Dialect, data: st.DataObject) -> None:
    stream = b"".join(data.draw(pieces_of(dialect)))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=20)))
    chunks = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    whole = everything(dialect, [stream])
    assert everything(dialect, chunks) == whole
    assert everything(dialect, [bytes([byte]) for byte in stream]) == whole


@given(data=st.data())
@settings(max_examples=60, deadline=None)
@pytest.mark.parametrize("dialect", list(Dialect), ids=str)
def test_a_good_frame_behind_any_damage_is_delivered(dialect: Dialect, data: st.DataObject) -> None:
    damage = b"".join(data.draw(pieces_of(dialect)))
    events = everything(dialect, [damage, GOOD[dialect]])
    assert isinstance(events[-1], Frame)
    assert events[-1].data == GOOD[dialect]


@given(data=st.data())
@settings(max_examples=50, deadline=None)
@pytest.mark.parametrize("dialect", list(Dialect), ids=str)
def test_every_byte_is_a_frame_or_damage_or_padding(dialect: Dialect, data: st.DataObject) -> None:
    stream = b"".join(data.draw(pieces_of(dialect)))
    events = everything(dialect, [stream])
    sizes = [len(event.data) if isinstance(event, Frame) else event.size for event in events]
    padding = sum(stream.count(byte) for byte in (b"\x00", b"\r", b"\n", b" "))
    shared = 10 * sum(isinstance(event, Frame) for event in events)
    assert len(stream) - padding <= sum(sizes) <= len(stream) + shared


@given(noise=st.binary(max_size=4000))
@settings(max_examples=60, deadline=None)
@pytest.mark.parametrize("dialect", list(Dialect), ids=str)
def test_noise_never_raises_and_never_fills_the_memory(dialect: Dialect, noise: bytes) -> None:
    deframer = Deframer(dialect)
    for _ in range(40):
        deframer.feed(noise)
        assert deframer.buffered <= MAX_PAYLOAD + 9


def test_a_bad_checksum_costs_one_frame() -> None:
    good = GOOD[Dialect.B]
    bad = good[:-1] + bytes([good[-1] ^ 1])
    assert everything(Dialect.B, [good + bad + good]) == [
        Frame(0, good),
        Damage("checksum", len(bad)),
        Frame(0, good),
    ]


def test_an_absurd_length_costs_nothing_behind_it() -> None:
    good = GOOD[Dialect.B]
    absurd = b"\x02\x02\x02\x02\x7f\xff\xff\xff"
    assert everything(Dialect.B, [absurd + good]) == [Damage("noise", 8), Frame(0, good)]


def test_a_plausible_wrong_length_does_not_hold_the_next_frame_back() -> None:
    good = GOOD[Dialect.B]
    deframer = Deframer(Dialect.B)
    assert deframer.feed(b"\x02\x02\x02\x02\x00\x00\xf0\x00" + good[8:]) == []
    assert deframer.feed(good) == [Damage("truncated", len(good)), Frame(0, good)]


def test_a_truncated_frame_is_dropped_even_if_the_checksum_happens_to_match() -> None:
    good = GOOD[Dialect.B]
    swallowing = frame(Dialect.B, b"sRN half" + good)
    assert everything(Dialect.B, [swallowing]) == [Damage("truncated", 16), Frame(0, good), Damage("noise", 1)]


def test_a_cut_frame_whose_end_falls_into_the_next_header_by_a_lucky_checksum_does_not_hide_it() -> None:
    good = GOOD[Dialect.B]
    for reach in range(1, 10):
        payload = b"sRN Cut" + good[: reach - 1]
        fill = next(f for f in range(256) if checksum(payload + bytes([f])) == good[reach - 1])
        cut = b"\x02\x02\x02\x02\x00\x00\x00" + bytes([8 + reach - 1]) + b"sRN Cut" + bytes([fill])
        for chunks in ([cut + good], [cut, good], [bytes([byte]) for byte in cut + good]):
            frames = [event.data for event in everything(Dialect.B, chunks) if isinstance(event, Frame)]
            assert frames == [cut + good[:reach], good]


def test_the_magic_inside_a_payload_is_payload() -> None:
    inside = frame(Dialect.B, b"sSN LMDscandata " + b"\x02" * 50)
    assert everything(Dialect.B, [inside[:30], inside[30:]]) == [Frame(0, inside)]


def test_a_stray_02_before_the_magic_is_skipped() -> None:
    good = GOOD[Dialect.B]
    assert everything(Dialect.B, [b"\x02" + good]) == [Damage("noise", 1), Frame(0, good)]


def test_a_truncated_text_frame_does_not_take_the_next_one_along() -> None:
    good = GOOD[Dialect.A]
    assert everything(Dialect.A, [good[:-4] + good]) == [Damage("truncated", len(good) - 4), Frame(0, good)]


def test_padding_between_frames_is_no_damage() -> None:
    for good in GOOD.values():
        dialect = Dialect.A if good == GOOD[Dialect.A] else Dialect.B
        assert everything(dialect, [good + b"\x00" + good + b"\r\n" + good]) == [Frame(0, good)] * 3


def test_a_text_frame_without_end_is_given_up() -> None:
    deframer = Deframer(Dialect.A)
    for _ in range(30):
        deframer.feed(b"\x02sRA " + b"1 " * 20000)
        assert deframer.buffered <= MAX_PAYLOAD + 2
    events = deframer.feed(b"\x02sRA " + b"1 " * 40000) + deframer.feed(GOOD[Dialect.A])
    assert Damage("oversized", 14470) in events
    assert events[-1] == Frame(0, GOOD[Dialect.A])


def test_a_frame_is_stamped_with_the_arrival_of_its_first_byte(dialect: Dialect) -> None:
    good = GOOD[dialect]
    deframer = Deframer(dialect)
    assert deframer.feed(good + good[:5], 100) == [Frame(100, good)]
    assert deframer.feed(good[5:-1], 200) == []
    assert deframer.feed(good[-1:] + good, 300) == [Frame(100, good), Frame(300, good)]


@pytest.mark.parametrize("seed", range(5))
def test_real_scans_come_through_a_damaged_stream(cola_b_scans: list[bytes], seed: int) -> None:
    rng = random.Random(seed)
    stream, intact = [], []
    for scan in cola_b_scans:
        fate = rng.random()
        if fate < 0.1:
            stream.append(scan[: rng.randrange(len(scan))])
        elif fate < 0.2:
            at = rng.randrange(len(scan))
            stream.append(scan[:at] + bytes([scan[at] ^ (1 + rng.randrange(255))]) + scan[at + 1 :])
        elif fate < 0.3:
            stream += (rng.randbytes(rng.randrange(200)), scan)
            intact.append(scan)
        else:
            stream.append(scan)
            intact.append(scan)
    received = [e.data for e in everything(Dialect.B, stream) if isinstance(e, Frame)]
    assert received == intact


def test_recordings_come_back_frame_by_frame(cola_a_scans: list[bytes], cola_b_frames: list[bytes]) -> None:
    for dialect, frames in ((Dialect.A, cola_a_scans), (Dialect.B, cola_b_frames)):
        events: list[Any] = everything(dialect, [b"".join(frames)])
        assert [event.data for event in events] == frames
