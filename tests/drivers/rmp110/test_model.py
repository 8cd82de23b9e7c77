"""The simulated base against the measured behaviour of the real one, with a clock that is only a number."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.codec.commands import POLL, ZERO_MOTION, configure, force_config_feedback, motion, request_mode
from drivers.rmp110.codec.feedback import COMPACT_BITMAPS, Dialect, Layout
from drivers.rmp110.codec.frames import CONFIG_ID, MOTION_ID, Frame, float_to_word, unpack_words
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, OperationalState, Stored
from drivers.rmp110.simulator.model import RmpModel

COMPACT_BITMAP_NAMES = {f"feedback_bitmap_{n}": word for n, word in enumerate(COMPACT_BITMAPS, start=1)}
MS = 1_000_000


class Bench:
    """A model, a clock, and a hand that sends."""

    def __init__(self, *, boot_s: float = 0.0, stored: Stored | None = None, dialect: Dialect = Dialect.B2) -> None:
        self.now_ns = 5_000_000_000
        self.model = RmpModel(self.now_ns, stored, boot_s=boot_s, dialect=dialect)
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
        return Layout.of(self.model.stored.bitmaps).decode(words)

    def drive(self, velocity: float, yaw_rate: float, seconds: float) -> list[dict[str, float]]:
        """Motion frames with 50 Hz; the feedback of each."""
        seen = []
        for _ in range(round(seconds * 50)):
            seen.append(self.read(motion(velocity, yaw_rate)))
            self.wait(0.02)
        return seen

    def tractor(self) -> None:
        self.send(request_mode(ModeRequest.TRACTOR))
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
    replies = bench.send(force_config_feedback(on=True))
    assert tuple(word for reply in replies for word in unpack_words(reply.data)) == off.words
    assert bench.send(force_config_feedback(on=False)) == ()


def test_dialect_b3_answers_one_frame_more() -> None:
    replies = Bench(dialect=Dialect.B3).send(force_config_feedback(on=True))
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


@given(
    st.lists(
        st.one_of(
            st.builds(Frame, st.integers(0x4FE, 0x603), st.binary(max_size=8)),
            st.builds(configure, st.sampled_from([0, 12, 17, 18, 19, 20, 30, 32, 33, 34, 35]), st.integers(0, 40)),
            st.builds(motion, st.floats(-1.25, 1.25, width=32), st.floats(width=32)),
        ),
        max_size=60,
    )
)
def test_any_frames_leave_it_within_its_limits_and_answering_at_most_one_packet(frames: list[Frame]) -> None:
    bench = Bench()
    bench.tractor()
    for frame in frames:
        replies = bench.send(frame)
        assert [reply.can_id for reply in replies] == list(range(0x502, 0x502 + len(replies)))
        assert len(replies) <= 48
        bench.wait(0.013)
        assert abs(bench.model.drive.v) <= bench.model.stored["max_velocity"] + 1e-6
        assert all(math.isfinite(value) for value in bench.model.twist)
