"""The simulated base against the measured behaviour of the real one, with a clock that is only a number."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.codec.commands import POLL, ZERO_MOTION, configure, motion, request_mode
from drivers.rmp110.codec.dialect import Action, Dialect
from drivers.rmp110.codec.fault_log import FAULT_LOG_WORDS, decode_fault_log
from drivers.rmp110.codec.feedback import COMPACT_BITMAPS
from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame, float_to_word, unpack_words
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, OperationalState, Stored
from drivers.rmp110.codec.vocabulary import B1, B2, B3, VOCABULARIES
from drivers.rmp110.simulator.dynamics import DT, TRACTION_MPS2
from drivers.rmp110.simulator.model import RmpModel
from drivers.rmp110.simulator.unknowns import Unknowns

COMPACT_BITMAP_NAMES = {f"feedback_bitmap_{n}": word for n, word in enumerate(COMPACT_BITMAPS, start=1)}
MS = 1_000_000


class Bench:
    """A model, a clock, and a hand that sends."""

    def __init__(
        self,
        *,
        boot_s: float = 0.0,
        stored: Stored | None = None,
        dialect: Dialect = Dialect.B2,
        unknowns: Unknowns | None = None,
    ) -> None:
        self.now_ns = 5_000_000_000
        self.model = RmpModel(self.now_ns, stored, boot_s=boot_s, dialect=dialect, unknowns=unknowns)
        self.wait(0.02)

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)
        self.model.step(self.now_ns)

    @property
    def state(self) -> OperationalState:
        return self.model.state

    def send(self, frame: Frame) -> tuple[Frame, ...]:
        return self.model.receive(self.now_ns, frame)

    def read(self, frame: Frame = POLL) -> dict[str, float]:
        words = [word for reply in self.send(frame) for word in unpack_words(reply.data)]
        return self.model.book.layout(self.model.stored.bitmaps).decode(words)

    def act(self, action: Action, word: int = 0) -> tuple[Frame, ...]:
        """An action in the base's own dialect."""
        return self.send(self.model.book.act(action, word))

    def words(self, frame: Frame) -> tuple[int, ...]:
        return tuple(word for reply in self.send(frame) for word in unpack_words(reply.data))

    def drive(self, velocity: float, yaw_rate: float, seconds: float) -> list[dict[str, float]]:
        """Motion frames with 50 Hz; the feedback of each."""
        seen = []
        for _ in range(round(seconds * 50)):
            seen.append(self.read(motion(velocity, yaw_rate)))
            self.wait(0.02)
        return seen

    def tractor(self) -> None:
        self.act(Action.MODE_REQUEST, ModeRequest.TRACTOR)
        self.wait(0.06)
        assert self.state is OperationalState.TRACTOR


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    assert bench.state is OperationalState.STANDBY
    return bench


def test_booting_goes_through_its_states_in_order() -> None:
    bench = Bench(boot_s=2.0)
    seen = []
    for _ in range(250):
        state = int(bench.read()["operational_state"])
        if state not in seen:
            seen.append(state)
        bench.wait(0.01)
    assert seen == [0, 1, 2, 3]
    assert bench.read()["operational_time"] == pytest.approx(2.52, abs=0.011)


def test_every_request_gets_one_packet_in_ascending_ids(bench: Bench) -> None:
    for frame in (POLL, ZERO_MOTION, configure(31, 0)):
        assert [reply.can_id for reply in bench.send(frame)] == list(range(0x502, 0x532))


def test_a_mode_change_shows_after_40_to_50_ms(bench: Bench) -> None:
    bench.send(request_mode(ModeRequest.TRACTOR))
    bench.wait(0.039)
    before = bench.state
    bench.wait(0.011)
    assert (before, bench.state) == (OperationalState.STANDBY, OperationalState.TRACTOR)


def test_effective_limits_grow_at_the_acceleration_limits_and_fall_to_zero_in_standby(bench: Bench) -> None:
    assert bench.read()["vel_limit_mps"] == 0
    bench.tractor()
    before = bench.read()
    bench.wait(0.5)
    after = bench.read()
    assert after["vel_limit_mps"] - before["vel_limit_mps"] == pytest.approx(0.25)
    assert after["yaw_rate_limit_rps"] - before["yaw_rate_limit_rps"] == pytest.approx(0.75)
    bench.wait(1.0)
    assert bench.read()["vel_limit_mps"] == 0.5
    bench.send(request_mode(ModeRequest.STANDBY))
    bench.wait(0.06)
    assert bench.read()["vel_limit_mps"] == 0


def test_a_command_takes_40_ms_then_ramps_at_the_acceleration_limit(bench: Bench) -> None:
    bench.tractor()
    bench.wait(1.1)
    bench.send(motion(1.0, 0.0))
    bench.wait(0.039)
    assert bench.model.drive.v == 0
    bench.wait(0.011)
    assert bench.model.drive.v > 0
    seen = bench.drive(1.0, 0.0, 0.5)
    slope = (seen[20]["linear_vel_mps"] - seen[0]["linear_vel_mps"]) / 0.4
    assert slope == pytest.approx(0.5, rel=1e-3)
    assert bench.drive(1.0, 0.0, 1.0)[-1]["linear_vel_mps"] == pytest.approx(0.5)


def test_positive_yaw_on_the_wire_turns_clockwise(bench: Bench) -> None:
    bench.tractor()
    seen = bench.drive(0.0, 0.4, 1.5)[-1]
    assert seen["left_front_vel_mps"] > 0 > seen["right_front_vel_mps"]
    assert seen["differential_wheel_vel_rps"] == pytest.approx(0.4)
    _, w = bench.model.twist
    assert w == pytest.approx(-0.4)


def test_positions_integrate_speeds_and_start_anywhere(bench: Bench) -> None:
    bench.tractor()
    start = bench.read()
    assert start["right_front_pos_m"] != 0
    seen = bench.drive(0.6, 0.0, 3.0)
    way = bench.read()["linear_pos_m"] - start["linear_pos_m"]
    assert way == pytest.approx(sum(s["linear_vel_mps"] for s in seen) * 0.02, rel=0.01)


def test_without_motion_frames_it_stops_after_half_a_second_and_resumes_with_the_next(bench: Bench) -> None:
    bench.tractor()
    bench.drive(1.0, 0.0, 3.0)
    for _ in range(24):
        bench.read()  # polls do not count as commands
        bench.wait(0.02)
    assert bench.model.drive.v_target == pytest.approx(0.5), "0.50 s after the last motion frame at the earliest"
    bench.wait(0.56)
    assert 0.2 < bench.model.drive.v_target < 0.35, "ramps down at the deceleration limit"
    bench.wait(1.0)
    assert bench.read()["linear_vel_mps"] == 0
    assert (bench.state, bench.model.fault_words) == (OperationalState.TRACTOR, [0, 0, 0, 0])
    assert bench.drive(0.5, 0.0, 2.0)[-1]["linear_vel_mps"] == pytest.approx(0.25)


def test_motion_outside_tractor_is_answered_and_ignored(bench: Bench) -> None:
    bench.drive(1.0, 0.0, 1.0)
    assert bench.model.twist == (0.0, 0.0)


def test_standby_is_refused_while_rolling(bench: Bench) -> None:
    bench.tractor()
    bench.drive(1.0, 0.0, 2.0)
    bench.send(request_mode(ModeRequest.STANDBY))
    bench.drive(1.0, 0.0, 0.2)
    assert bench.state is OperationalState.TRACTOR


@pytest.mark.parametrize("pair", [(1.5, 0.0), (0.0, -1.01), (math.nan, 0.0), (0.0, math.inf)])
def test_a_bad_motion_command_latches_a_fault_and_does_not_move(bench: Bench, pair: tuple[float, float]) -> None:
    bench.tractor()
    bench.send(motion(*pair))
    bench.wait(0.5)
    assert bench.read()["fault_status_word_2"] == 0x10
    assert bench.model.twist == (0.0, 0.0)


@pytest.mark.parametrize("number", [21, 36, 29, 37, 0xFFFFFFFF])
def test_an_unknown_configuration_command_latches_a_fault(bench: Bench, number: int) -> None:
    bench.send(configure(number))
    assert bench.read()["fault_status_word_2"] == 0x20


@pytest.mark.parametrize("frame", [Frame(CONFIG_ID, bytes(7)), Frame(MOTION_ID, b""), Frame(0x600, bytes(8))])
def test_a_malformed_frame_gets_no_reply(bench: Bench, frame: Frame) -> None:
    assert bench.send(frame) == ()
    assert bench.read()["fault_status_word_2"] == 0


def test_a_parameter_out_of_range_keeps_its_old_value(bench: Bench) -> None:
    bench.send(configure(1, 8.5))
    bench.send(configure(10, 0.481224))  # below what dialect B2 documents
    assert bench.model.stored == Stored.of(RMP110_STORED)
    bench.send(configure(1, 0.25))
    assert bench.model.stored["max_velocity"] == 0.25


def test_forced_configuration_replies_are_the_stored_words_even_with_feedback_off() -> None:
    off = Stored.of({**RMP110_STORED, **{f"feedback_bitmap_{n}": 0 for n in (1, 2, 3)}})
    bench = Bench(stored=off)
    assert bench.send(POLL) == ()
    replies = bench.send(B2.act(Action.FORCE_CONFIG_FEEDBACK, 1))
    assert tuple(word for reply in replies for word in unpack_words(reply.data)) == off.words
    assert bench.send(B2.act(Action.FORCE_CONFIG_FEEDBACK, 0)) == ()


def test_dialect_b3_answers_one_frame_more() -> None:
    replies = Bench(dialect=Dialect.B3).send(B2.act(Action.FORCE_CONFIG_FEEDBACK, 1))
    assert len(replies) == 11
    assert unpack_words(replies[-1].data) == (float_to_word(4.905), 0)


def test_the_kill_switch_gives_one_more_packet_and_then_silence_until_power(bench: Bench) -> None:
    bench.tractor()
    bench.drive(1.0, 0.0, 2.0)
    bench.model.kill_switch()
    last = bench.read()
    assert (last["operational_state"], last["fault_status_word_1"], last["dynamic_response"]) == (6, 0x40, 0x200)
    assert bench.send(POLL) == ()
    bench.wait(1.0)
    assert bench.model.twist == (0.0, 0.0)
    bench.model.power_on(bench.now_ns)
    bench.wait(0.05)
    assert bench.read()["fault_status_word_1"] == 0
    assert bench.state is OperationalState.STANDBY


def test_decelerate_to_zero_ends_in_power_off(bench: Bench) -> None:
    bench.tractor()
    bench.drive(1.0, 0.0, 2.0)
    bench.send(request_mode(ModeRequest.DTZ))
    bench.wait(0.3)
    assert 0 < bench.model.twist[0] < 0.5
    bench.wait(1.0)
    assert bench.read()["operational_state"] == 6
    assert bench.send(POLL) == ()


def test_blocked_wheels_stand_while_targets_go_on(bench: Bench) -> None:
    bench.tractor()
    bench.drive(0.6, 0.0, 2.0)
    bench.model.block()
    bench.wait(0.01)
    before = bench.read()
    seen = bench.drive(0.6, 0.0, 0.5)[-1]
    assert seen["linear_pos_m"] == before["linear_pos_m"]
    assert seen["linear_vel_mps"] == 0
    assert seen["vel_target_mps"] == pytest.approx(0.3)
    bench.model.unblock()
    assert bench.drive(0.6, 0.0, 0.5)[-1]["linear_vel_mps"] == pytest.approx(0.3)


def test_a_wrong_stored_track_makes_it_turn_wrongly_on_the_floor() -> None:
    bench = Bench(stored=Stored.of({**RMP110_STORED, "track_width": 0.569976}))
    bench.tractor()
    bench.drive(0.0, -0.4, 2.0)
    assert bench.model.twist[1] == pytest.approx(0.4 * 0.569976 / 0.481224)


def test_the_fault_log_is_six_packets_of_26_frames(bench: Bench) -> None:
    first = bench.send(configure(33, 1))
    assert [len(bench.send(configure(33, 0))) for _ in range(5)] == [26] * 5
    assert len(first) == 26
    assert unpack_words(first[0].data) == (1, 311)


def test_integrators_reset_on_request(bench: Bench) -> None:
    bench.send(configure(34, 0x1F))
    state = bench.read()
    assert (state["right_front_pos_m"], state["left_front_pos_m"]) == (0.0, 0.0)


def test_battery_charge_comes_in_256ths(bench: Bench) -> None:
    charge = bench.read()["min_propulsion_batt_soc"]
    assert charge * 2.56 == pytest.approx(round(charge * 2.56))


@pytest.mark.parametrize("dialect", list(VOCABULARIES))
def test_every_dialect_is_found_driven_and_read_by_its_own_tables(dialect: Dialect) -> None:
    book = VOCABULARIES[dialect]
    bench = Bench(dialect=dialect)
    assert bench.model.stored.bitmaps == book.factory_bitmaps
    words = len(book.layout(book.factory_bitmaps).words)
    assert len(bench.send(POLL)) == (words + 1) // 2
    assert bench.act(Action.FORCE_CONFIG_FEEDBACK, 1)
    assert len(bench.send(POLL)) == book.config_reply_frames
    assert book.stored(bench.words(POLL)) == bench.model.stored
    bench.act(Action.FORCE_CONFIG_FEEDBACK, 0)
    bench.send(book.store("max_velocity", 0.4))
    for n, word in enumerate(book.compact_bitmaps, start=1):
        if f"feedback_bitmap_{n}" in bench.model.stored:
            bench.send(book.store(f"feedback_bitmap_{n}", word))
    assert bench.model.stored.bitmaps == book.compact_bitmaps
    bench.tractor()
    seen = bench.drive(0.5, 0.2, 2.0)[-1]
    assert (seen["linear_vel_mps"], seen["differential_wheel_vel_rps"]) == pytest.approx((0.2, 0.2))
    assert (seen["operational_state"], seen["fault_status_word_2"]) == (4, 0)
    assert bench.model.fault_words == [0, 0, 0, 0]


def test_the_numbers_of_another_dialect_are_misunderstood() -> None:
    bench = Bench(dialect=Dialect.B1)
    bench.send(B2.act(Action.FORCE_CONFIG_FEEDBACK, 1))
    assert bench.model.fault_words[1] == 0x20, "B2's command 30 latches a fault in B1"
    bench = Bench()
    before = bench.model.stored
    bench.send(B1.act(Action.MODE_REQUEST, ModeRequest.TRACTOR))
    assert bench.model.fault_words[1] == 0x20, "B1's mode request is nothing in B2"
    bench = Bench(dialect=Dialect.B3)
    bench.send(B1.act(Action.MODE_REQUEST, ModeRequest.TRACTOR))
    assert bench.model.stored == Stored.of({}, bench.model.stored.words, B3.parameters), "5e-324 is out of range"
    assert bench.state is OperationalState.STANDBY
    assert before == Bench().model.stored


def test_an_odd_number_of_words_ends_with_a_word_nobody_knows() -> None:
    odd = Stored.of({**RMP110_STORED, "feedback_bitmap_1": 0x301, "feedback_bitmap_2": 0, "feedback_bitmap_3": 0})
    for fill in (0, 0xDEADBEEF):
        bench = Bench(stored=odd, unknowns=Unknowns(odd_word=fill))
        replies = bench.send(POLL)
        assert [reply.can_id for reply in replies] == [0x502, 0x503]
        assert unpack_words(replies[1].data) == (3, fill)


def test_continuous_data_of_b3_comes_every_10_ms_until_told_otherwise() -> None:
    bench = Bench(dialect=Dialect.B3)
    assert bench.act(Action.CONTINUOUS_DATA, 1)
    bench.wait(0.5)
    stream = bench.model.take_unsolicited()
    assert len(stream) == 50
    assert {b - a for (a, _), (b, _) in itertools.pairwise(stream)} == {10 * MS}
    assert [frame.can_id for frame in stream[0][1]] == list(range(0x502, 0x502 + 44))
    bench.wait(5.0)
    assert len(bench.model.take_unsolicited()) == 100, "bounded"
    bench.model.kill_switch()
    bench.wait(0.5)
    assert len(bench.model.take_unsolicited()) == 1, "one last packet"
    bench.model.power_on(bench.now_ns)
    bench.wait(0.5)
    assert bench.model.take_unsolicited() == []
    bench.act(Action.CONTINUOUS_DATA, 1)
    bench.act(Action.CONTINUOUS_DATA, 0)
    bench.wait(0.5)
    assert bench.model.take_unsolicited() == []


def test_slipping_wheels_turn_more_than_the_floor_goes_by(bench: Bench) -> None:
    bench.tractor()
    bench.model.slip(left=0.5, right=1.0)
    seen = bench.drive(0.6, 0.0, 2.0)[-1]
    assert (seen["left_front_vel_mps"], seen["right_front_vel_mps"]) == pytest.approx((0.3, 0.3))
    v, w = bench.model.twist
    assert v == pytest.approx(0.225)
    assert w == pytest.approx(0.15 / RMP110_STORED["track_width"]), "turns to the slipping side"
    with pytest.raises(ValueError, match="between 0 and 1"):
        bench.model.slip(1.5, 1.0)


def test_a_stall_draws_the_limit_s_current_and_a_lot_of_power(bench: Bench) -> None:
    bench.tractor()
    seen = bench.drive(0.6, 0.0, 2.0)[-1]
    assert 0.1 < seen["right_front_current_A0pk"] < 5
    assert 12 < seen["mcu_1_inst_power_W"] < 60
    assert seen["mcu_0_inst_power_W"] == seen["right_rear_current_A0pk"] == seen["min_motor_current_limit_A0pk"] == 0
    bench.model.block()
    seen = bench.drive(0.6, 0.0, 0.1)[-1]
    assert seen["max_motor_current_A0pk"] == seen["right_front_current_limit_A0pk"] == pytest.approx(34.991)
    assert seen["mcu_1_inst_power_W"] > 150


def test_wheels_that_come_free_catch_up_no_faster_than_tyres_can() -> None:
    bench = Bench(stored=Stored.of({**RMP110_STORED, "max_velocity": 2.0, "max_accel": 4.0}))
    bench.tractor()
    bench.model.block()
    bench.drive(1.0, 0.0, 1.5)
    bench.model.unblock()
    speeds = []
    for _ in range(30):
        bench.wait(0.01)
        speeds.append(bench.model.drive.v)
    steps = [b - a for a, b in zip([0.0, *speeds], speeds, strict=False)]
    assert max(steps) == pytest.approx(TRACTION_MPS2 * DT)
    assert speeds[-1] == pytest.approx(2.0, abs=0.02)


def test_the_batteries_drain_with_energy_and_warm_up(bench: Bench) -> None:
    power = bench.model.power
    before, aux = power.percent, power.aux_percent
    bench.wait(3600)
    assert before - power.percent == pytest.approx(12 / 770 * 100, rel=0.01), "an hour of 12 W"
    assert aux - power.aux_percent == pytest.approx(7.8 / 400 * 100, rel=0.01)
    assert bench.read()["mcu_1_total_energy_Wh"] == pytest.approx(12, rel=0.01)
    bench.tractor()
    bench.model.block()
    cold = power.temperature_degc
    bench.drive(0.6, 0.0, 60.0)
    assert cold + 0.1 < power.temperature_degc < cold + 1


def test_an_empty_battery_is_announced_and_ends_the_drive(bench: Bench) -> None:
    bench.tractor()
    bench.model.recharge(10.05)
    bench.model.block()
    bench.drive(0.6, 0.0, 15.0)
    assert bench.read()["mcu_1_fault_status"] == 0x10
    assert bench.read()["fault_status_word_4"] == 0x40
    assert bench.state is OperationalState.TRACTOR
    bench.model.recharge(0.01)
    bench.drive(0.6, 0.0, 6.0)
    assert bench.model.mcu_faults[1] == 0x90
    assert not bench.model.powered


def test_telemetry_is_quantised_as_in_the_logs(bench: Bench) -> None:
    bench.wait(7.0)
    values = bench.read()
    for name, per_unit in {
        "aux_batt_soc": 2.55,
        "aux_batt_voltage_V": 128,
        "aux_batt_current_A": 128,
        "aux_batt_temp_degC": 16,
        "front_base_batt_1_temp_degC": 16,
        "operational_time": 100,
    }.items():
        steps = values[name] * per_unit
        assert steps > 1
        assert steps == pytest.approx(round(steps), abs=1e-3), name
    assert values["left_rear_vel_mps"] == values["pse_data_is_valid"] == 0


def test_positions_are_summed_in_float32_and_stick_far_from_home() -> None:
    bench = Bench()
    bench.model.drive.right_m = bench.model.drive.left_m = 300_000.0
    bench.tractor()
    before = bench.read()["right_front_pos_m"]
    bench.drive(0.6, 0.0, 3.0)
    assert bench.read()["right_front_pos_m"] == before, "3 mm a tick is less than half of float32's 31 mm"
    fine = Bench(unknowns=Unknowns(float32_positions=False))
    fine.model.drive.right_m = 300_000.0
    fine.tractor()
    fine.drive(0.6, 0.0, 3.0)
    assert fine.model.drive.right_m > 300_000.5


def test_faults_are_written_into_the_base_s_own_log_which_survives_power_off(bench: Bench) -> None:
    bench.wait(3.0)
    bench.send(motion(math.nan, 0.0))
    bench.wait(2.0)
    bench.send(configure(99))
    bench.send(configure(99))
    bench.model.power_off()
    bench.wait(1.0)
    bench.model.power_on(bench.now_ns)
    bench.wait(1.0)
    words = bench.words(configure(33, 1)) + tuple(w for _ in range(5) for w in bench.words(configure(33, 0)))
    log = decode_fault_log(words[:FAULT_LOG_WORDS])
    assert [entry.texts for entry in log.entries] == [
        ("communication: bad motion command received", "communication: unknown configuration command received"),
        ("communication: bad motion command received",),
    ]
    assert [entry.run_time_s for entry in log.entries] == [5, 3]
    assert [entry.power_cycle for entry in log.entries] == [1, 1]
    assert log.entries[0].latest
    assert (log.size, log.power_cycles, log.entry_count) == (FAULT_LOG_WORDS, 2, 2)
    assert bench.model.fault_words == [0, 0, 0, 0], "the faults themselves went with the power"


def test_the_fault_log_is_a_ring_of_twenty(bench: Bench) -> None:
    for k in range(30):
        bench.model.fault_words[2] = 0
        bench.model.memory._seen = (0, 0, 0, 0)
        bench.model.raise_fault(2, 1 << k % 10)
        bench.wait(1.0)
    log = decode_fault_log(bench.model.memory.words(bench.model.run_time_s, 0.0))
    assert (len(log.entries), log.latest_index) == (20, 9)
    assert log.entries[0].groups[3] == 1 << 9


def test_without_limit_mapping_turning_is_limited_by_the_lateral_acceleration() -> None:
    stored = Stored.of(
        {**RMP110_STORED, "max_velocity": 4.0, "max_accel": 7.0, "max_yaw_rate": 4.5, "max_yaw_accel": 20.0}
    )
    for bitmap, expected in ((0x101, 4.5), (0x100, 9.80665 / 4.0)):
        bench = Bench(stored=stored)
        bench.send(configure(12, bitmap))
        bench.tractor()
        seen = bench.drive(1.0, 1.0, 4.0)[-1]
        assert seen["yaw_rate_target_rps"] == pytest.approx(expected, rel=1e-3)


def test_with_acceleration_mapping_it_speeds_up_while_commanded_and_then_coasts(bench: Bench) -> None:
    bench.send(configure(12, 0x103))
    bench.tractor()
    bench.wait(1.0)
    speeds = [seen["linear_vel_mps"] for seen in bench.drive(0.2, 0.0, 2.0)]
    assert speeds[80] - speeds[30] == pytest.approx(0.2 * 0.5 * 1.0, rel=0.02)
    coasting = [seen["linear_vel_mps"] for seen in bench.drive(0.0, 0.0, 1.0)]
    assert coasting[30] - coasting[20] == pytest.approx(-0.1962 * 0.2, rel=0.02)


def test_the_velocity_filter_slows_the_approach() -> None:
    quick = Bench()
    slow = Bench()
    slow.send(configure(12, 0x101 | 8 << 9))
    for each in (quick, slow):
        each.tractor()
        each.drive(0.2, 0.0, 1.0)
    assert quick.model.drive.v == pytest.approx(0.1, rel=0.01)
    assert 0.02 < slow.model.drive.v < 0.08


def test_on_the_charger_it_does_not_drive_unless_the_bitmap_says_so(bench: Bench) -> None:
    bench.model.charging = True
    bench.send(request_mode(ModeRequest.TRACTOR))
    bench.wait(0.1)
    assert bench.state is OperationalState.STANDBY
    bench.send(configure(12, 0x109))
    bench.tractor()


def test_what_nobody_knows_can_be_chosen() -> None:
    refusing = Bench(unknowns=Unknowns(refused_bitmaps=frozenset({0x101})))
    refusing.send(configure(12, 0x1))
    refusing.send(configure(12, 0x101))
    assert refusing.model.stored["input_bitmap"] == 0x1

    narrow = Bench(stored=Stored.of({}), unknowns=Unknowns(narrow_track=True))
    narrow.send(configure(10, 0.481224))
    narrow.send(configure(10, 0.3))
    assert narrow.model.stored["track_width"] == pytest.approx(0.481224)

    polled = Bench(unknowns=Unknowns(poll_refreshes_motion=True))
    polled.tractor()
    polled.drive(1.0, 0.0, 2.0)
    for _ in range(100):
        polled.read()
        polled.wait(0.02)
    assert polled.model.drive.v == pytest.approx(0.5)

    gentle = Bench(unknowns=Unknowns(dtz_switches_off=False, bad_motion_faults=False))
    gentle.tractor()
    gentle.drive(1.0, 0.0, 1.0)
    gentle.send(motion(2.0, 0.0))
    gentle.send(request_mode(ModeRequest.DTZ))
    gentle.wait(2.0)
    assert (gentle.state, gentle.model.fault_words) == (OperationalState.STANDBY, [0, 0, 0, 0])

    slow = Bench(unknowns=Unknowns(most_hz=100.0))
    answered = [bool(slow.send(POLL)) for _ in range(3)]
    slow.wait(0.01)
    assert [*answered, bool(slow.send(POLL))] == [True, False, False, True]

    sparing = Bench(unknowns=Unknowns(reset_spares_feedback=True))
    sparing.send(configure(17, 0x3))
    sparing.send(configure(35))
    assert sparing.model.stored.bitmaps[0] == 0x3
    plain = Bench()
    plain.send(configure(17, 0x3))
    plain.send(configure(35))
    assert plain.model.stored == Stored.of({})


def test_switching_off_unasked_ends_after_a_second(bench: Bench) -> None:
    bench.model.kill_switch()
    bench.wait(1.1)
    assert bench.send(POLL) == ()


def test_a_watchdog_reset_is_in_standby_at_once_and_remembers_nothing(bench: Bench) -> None:
    bench.tractor()
    bench.drive(1.0, 0.0, 1.0)
    bench.send(B2.act(Action.FORCE_CONFIG_FEEDBACK, 1))
    bench.model.restart(bench.now_ns)
    seen = bench.read()
    assert (seen["operational_state"], seen["vel_limit_mps"], seen["right_front_pos_m"]) == (3, 0.0, 12.75)
    assert seen["operational_time"] == 0.0
    bench.drive(1.0, 0.0, 0.5)
    assert bench.model.twist == (0.0, 0.0)


anything = st.one_of(
    st.builds(Frame, st.integers(0x4FE, 0x603), st.binary(max_size=8)),
    st.builds(configure, st.sampled_from([0, 12, 17, 18, 19, 20, 30, 32, 33, 34, 35, 36]), st.integers(0, 40)),
    st.builds(motion, st.floats(-1.25, 1.25, width=32), st.floats(width=32)),
    st.builds(motion, st.floats(-1, 1, width=32), st.floats(-1, 1, width=32)),
)


@given(st.lists(anything, max_size=60), st.sampled_from(list(VOCABULARIES)))
def test_any_frames_leave_it_within_its_limits_and_answering_at_most_one_packet(
    frames: list[Frame], dialect: Dialect
) -> None:
    bench = Bench(dialect=dialect)
    bench.tractor()
    for frame in frames:
        replies = bench.send(frame)
        assert [reply.can_id for reply in replies] == list(range(0x502, 0x502 + len(replies)))
        assert len(replies) <= 48
        assert all(len(reply.data) == 8 for reply in replies)
        bench.wait(0.013)
        assert all(math.isfinite(value) for value in bench.model.twist)
        assert len(bench.model.take_unsolicited()) <= 100


limits = st.fixed_dictionaries(
    {
        "max_velocity": st.floats(0.0625, 8.0, width=32),
        "max_accel": st.floats(0.0625, 7.5, width=32),
        "max_decel": st.floats(0.0625, 7.5, width=32),
        "max_yaw_rate": st.floats(0.125, 4.5, width=32),
        "max_yaw_accel": st.floats(0.25, 28.0, width=32),
    }
)
commands = st.lists(st.tuples(st.floats(-1, 1, width=32), st.floats(-1, 1, width=32), st.integers(1, 60)), max_size=8)


@given(limits, commands)
def test_speeds_stay_within_stored_limits_and_accelerations_and_end_in_standstill(
    stored: dict[str, float], plan: list[tuple[float, float, int]]
) -> None:
    bench = Bench(stored=Stored.of({**RMP110_STORED, **stored}))
    bench.tractor()
    model, settings = bench.model, bench.model.settings
    most_accel = min(TRACTION_MPS2, max(settings.accel, settings.decel))

    def tick() -> None:
        before_v, before_yaw = model.drive.v, model.drive.yaw
        bench.wait(DT)
        assert abs(model.drive.v) <= settings.velocity * (1 + 1e-6)
        assert abs(model.drive.yaw) <= settings.yaw_rate * (1 + 1e-6)
        assert abs(model.drive.v - before_v) <= most_accel * DT * (1 + 1e-6)
        assert abs(model.drive.yaw - before_yaw) <= settings.yaw_accel * DT * (1 + 1e-6)

    for velocity, yaw_rate, ticks in plan:
        bench.send(motion(velocity, yaw_rate))
        for _ in range(ticks):
            tick()
    longest_s = 0.6 + settings.velocity / settings.decel + settings.yaw_rate / settings.yaw_accel + 1.0
    bench.wait(longest_s)
    assert model.twist == (0.0, 0.0), "standstill after the timeout"
    assert bench.state is OperationalState.TRACTOR
