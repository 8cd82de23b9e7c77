"""The simulated base with V3 firmware: the sheet's vectors, the stream, UDP and a serial device."""

from __future__ import annotations

import asyncio
import itertools
import math
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.rmp110.codec.bytestream import pack_command
from drivers.rmp110.codec.fault_log import decode_fault_log
from drivers.rmp110.codec.frames import Frame, word_to_float
from drivers.rmp110.codec.parameters import RMP110_STORED, ModeRequest, OperationalState, Stored
from drivers.rmp110.codec.v3.commands import (
    ETHERNET_ID,
    GENERAL_ID,
    General,
    continuous_data,
    general,
    machine_config,
    motion,
    request_mode,
    torque_limit,
)
from drivers.rmp110.codec.v3.packets import (
    FAULT_LOG_BYTES,
    POWERING_DOWN,
    STATUS_BYTES,
    byte_order,
    machine,
    parse_packet,
    unpack_words,
)
from drivers.rmp110.codec.v3.words import LAYOUT, PARAMETERS
from drivers.rmp110.errors import RmpLinkError
from drivers.rmp110.simulator.faults import FaultPlan
from drivers.rmp110.simulator.packet_wires import CommandSplitter, PtyWire, UdpWire
from drivers.rmp110.simulator.serve import serve_v3
from drivers.rmp110.simulator.v3_model import COMMAND_BYTES, V3Model
from drivers.rmp110.transport.datagram import DatagramTransport
from drivers.rmp110.transport.serial_port import SerialTransport

Until = Callable[..., Any]
POLL = general(General.NONE)


class Bench:
    """A model, a clock that is only a number, and a hand that sends."""

    def __init__(self, **options: Any) -> None:
        self.now_ns = 0
        self.model = V3Model(0, boot_s=0.0, **options)
        self.wait(0.02)

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)
        self.model.step(self.now_ns)

    def send(self, frame: Frame) -> tuple[bytes, ...]:
        return self.model.receive(self.now_ns, pack_command(frame))

    def read(self, frame: Frame = POLL) -> dict[str, float]:
        (packet,) = self.send(frame)
        return values(packet)

    def drive(self, v: float, w: float, seconds: float) -> dict[str, float]:
        seen = {}
        for _ in range(round(seconds * 50)):
            seen = self.read(motion(v, w))
            self.wait(0.02)
        return seen

    def tractor(self) -> None:
        self.send(request_mode(ModeRequest.TRACTOR))
        self.wait(0.06)
        assert self.model.state is OperationalState.TRACTOR


def values(packet: bytes) -> dict[str, float]:
    frame = parse_packet(packet)
    assert frame is not None
    order = byte_order(frame.data)
    assert order is not None
    return LAYOUT.decode(unpack_words(frame.data, order))


@pytest.fixture
def bench() -> Bench:
    return Bench()


VECTORS = {
    "motion 0.5 m/s, 0.2 rad/s": "18 00 3F 00 00 00 00 00 00 00 3E 4C CC CD E6 14",
    "motion zero": "18 00 00 00 00 00 00 00 00 00 00 00 00 00 18 18",
    "tractor": "18 03 00 00 00 02 00 00 00 05 4C 2D",
    "standby": "18 03 00 00 00 02 00 00 00 04 8C EC",
    "fault log": "18 03 00 00 00 03 00 00 00 00 8F D0",
    "reset integrators": "18 03 00 00 00 04 00 00 00 1F 87 24",
    "audio 7": "18 03 00 00 00 01 00 00 00 07 8D E8",
    "torque limit 0.5": "18 03 00 00 00 07 3F 00 00 00 5B 2D",
}
"""Fact sheet 15.4."""


@pytest.mark.parametrize("name", VECTORS)
def test_the_sheet_s_commands_are_taken_and_answered_once(name: str, bench: Bench) -> None:
    (reply,) = bench.model.receive(bench.now_ns, bytes.fromhex(VECTORS[name]))
    assert len(reply) == (FAULT_LOG_BYTES if name == "fault log" else STATUS_BYTES)
    assert bench.model.fault_words == [0, 0, 0, 0]


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_status_packet_says_that_this_is_a_110_in_either_byte_order(order: str) -> None:
    (packet,) = Bench(order=order).send(POLL)
    frame = parse_packet(packet)
    assert frame is not None
    assert len(packet) == 532
    assert byte_order(frame.data) == order
    words = unpack_words(frame.data, order)
    assert machine(words) == 8
    assert [word_to_float(word) for word in words[116:118]] == [0.5, 0.5]
    assert word_to_float(words[116 + 9]) == pytest.approx(0.481224)


def test_it_drives_in_metres_and_turns_counter_clockwise(bench: Bench) -> None:
    bench.tractor()
    seen = bench.drive(0.3, 0.4, 2.0)
    assert (seen["linear_vel_mps"], seen["odom_yaw_rate_rps"]) == pytest.approx((0.3, 0.4))
    assert (seen["vel_target_mps"], seen["yaw_rate_target_rps"]) == pytest.approx((0.3, 0.4))
    assert seen["right_front_vel_mps"] > seen["left_front_vel_mps"]
    assert bench.model.twist == pytest.approx((0.3, 0.4))
    assert seen["odom_yaw_rad"] > 0.3
    assert seen["odom_y_m"] > 0.02
    assert bench.drive(5.0, 0.0, 1.0)["linear_vel_mps"] == pytest.approx(0.5), "limited to its stored maximum"


def test_values_that_are_no_numbers_latch_a_fault(bench: Bench) -> None:
    bench.tractor()
    bench.send(motion(math.nan, 0.0))
    bench.wait(0.5)
    assert bench.read()["fault_status_word_2"] == 0x10
    assert bench.model.twist == (0.0, 0.0)


def test_a_damaged_command_latches_the_checksum_fault_and_gets_no_reply(bench: Bench) -> None:
    packet = bytearray(pack_command(POLL))
    packet[-1] ^= 1
    assert bench.model.receive(bench.now_ns, bytes(packet)) == ()
    assert bench.read()["fault_status_word_2"] == 0x40
    assert bench.send(Frame(0x1804, bytes(8))) != ()
    assert bench.read()["fault_status_word_2"] == 0x60


@pytest.mark.parametrize("packet", [b"", b"\x18", pack_command(POLL)[:-1], pack_command(Frame(0x1800, bytes(8)))])
def test_a_packet_of_a_wrong_length_is_ignored(packet: bytes, bench: Bench) -> None:
    assert bench.model.receive(bench.now_ns, packet) == ()
    assert bench.model.fault_words == [0, 0, 0, 0]


def test_the_machine_configuration_is_taken_parameter_by_parameter(bench: Bench) -> None:
    wanted = Stored.of({"max_velocity": 9.0, "max_accel": 1.0, "track_width": 0.542391}, parameters=PARAMETERS)
    bench.send(machine_config(wanted))
    stored = bench.model.stored
    assert stored["max_velocity"] == 0.5, "out of range: the old value"
    assert (stored["max_accel"], stored["track_width"]) == pytest.approx((1.0, 0.542391))
    bench.send(Frame(ETHERNET_ID, bytes(16)))
    assert bench.read()["stored_ip_port"] == 0
    bench.send(general(General.RESET_PARAMETERS))
    assert bench.model.stored == Stored.of({}, parameters=PARAMETERS)


def test_the_stream_comes_with_100_hz_and_is_the_only_answer_then(bench: Bench) -> None:
    bench.send(continuous_data(on=True))
    assert bench.send(POLL) == ()
    bench.wait(0.5)
    stamps = [stamp for stamp, _ in bench.model.take_unsolicited()]
    assert [b - a for a, b in itertools.pairwise(stamps)] == [10_000_000] * 49
    assert len(bench.send(general(General.FAULT_LOG))[0]) == FAULT_LOG_BYTES
    bench.send(continuous_data(on=False))
    bench.wait(0.5)
    assert bench.model.take_unsolicited() == []
    assert bench.send(POLL)


def test_the_kill_switch_ends_the_stream_with_one_packet_and_a_notice(bench: Bench) -> None:
    bench.send(continuous_data(on=True))
    bench.model.kill_switch()
    bench.wait(0.5)
    ((_, (packet,)),) = bench.model.take_unsolicited()
    last = values(packet)
    assert (last["operational_state"], last["fault_status_word_1"], last["dynamic_response"]) == (6, 0x40, 0x200)
    assert (bench.model.take_notices(), bench.model.take_notices()) == (1, 0)
    assert bench.send(POLL) == ()


def test_the_power_button_gives_notice_and_half_a_minute(bench: Bench) -> None:
    bench.model.press_power_button()
    assert bench.model.take_notices() == 1
    bench.wait(29.0)
    assert bench.send(POLL)
    bench.wait(2.0)
    assert bench.send(POLL) == ()


def test_the_fault_log_of_311_words(bench: Bench) -> None:
    bench.send(Frame(0x1804, bytes(8)))
    (packet,) = bench.send(general(General.FAULT_LOG))
    frame = parse_packet(packet)
    assert frame is not None
    log = decode_fault_log(unpack_words(frame.data, "<"))
    assert log.entries[0].texts == ("communication: unknown configuration command received",)


def test_the_torque_limit_shows_in_the_current_limits(bench: Bench) -> None:
    bench.send(torque_limit(0.5))
    assert bench.read()["right_front_current_limit_A0pk"] == pytest.approx(17.4955)
    bench.send(torque_limit(2.0))
    assert bench.model.torque_limit == 0.5


def test_the_stored_filter_and_charger_bits_are_where_v3_has_them(bench: Bench) -> None:
    before = bench.model.settings
    assert before.drive_while_charging, "the vendor's own default for a 110"
    slow = Stored.of({"input_bitmap": 0x8 << 7}, parameters=PARAMETERS)
    bench.send(machine_config(slow))
    assert not bench.model.settings.drive_while_charging
    assert bench.model.settings.share < 0.02


commands = st.one_of(
    st.binary(max_size=60),
    st.builds(lambda a, b: pack_command(general(General(a), b)), st.integers(0, 7), st.integers(0, 0xFFFFFFFF)),
    st.builds(lambda v, w: pack_command(motion(v, w)), st.floats(width=32), st.floats(width=32)),
    st.builds(lambda data: pack_command(Frame(0x1801, data)), st.binary(min_size=48, max_size=48)),
)


@given(st.lists(commands, max_size=30))
def test_any_packets_leave_it_sane_and_answering_whole_packets(packets: list[bytes]) -> None:
    bench = Bench()
    bench.tractor()
    for packet in packets:
        for reply in bench.model.receive(bench.now_ns, packet):
            assert len(reply) in (STATUS_BYTES, FAULT_LOG_BYTES)
            assert parse_packet(reply) is not None
        bench.wait(0.013)
        assert all(math.isfinite(value) for value in bench.model.twist)
        assert all(parse_packet(packet) for _, (packet,) in bench.model.take_unsolicited())


@given(st.lists(st.sampled_from([POLL, motion(0.1, 0.2), request_mode(ModeRequest.STANDBY)]), max_size=8), st.data())
def test_commands_survive_a_serial_line_in_any_fragmentation(frames: list[Frame], data: st.DataObject) -> None:
    stream = b"".join(pack_command(frame) for frame in frames)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=5)))
    splitter = CommandSplitter()
    pieces = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    found = [packet for piece in pieces for packet in splitter.feed(0, piece)]
    assert found == [pack_command(frame) for frame in frames]
    assert splitter.skipped == 0


@given(st.lists(st.binary(max_size=200), max_size=6))
def test_hostile_bytes_on_the_serial_line_are_bounded(chunks: list[bytes]) -> None:
    splitter = CommandSplitter()
    for k, chunk in enumerate(chunks):
        for packet in splitter.feed(k, chunk):
            assert len(packet) == COMMAND_BYTES[int.from_bytes(packet[:2], "big")]
        assert len(splitter._buffer) < max(COMMAND_BYTES.values())
    # Whatever came before, a pause and a whole command get through.
    assert splitter.feed(10**9, pack_command(POLL))[-1:] == [pack_command(POLL)]


class Ear:
    """What a transport hands over."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.reasons: list[str] = []

    async def open(self, transport: DatagramTransport | SerialTransport) -> None:
        await transport.open(lambda _, frame: self.frames.append(frame), self.reasons.append)


async def test_over_udp_the_driver_s_transport_hears_replies_stream_and_notice(until: Until) -> None:
    ear = Ear()
    notices = free_udp_port()
    wire = UdpWire("127.0.0.1", 0, notice_port=notices)
    async with serve_v3(wire, model=V3Model(time.monotonic_ns(), boot_s=0.0)) as base:
        transport = DatagramTransport("127.0.0.1", base.port, notice_port=notices)
        await ear.open(transport)
        transport.send(POLL)
        await until(lambda: len(ear.frames) == 1)
        transport.send(continuous_data(on=True))
        await until(lambda: len(ear.frames) > 20)
        base.kill_switch()
        await until(lambda: ear.frames[-1].can_id == POWERING_DOWN)
        await transport.close()
    assert transport.damaged == 0


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])


async def test_over_a_serial_device_too_and_pulling_it_is_noticed(tmp_path: Path, until: Until) -> None:
    ear = Ear()
    device = tmp_path / "ttyRMP"
    wire = PtyWire(device)
    plan = FaultPlan(seed=1, drop=0.1)
    async with serve_v3(wire, model=V3Model(time.monotonic_ns(), boot_s=0.0), plan=plan) as base:
        transport = SerialTransport(str(device))
        await ear.open(transport)
        transport.send(request_mode(ModeRequest.TRACTOR))
        transport.send(continuous_data(on=True))
        await until(lambda: len(ear.frames) > 20)
        assert base.model.state is OperationalState.TRACTOR
        base.unplug()
        await until(lambda: ear.reasons)
        assert not device.is_symlink()
        with pytest.raises(RmpLinkError):
            transport.send(POLL)
        await transport.close()
        base.plug()
        again = SerialTransport(str(device))
        await ear.open(again)
        before = len(ear.frames)
        await until(lambda: len(ear.frames) > before)
        await again.close()
    assert not device.is_symlink()


async def test_a_serial_path_that_is_taken_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("x")
    with pytest.raises(FileExistsError):
        await PtyWire(tmp_path / "precious").open(lambda *_: None)
    assert (tmp_path / "precious").read_text() == "x"


async def test_the_command_line_serves_v3_and_ends_on_a_signal(until: Until) -> None:
    command = [sys.executable, "-m", "ghal360_robot", "simulate", "rmp110", "--dialect", "v3", "--boot", "0.1"]
    process = await asyncio.create_subprocess_exec(
        *command, "--udp", "127.0.0.1:0", "--faults", "drop=0.2,seed=3", stdout=subprocess.PIPE
    )
    assert process.stdout is not None
    try:
        sentence = (await asyncio.wait_for(process.stdout.readline(), 40)).decode()
        assert sentence.startswith("RMP-110, dialect V3, at 127.0.0.1:")
        port = int(sentence.rsplit(":", 1)[1].removesuffix("/udp\n"))
        ear = Ear()
        transport = DatagramTransport("127.0.0.1", port, notice_port=free_udp_port())
        await ear.open(transport)
        transport.send(continuous_data(on=True))
        for _ in range(20):
            # The fault plan may drop the answer, never the command.
            transport.send(Frame(GENERAL_ID, bytes(8)))
        await until(lambda: len(ear.frames) > 20)
        await transport.close()
        process.send_signal(signal.SIGTERM)
        assert await asyncio.wait_for(process.wait(), 10) == 0
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


def test_the_default_base_is_the_one_the_vendor_ships(bench: Bench) -> None:
    assert {name: bench.model.stored[name] for name in RMP110_STORED} == pytest.approx(dict(RMP110_STORED))
