"""The dialects' tables against what the fact sheet counts, and that no number means two things at once."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.codec.commands import POLL, configure, request_mode
from drivers.rmp110.codec.dialect import Action, Dialect
from drivers.rmp110.codec.frames import CONFIG_ID, Frame, unpack_words
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, Stored
from drivers.rmp110.codec.vocabulary import B1, B2, B3, VOCABULARIES, Vocabulary
from drivers.rmp110.codec.whitelist import forbidden
from drivers.rmp110.device.state import NEEDED

BOOKS = pytest.mark.parametrize("book", [B1, B2, B3], ids=["B1", "B2", "B3"])
frames = st.builds(
    lambda number, word: Frame(CONFIG_ID, number.to_bytes(4, "big") + word.to_bytes(4, "big")),
    st.integers(0, 40),
    st.one_of(st.integers(0, 40), st.integers(0, 0xFFFFFFFF)),
)


def place(book: Vocabulary, name: str) -> tuple[int, int]:
    return next((word.bitmap, word.bit) for word in book.words if word.name == name)


@BOOKS
def test_a_dialect_has_unique_names_and_numbers(book: Vocabulary) -> None:
    assert len({word.name for word in book.words}) == len(book.words)
    numbers = [*(parameter.number for parameter in book.parameters), *book.actions.values()]
    assert len(set(numbers)) == len(numbers)
    assert VOCABULARIES[book.dialect] is book


@BOOKS
def test_the_compact_set_is_eleven_frames_with_all_that_the_driver_needs(book: Vocabulary) -> None:
    layout = book.layout(book.compact_bitmaps)
    assert layout.frame_count == 11
    assert layout.missing(NEEDED) == ()
    assert all(bits & ~valid == 0 for bits, valid in zip(book.compact_bitmaps, book.valid_bitmaps, strict=True))


def test_word_counts_and_reply_lengths_are_those_of_the_sheet() -> None:
    assert [len(book.words) for book in (B1, B2, B3)] == [85, 96, 89]
    assert [book.config_reply_frames for book in (B1, B2, B3)] == [9, 10, 11]
    assert [book.layout(book.factory_bitmaps).frame_count for book in (B1, B2, B3)] == [43, 48, 44]


@pytest.mark.parametrize(
    ("book", "name", "where"),
    [
        (B1, "vel_target_mps", (2, 24)),
        (B1, "fram_vel_limit_mps", (2, 26)),
        (B1, "fram_yaw_rate_limit_rps", (2, 31)),
        (B1, "fram_tire_diameter_m", (3, 1)),
        (B1, "aux_batt_voltage_V", (3, 12)),
        (B1, "ccu_uip_sw_build_id", (3, 20)),
        (B2, "vel_target_mps", (2, 24)),
        (B2, "user_feedback_bitmap_4", (3, 31)),
        (B3, "mcu_1_batt_soc", (1, 8)),
        (B3, "abb_system_status", (1, 15)),
        (B3, "mcu_1_total_energy_Wh", (1, 23)),
        (B3, "right_front_pos_m", (1, 31)),
        (B3, "yaw_rate_target_rps", (2, 3)),
        (B3, "fram_eth_gateway", (2, 22)),
        (B3, "fram_lateral_accel_limit_mps2", (2, 27)),
        (B3, "imu_x_rate_rps", (2, 31)),
        (B3, "imu_timestamp", (3, 8)),
        (B3, "imu_status", (3, 22)),
        (B3, "packed_build_ids", (3, 24)),
    ],
)
def test_a_word_stands_where_the_sheet_has_it(book: Vocabulary, name: str, where: tuple[int, int]) -> None:
    assert place(book, name) == where


def test_b2_by_its_table_is_b2_by_its_functions() -> None:
    assert B2.act(Action.NONE) == POLL
    assert B2.act(Action.FORCE_CONFIG_FEEDBACK, 1) == configure(30, 1)
    assert B2.act(Action.MODE_REQUEST, ModeRequest.TRACTOR) == request_mode(ModeRequest.TRACTOR)
    assert B2.store("track_width", 0.481224) == configure(10, 0.481224)
    assert B3.store("lateral_accel", 4.905).data == bytes.fromhex("00000015 409CF5C3")
    assert B3.act(Action.CONTINUOUS_DATA, 1).data == bytes.fromhex("00000024 00000001")


def test_b1_numbers_its_commands_its_own_way() -> None:
    assert B1.act(Action.FORCE_CONFIG_FEEDBACK, 1).data == bytes.fromhex("00000013 00000001")
    assert B1.act(Action.MODE_REQUEST, ModeRequest.STANDBY).data == bytes.fromhex("00000015 00000004")
    assert B1.store("track_width", 0.481224).data == bytes.fromhex("00000009 3EF662FE")
    with pytest.raises(KeyError):
        B1.store("wheel_base", 0.5842)


@BOOKS
def test_routine_frames_pass_their_own_whitelist(book: Vocabulary) -> None:
    routine = [
        book.act(Action.NONE),
        book.act(Action.FORCE_CONFIG_FEEDBACK, 1),
        book.act(Action.MODE_REQUEST, ModeRequest.TRACTOR),
        book.act(Action.FAULT_LOG, 1),
        book.store("track_width", 0.481224),
        book.store("feedback_bitmap_1", book.compact_bitmaps[0]),
    ]
    assert [forbidden(frame, book.dialect) for frame in routine] == [None] * len(routine)


@given(frames, st.sampled_from([Dialect.B1, Dialect.B2, Dialect.B3]))
def test_no_dialect_lets_a_dangerous_command_pass(frame: Frame, dialect: Dialect) -> None:
    if forbidden(frame, dialect) is not None:
        return
    book = VOCABULARIES[dialect]
    number, word = unpack_words(frame.data)
    never = {book.parameter(name).number for name in ("ip_address", "ip_port", "subnet_mask", "gateway")}
    never |= {
        book.actions[action] for action in (Action.RESET_PARAMETERS, Action.CONTINUOUS_DATA) & book.actions.keys()
    }
    assert number not in never
    if number == book.actions[Action.MODE_REQUEST]:
        assert word in (ModeRequest.STANDBY, ModeRequest.TRACTOR)
    if number == book.parameter("input_bitmap").number:
        assert word & book.input_bits.unwanted == 0


def test_mode_requests_of_one_dialect_do_not_pass_as_another() -> None:
    assert forbidden(B1.act(Action.MODE_REQUEST, ModeRequest.TRACTOR), Dialect.B2)
    assert forbidden(B2.act(Action.MODE_REQUEST, ModeRequest.TRACTOR), Dialect.B1)


@BOOKS
def test_stored_parameters_are_read_by_name_in_every_dialect(book: Vocabulary) -> None:
    stored = Stored.of(RMP110_STORED, parameters=book.parameters)
    assert stored.differing(RMP110_STORED) == {}
    assert stored["track_width"] == pytest.approx(0.481224)
    assert stored.bitmaps == book.factory_bitmaps
    assert book.stored([*stored.words, 0]) == stored
    with pytest.raises(ValueError, match="parameter words"):
        book.stored(stored.words[:-1])
    with pytest.raises(KeyError):
        stored.with_values({"speed": 1.0})
