"""V3: the documented bytes, the 132 words, the stream, and what must never be sent."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.codec.bytestream import pack_command, unpack_command
from drivers.rmp110.codec.fault_log import FAULT_LOG_WORDS
from drivers.rmp110.codec.frames import Frame, word_to_float
from drivers.rmp110.codec.motion import MotionScale, in_si
from drivers.rmp110.codec.parameters import ModeRequest, Stored
from drivers.rmp110.codec.v3.commands import (
    CONFIG_ID,
    ETHERNET_ID,
    GENERAL_ID,
    MOTION_ID,
    ZERO_MOTION,
    General,
    continuous_data,
    general,
    machine_config,
    motion,
    request_mode,
    torque_limit,
)
from drivers.rmp110.codec.v3.deframer import Deframer
from drivers.rmp110.codec.v3.packets import (
    FAULT_LOG,
    FAULT_LOG_BYTES,
    POWER_DOWN,
    STATUS,
    STATUS_BYTES,
    byte_order,
    machine,
    pack_fault_log,
    pack_status,
    parse_packet,
    stored_words,
    unpack_words,
)
from drivers.rmp110.codec.v3.whitelist import forbidden
from drivers.rmp110.codec.v3.words import LAYOUT, PARAMETERS, WORDS
from drivers.rmp110.device.state import NEEDED
from drivers.rmp110.errors import RmpBadCommand

words = st.integers(0, 0xFFFFFFFF)
statuses = st.lists(words, min_size=132, max_size=132)
RMP110_STORED_V3 = Stored.of({}, parameters=PARAMETERS)

# fmt: off
COMMANDS = [
    (motion(0.5, 0.2), "18 00 3F 00 00 00 00 00 00 00 3E 4C CC CD E6 14"),
    (ZERO_MOTION, "18 00 00 00 00 00 00 00 00 00 00 00 00 00 18 18"),
    (request_mode(ModeRequest.TRACTOR), "18 03 00 00 00 02 00 00 00 05 4C 2D"),
    (request_mode(ModeRequest.STANDBY), "18 03 00 00 00 02 00 00 00 04 8C EC"),
    (request_mode(ModeRequest.DTZ), "18 03 00 00 00 02 00 00 00 03 4E AD"),
    (continuous_data(on=True), "18 03 00 00 00 06 00 00 00 01 4F DD"),
    (continuous_data(on=False), "18 03 00 00 00 06 00 00 00 00 8F 1C"),
    (general(General.FAULT_LOG), "18 03 00 00 00 03 00 00 00 00 8F D0"),
    (general(General.RESET_INTEGRATORS, 0x1F), "18 03 00 00 00 04 00 00 00 1F 87 24"),
    (general(General.AUDIO, 7), "18 03 00 00 00 01 00 00 00 07 8D E8"),
    (torque_limit(0.5), "18 03 00 00 00 07 3F 00 00 00 5B 2D"),
    (machine_config(RMP110_STORED_V3),
     ("18 01 3F 00 00 00 3F 00 00 00 3F 00 00 00 3F 80 00 00 3F 80 00 00 3F C0 00 00 40 9C F5 C3 3E EC AF F7"
      "3F 15 8E 22 3E F6 62 FE 41 C2 22 34 00 00 00 02 9B 1A")),
]
# fmt: on


def status_words(**values: float) -> tuple[int, ...]:
    known = {f"stored_{name}": RMP110_STORED_V3[name] for name in (p.name for p in PARAMETERS)}
    return LAYOUT.encode({**known, "machine_id": 8, "operational_state": 3, **values})


@pytest.mark.parametrize(("frame", "packet"), COMMANDS)
def test_a_command_has_the_documented_bytes(frame: Frame, packet: str) -> None:
    assert pack_command(frame) == bytes.fromhex(packet)
    assert unpack_command(bytes.fromhex(packet)) == frame


@pytest.mark.parametrize(
    ("index", "name"),
    [
        (0, "fault_status_word_1"),
        (7, "mcu_3_fault_status"),
        (8, "operational_time"),
        (9, "operational_state"),
        (12, "machine_id"),
        (13, "min_propulsion_batt_soc"),
        (21, "mcu_3_batt_temp_degC"),
        (33, "left_rear_current_A0pk"),
        (47, "aux_batt_2_temp_degC"),
        (54, "7p2V_battery_voltage"),
        (65, "pse_data_is_valid"),
        (78, "ahrs_timestamp"),
        (93, "imu_error"),
        (94, "vel_target_mps"),
        (97, "yaw_rate_limit_rps"),
        (98, "vel_limit_mps"),
        (99, "right_front_vel_mps"),
        (103, "right_front_pos_m"),
        (110, "linear_vel_mps"),
        (115, "odom_yaw_rad"),
        (116, "stored_max_velocity"),
        (127, "stored_input_bitmap"),
        (131, "stored_gateway"),
    ],
)
def test_a_word_stands_where_the_sheet_has_it(index: int, name: str) -> None:
    assert (len(WORDS), WORDS[index].name) == (132, name)


def test_the_status_has_all_that_the_driver_needs() -> None:
    assert LAYOUT.missing(NEEDED) == ()


@pytest.mark.parametrize("order", "<>")
def test_the_machine_id_tells_the_byte_order(order: str) -> None:
    packet = pack_status(status_words(operational_time=39.54, mcu_1_batt_temp_degC=26.25), order)
    assert len(packet) == STATUS_BYTES == 532
    frame = parse_packet(packet)
    assert frame is not None
    assert (frame.can_id, byte_order(frame.data)) == (STATUS, order)
    read = unpack_words(frame.data, order)
    assert machine(read) == 8
    assert Stored(stored_words(read), PARAMETERS) == RMP110_STORED_V3
    values = LAYOUT.decode(read)
    assert (values["operational_time"], values["mcu_1_batt_temp_degC"]) == pytest.approx((39.54, 26.25))


def test_a_status_without_a_known_machine_has_no_byte_order() -> None:
    assert byte_order(bytes(528)) is None
    assert byte_order(pack_status(status_words(machine_id=9))[:528]) is None
    assert byte_order(pack_status(status_words(machine_id=2))[:528]) == "<", "an RMP 220 is understood, and refused"


@given(statuses, st.sampled_from("<>"))
def test_packing_and_unpacking_a_status_are_inverse(values: list[int], order: str) -> None:
    frame = parse_packet(pack_status(values, order))
    assert frame is not None
    assert unpack_words(frame.data, order) == tuple(values)
    decoded = LAYOUT.decode(values)
    if all(math.isfinite(value) for value in decoded.values()):
        assert LAYOUT.encode(decoded) == tuple(values)


def test_the_fault_log_and_the_notice_have_their_lengths() -> None:
    packet = pack_fault_log(range(FAULT_LOG_WORDS))
    assert len(packet) == FAULT_LOG_BYTES == 1248
    frame = parse_packet(packet)
    assert frame is not None
    assert frame.can_id == FAULT_LOG
    assert unpack_words(frame.data, "<") == tuple(range(FAULT_LOG_WORDS))
    assert list(POWER_DOWN) == [0x87, 0x56, 0xBA, 0xEB]


@given(st.binary(max_size=1300))
def test_no_garbage_is_a_packet_without_its_checksum(garbage: bytes) -> None:
    frame = parse_packet(garbage)
    assert frame is None or len(garbage) in (STATUS_BYTES, FAULT_LOG_BYTES)


def numbered(number: int) -> bytes:
    return pack_status(status_words(dynamic_response=number))


def numbers(frames: list[Frame]) -> list[int]:
    return [unpack_words(frame.data, "<")[10] for frame in frames if frame.can_id == STATUS]


@given(st.integers(1, 4), st.lists(st.integers(1, 700), max_size=12))
def test_packets_come_out_however_the_stream_is_cut(count: int, cuts: list[int]) -> None:
    deframer, stream = Deframer(), b"".join(numbered(n) for n in range(count))
    frames = []
    for cut in [*cuts, len(stream)]:
        frames += deframer.feed(stream[:cut])
        stream = stream[cut:]
    assert numbers(frames) == list(range(count))
    assert (deframer.damaged, deframer.skipped) == (0, 0)


@given(st.binary(min_size=1, max_size=600), st.integers(0, 531), st.integers(0, 255))
def test_after_garbage_or_a_damaged_byte_the_next_packets_are_whole_again(
    garbage: bytes, place: int, value: int
) -> None:
    broken = bytearray(numbered(1))
    broken[place] = value
    deframer = Deframer()
    frames = deframer.feed(numbered(0) + garbage + bytes(broken) + numbered(2) + numbered(3))
    found = numbers(frames)
    assert found[0] == 0
    assert found[-2:] == [2, 3]
    assert deframer.damaged >= 1
    assert deframer.skipped >= len(garbage)


@given(st.lists(st.binary(max_size=900), max_size=8))
def test_garbage_is_counted_and_memory_stays_bounded(chunks: list[bytes]) -> None:
    deframer = Deframer()
    for chunk in chunks:
        deframer.feed(chunk)
        assert len(deframer._buffer) <= FAULT_LOG_BYTES
    assert deframer.skipped + len(deframer._buffer) <= sum(map(len, chunks))


def test_a_fault_log_is_taken_when_it_was_asked_for() -> None:
    deframer, packet = Deframer(), pack_fault_log(range(FAULT_LOG_WORDS))
    assert [frame.can_id for frame in deframer.feed(numbered(0) + packet + numbered(1))] == [STATUS, STATUS]
    assert deframer.skipped == len(packet)
    deframer.feed(b"left over")
    deframer.expect_fault_log()
    frames = [frame for k in range(0, 1248, 100) for frame in deframer.feed(packet[k : k + 100])]
    assert [frame.can_id for frame in frames] == [FAULT_LOG]
    assert numbers(deframer.feed(numbered(2))) == [2]


@pytest.mark.parametrize(
    "frame",
    [
        ZERO_MOTION,
        motion(0.5, -1.0),
        request_mode(ModeRequest.TRACTOR),
        request_mode(ModeRequest.STANDBY),
        continuous_data(on=True),
        general(General.NONE),
        general(General.FAULT_LOG),
        machine_config(RMP110_STORED_V3.with_values({"input_bitmap": 0})),
    ],
)
def test_routine_frames_pass(frame: Frame) -> None:
    assert forbidden(frame) is None


@pytest.mark.parametrize(
    "frame",
    [
        *(request_mode(m) for m in (ModeRequest.DISABLE, ModeRequest.POWERDOWN, ModeRequest.DTZ, ModeRequest.BALANCE)),
        general(General.RESET_PARAMETERS),
        general(General.AUDIO, 1),
        general(General.RESET_INTEGRATORS, 0x1F),
        torque_limit(1.0),
        machine_config(RMP110_STORED_V3),
        machine_config(RMP110_STORED_V3.with_values({"input_bitmap": 0, "max_velocity": 8.1})),
        Frame(ETHERNET_ID, bytes(16)),
        Frame(MOTION_ID, struct.pack(">3f", 0.1, 0.1, 0.0)),
        motion(math.nan, 0.0),
        motion(0.0, math.inf),
        motion(9.0, 0.0),
        Frame(MOTION_ID, bytes(8)),
        Frame(0x500, bytes(8)),
        Frame(0x501, bytes(8)),
    ],
)
def test_dangerous_frames_do_not(frame: Frame) -> None:
    assert forbidden(frame)


@given(
    st.sampled_from([MOTION_ID, CONFIG_ID, ETHERNET_ID, GENERAL_ID, 0x500]),
    st.one_of(
        st.binary(max_size=48),
        st.builds(lambda a, b: struct.pack(">2I", a, b), st.integers(0, 9), st.integers(0, 40)),
        st.lists(words, min_size=12, max_size=12).map(lambda values: struct.pack(">12I", *values)),
    ),
)
def test_whatever_passes_is_harmless(can_id: int, data: bytes) -> None:
    if forbidden(Frame(can_id, data)) is not None:
        return
    assert can_id in (MOTION_ID, CONFIG_ID, GENERAL_ID)
    if can_id == CONFIG_ID:
        assert data[-1] & 0x2 == 0
    if can_id == GENERAL_ID:
        command, word = struct.unpack(">2I", data)
        assert command != General.RESET_PARAMETERS
        assert command != General.MODE_REQUEST or word in (ModeRequest.STANDBY, ModeRequest.TRACTOR)
        assert command != General.TORQUE_LIMIT or 0 <= word_to_float(word) <= 1


limits = st.floats(0.01, 4.5)


@given(st.floats(), st.floats(), st.builds(MotionScale, limits, limits, limits, limits, st.floats(0.5, 2)))
def test_any_velocity_is_refused_or_within_every_limit(v: float, w: float, scale: MotionScale) -> None:
    if not (math.isfinite(v) and math.isfinite(w)):
        with pytest.raises(RmpBadCommand):
            in_si(v, w, scale)
        return
    command = in_si(v, w, scale)
    assert forbidden(motion(command.velocity, command.yaw_rate)) is None
    assert abs(command.v) <= min(scale.max_v_mps, scale.stored_v_mps)
    assert abs(command.yaw_rate) <= scale.stored_w_rps
    assert abs(command.w) <= scale.max_w_rps * (1 + 1e-9)
    assert command.v * v >= 0
    assert command.yaw_rate * w >= 0, "counter-clockwise on the wire"


def test_standing_still_is_the_documented_zero() -> None:
    command = in_si(-0.0, -0.0, MotionScale(0.5, 1.0, 0.5, 1.0))
    assert motion(command.velocity, command.yaw_rate) == ZERO_MOTION
