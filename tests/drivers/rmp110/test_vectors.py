"""Every byte of the fact sheet's sections 15.1 to 15.3."""

from __future__ import annotations

import pytest

from drivers.rmp110.codec.assembler import Assembler, ReplyCollector
from drivers.rmp110.codec.bytestream import crc16, pack_command, pack_feedback
from drivers.rmp110.codec.commands import POLL, configure, motion, request_mode
from drivers.rmp110.codec.dialect import Action
from drivers.rmp110.codec.feedback import COMPACT, split_frames
from drivers.rmp110.codec.frames import Frame, float_to_word
from drivers.rmp110.codec.motion import MotionScale, normalise
from drivers.rmp110.codec.parameters import ModeRequest, Stored
from drivers.rmp110.codec.vocabulary import B2


def velocity(v: float, w: float, v_limit: float, w_limit: float) -> Frame:
    """The motion frame for a velocity in REP-103 signs on a base with these stored limits."""
    command = normalise(v, w, MotionScale(v_limit, w_limit, max_v_mps=9.0, max_w_rps=9.0))
    return motion(command.velocity, command.yaw_rate)


# fmt: off
COMMANDS = [
    (motion(0.0, 0.0), "500", "00 00 00 00 00 00 00 00", "05 00 00 00 00 00 00 00 00 00 10 10"),
    (motion(0.25, 0.0), "500", "3E 80 00 00 00 00 00 00", "05 00 3E 80 00 00 00 00 00 00 40 13"),
    (motion(-1.0, 0.0), "500", "BF 80 00 00 00 00 00 00", "05 00 BF 80 00 00 00 00 00 00 EC DA"),
    (velocity(0.5, 0.2, 1.0, 1.0), "500", "3F 00 00 00 BE 4C CC CD", "05 00 3F 00 00 00 BE 4C CC CD 2E 22"),
    (velocity(0.5, 0.2, 0.5, 1.0), "500", "3F 80 00 00 BE 4C CC CD", "05 00 3F 80 00 00 BE 4C CC CD E6 A3"),
    (velocity(0.5, 0.2, 2.2352, 3.0), "500", "3E 65 0F F1 BD 88 88 89", "05 00 3E 65 0F F1 BD 88 88 89 44 D9"),
    (POLL, "501", "00 00 00 00 00 00 00 00", "05 01 00 00 00 00 00 00 00 00 80 1D"),
    (configure(1, 0.5), "501", "00 00 00 01 3F 00 00 00", "05 01 00 00 00 01 3F 00 00 00 54 2C"),
    (configure(2, 0.5), "501", "00 00 00 02 3F 00 00 00", "05 01 00 00 00 02 3F 00 00 00 54 68"),
    (configure(3, 0.5), "501", "00 00 00 03 3F 00 00 00", "05 01 00 00 00 03 3F 00 00 00 94 55"),
    (configure(4, 1.0), "501", "00 00 00 04 3F 80 00 00", "05 01 00 00 00 04 3F 80 00 00 BC E1"),
    (configure(5, 0.1962), "501", "00 00 00 05 3E 48 E8 A7", "05 01 00 00 00 05 3E 48 E8 A7 C4 53"),
    (configure(6, 1.0), "501", "00 00 00 06 3F 80 00 00", "05 01 00 00 00 06 3F 80 00 00 7C 98"),
    (configure(7, 1.5), "501", "00 00 00 07 3F C0 00 00", "05 01 00 00 00 07 3F C0 00 00 68 A4"),
    (configure(8, 0.46228), "501", "00 00 00 08 3E EC AF F7", "05 01 00 00 00 08 3E EC AF F7 2A 0C"),
    (configure(9, 0.5842), "501", "00 00 00 09 3F 15 8E 22", "05 01 00 00 00 09 3F 15 8E 22 E8 39"),
    (configure(10, 0.542391), "501", "00 00 00 0A 3F 0A DA 23", "05 01 00 00 00 0A 3F 0A DA 23 2E B3"),
    (configure(10, 0.481224), "501", "00 00 00 0A 3E F6 62 FE", "05 01 00 00 00 0A 3E F6 62 FE BB C0"),
    (configure(11, 24.2667), "501", "00 00 00 0B 41 C2 22 34", "05 01 00 00 00 0B 41 C2 22 34 F6 14"),
    (configure(12, 0x101), "501", "00 00 00 0C 00 00 01 01", "05 01 00 00 00 0C 00 00 01 01 D1 CD"),
    (configure(13, 0x2800A8C0), "501", "00 00 00 0D 28 00 A8 C0", "05 01 00 00 00 0D 28 00 A8 C0 71 46"),
    (configure(13, 0xC0A80028), "501", "00 00 00 0D C0 A8 00 28", "05 01 00 00 00 0D C0 A8 00 28 BF 8D"),
    (configure(14, 0x1F90), "501", "00 00 00 0E 00 00 1F 90", "05 01 00 00 00 0E 00 00 1F 90 1D 7C"),
    (configure(17, 0x7B800F0F), "501", "00 00 00 11 7B 80 0F 0F", "05 01 00 00 00 11 7B 80 0F 0F 7B BD"),
    (configure(18, 0x3030026), "501", "00 00 00 12 03 03 00 26", "05 01 00 00 00 12 03 03 00 26 1D D4"),
    (configure(19, 0x0), "501", "00 00 00 13 00 00 00 00", "05 01 00 00 00 13 00 00 00 00 43 98"),
    (configure(20, 0x0), "501", "00 00 00 14 00 00 00 00", "05 01 00 00 00 14 00 00 00 00 83 2D"),
    (configure(21, float_to_word(4.905)), "501", "00 00 00 15 40 9C F5 C3", "05 01 00 00 00 15 40 9C F5 C3 AC C2"),
    (B2.act(Action.FORCE_CONFIG_FEEDBACK, 1), "501", "00 00 00 1E 00 00 00 01", "05 01 00 00 00 1E 00 00 00 01 42 74"),
    (B2.act(Action.FORCE_CONFIG_FEEDBACK, 0), "501", "00 00 00 1E 00 00 00 00", "05 01 00 00 00 1E 00 00 00 00 82 B5"),
    (configure(31, 0xF), "501", "00 00 00 1F 00 00 00 0F", "05 01 00 00 00 1F 00 00 00 0F 46 C8"),
    (request_mode(ModeRequest.DISABLE), "501", "00 00 00 20 00 00 00 01", "05 01 00 00 00 20 00 00 00 01 87 5D"),
    (request_mode(ModeRequest.POWERDOWN), "501", "00 00 00 20 00 00 00 02", "05 01 00 00 00 20 00 00 00 02 86 1D"),
    (request_mode(ModeRequest.DTZ), "501", "00 00 00 20 00 00 00 03", "05 01 00 00 00 20 00 00 00 03 46 DC"),
    (request_mode(ModeRequest.STANDBY), "501", "00 00 00 20 00 00 00 04", "05 01 00 00 00 20 00 00 00 04 84 9D"),
    (request_mode(ModeRequest.TRACTOR), "501", "00 00 00 20 00 00 00 05", "05 01 00 00 00 20 00 00 00 05 44 5C"),
    (request_mode(ModeRequest.BALANCE), "501", "00 00 00 20 00 00 00 06", "05 01 00 00 00 20 00 00 00 06 45 1C"),
    (configure(33, 0x1), "501", "00 00 00 21 00 00 00 01", "05 01 00 00 00 21 00 00 00 01 47 60"),
    (configure(33, 0x0), "501", "00 00 00 21 00 00 00 00", "05 01 00 00 00 21 00 00 00 00 87 A1"),
    (configure(34, 0x1F), "501", "00 00 00 22 00 00 00 1F", "05 01 00 00 00 22 00 00 00 1F 4F A4"),
    (configure(35, 0x0), "501", "00 00 00 23 00 00 00 00", "05 01 00 00 00 23 00 00 00 00 47 D8"),
    (configure(36, 0x1), "501", "00 00 00 24 00 00 00 01", "05 01 00 00 00 24 00 00 00 01 47 AC"),
]
# fmt: on


@pytest.mark.parametrize(("frame", "can_id", "data", "packet"), COMMANDS)
def test_a_command_has_the_documented_bytes(frame: Frame, can_id: str, data: str, packet: str) -> None:
    assert frame == Frame(int(can_id, 16), bytes.fromhex(data))
    assert pack_command(frame) == bytes.fromhex(packet)


def test_the_checksum_is_crc16_arc() -> None:
    assert crc16(b"123456789") == 0xBB3D


FEEDBACK = [
    Frame(0x502 + k, bytes.fromhex(data))
    for k, data in enumerate(
        (
            "00 00 00 00 00 00 00 00",
            "00 00 00 00 00 00 00 00",
            "42 1E 28 F6 00 00 00 04",
            "00 00 00 00 42 C1 C0 00",
            "00 00 00 03 3F 80 00 00",
            "3F 80 00 00 3F 00 00 00",
            "BE 4C CC CD 3F 0C 51 C0",
            "3E E7 5C 80 3F A0 00 00",
            "3F 80 00 00 3F 90 00 00",
            "42 C2 88 00 42 C1 C0 00",
            "3F 00 00 00 BE 4C CC CD",
        )
    )
]
VALUES = {
    "fault_status_word_1": 0,
    "fault_status_word_2": 0,
    "fault_status_word_3": 0,
    "fault_status_word_4": 0,
    "operational_time": 39.54,
    "operational_state": 4,
    "dynamic_response": 0,
    "min_propulsion_batt_soc": 96.875,
    "pse_data_is_valid": 3,
    "yaw_rate_limit_rps": 1.0,
    "vel_limit_mps": 1.0,
    "linear_vel_mps": 0.5,
    "differential_wheel_vel_rps": -0.2,
    "right_front_vel_mps": 0.5 + 0.2 * 0.481224 / 2,
    "left_front_vel_mps": 0.5 - 0.2 * 0.481224 / 2,
    "right_front_pos_m": 1.25,
    "left_front_pos_m": 1.0,
    "linear_pos_m": 1.125,
    "front_base_batt_1_soc": 97.265625,
    "front_base_batt_2_soc": 96.875,
    "vel_target_mps": 0.5,
    "yaw_rate_target_rps": -0.2,
}


def test_the_compact_feedback_set_decodes_to_the_documented_values() -> None:
    assembler = Assembler(COMPACT.frame_count)
    packets = [assembler.feed(1000 * k, frame) for k, frame in enumerate(FEEDBACK)]
    assert packets[:-1] == [None] * 10
    assert packets[-1] is not None
    assert COMPACT.decode(packets[-1].words) == pytest.approx(VALUES, rel=1e-6)


def test_the_compact_feedback_set_encodes_to_the_documented_bytes() -> None:
    words = COMPACT.encode(VALUES)
    assert split_frames(words) == tuple(FEEDBACK)
    packet = pack_feedback(words)
    assert len(packet) == 92
    assert packet.endswith(bytes.fromhex("00 00 A8 2F"))


CONFIG_REPLY = (
    "40 0F 0D 84 40 7B 12 6F",
    "40 7B 12 6F 40 7B 12 6F",
    "3E 48 E8 A7 40 40 00 00",
    "41 E2 31 27 3E EC AF F7",
    "3F 15 8E 22 3F 11 E9 F2",
    "41 C2 22 34 00 00 01 01",
    "28 00 A8 C0 00 00 1F 90",
    "00 FF FF FF 01 00 A8 C0",
    "FF FF FF FF FF FF FF FF",
    "FF FF FF FF 00 00 00 00",
)


def test_a_forced_configuration_reply_is_the_factory_parameters_and_tells_the_dialect() -> None:
    collector = ReplyCollector()
    for k, data in enumerate(CONFIG_REPLY):
        collector.feed(1000 * k, Frame(0x502 + k, bytes.fromhex(data)))
    packet = collector.finish()
    assert packet is not None
    assert len(packet.words) // 2 == B2.config_reply_frames
    assert packet.words == Stored.of({}).words
    assert pack_feedback(packet.words).endswith(bytes.fromhex("00 00 FA A3"))
    stored = Stored(packet.words)
    assert stored["max_velocity"] == pytest.approx(2.2352)
    assert stored["track_width"] == pytest.approx(0.569976)
    assert stored["ip_port"] == 8080
    assert stored.bitmaps == (0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0)
