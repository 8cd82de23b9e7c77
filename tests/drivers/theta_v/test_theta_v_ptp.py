"""PTP: the vectors of the fact sheet byte for byte, fragmentation, garbage, and the simulated responder."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.theta_v.codec import ptp
from drivers.theta_v.codec.health import Health
from drivers.theta_v.codec.ptp import (
    COMMAND,
    DATA,
    EVENT,
    RESPONSE,
    CaptureMode,
    Container,
    ContainerReader,
    DeviceInfo,
    Kind,
    Property,
    PropertyDescription,
    Response,
)
from drivers.theta_v.device.bringup import functions
from drivers.theta_v.device.ptp_session import PtpSession
from drivers.theta_v.errors import ThetaMalformed, ThetaStall
from drivers.theta_v.simulator.attached import AttachedTransport
from drivers.theta_v.simulator.camera import SimulatedThetaV
from drivers.theta_v.simulator.ptp import PtpResponder

SET, GET = 0x1016, 0x1015
VECTORS = [
    (ptp.command(0x1002, 0, 1), "10 00 00 00 01 00 02 10 00 00 00 00 01 00 00 00"),
    (Container(RESPONSE, 0x2001, 0), "0c 00 00 00 03 00 01 20 00 00 00 00"),
    (ptp.command(0x1001, 0), "0c 00 00 00 01 00 01 10 00 00 00 00"),
    (ptp.command(GET, 1, 0x5001), "10 00 00 00 01 00 15 10 01 00 00 00 01 50 00 00"),
    (Container(DATA, GET, 1, ptp.encode_value(Kind.U8, 98)), "0d 00 00 00 02 00 15 10 01 00 00 00 62"),
    (ptp.command(SET, 2, 0x5013), "10 00 00 00 01 00 16 10 02 00 00 00 13 50 00 00"),
    (Container(DATA, SET, 2, ptp.encode_value(Kind.U16, 0x8005)), "0e 00 00 00 02 00 16 10 02 00 00 00 05 80"),
    (ptp.command(SET, 3, Property.SLEEP_MODE), "10 00 00 00 01 00 16 10 03 00 00 00 0e d8 00 00"),
    (Container(DATA, SET, 3, b"\0"), "0d 00 00 00 02 00 16 10 03 00 00 00 00"),
    (ptp.command(SET, 4, Property.SLEEP_DELAY_S), "10 00 00 00 01 00 16 10 04 00 00 00 03 d8 00 00"),
    (Container(DATA, SET, 4, b"\0\0"), "0e 00 00 00 02 00 16 10 04 00 00 00 00 00"),
    (ptp.command(SET, 5, Property.AUTO_POWER_OFF_S), "10 00 00 00 01 00 16 10 05 00 00 00 1b d8 00 00"),
    (Container(DATA, SET, 5, ptp.encode_value(Kind.U32, 0)), "10 00 00 00 02 00 16 10 05 00 00 00 00 00 00 00"),
    (ptp.command(0x1003, 8), "0c 00 00 00 01 00 03 10 08 00 00 00"),
    (ptp.command(0x1013, 9), "0c 00 00 00 01 00 13 10 09 00 00 00"),
    (Container(EVENT, 0x4006, 0xFFFFFFFF, b"\x13\x50\0\0"), "10 00 00 00 04 00 06 40 ff ff ff ff 13 50 00 00"),
]  # fmt: skip
CAPTURE_MODE = bytes.fromhex("135004000101000100020700010003000280048005800680" + "0780")
BATTERY = bytes.fromhex("0150020000646201006401")


@pytest.mark.parametrize(("container", "raw"), VECTORS)
def test_containers_are_those_of_the_fact_sheet(container: Container, raw: str) -> None:
    assert container.encode() == bytes.fromhex(raw)
    assert ContainerReader().feed(bytes.fromhex(raw)) == [container]


def test_containers_are_found_at_any_fragmentation() -> None:
    raw = b"".join(c.encode() for c, _ in VECTORS)
    for size in (1, 2, 11, 12, 13, 64):
        reader = ContainerReader()
        found = [c for at in range(0, len(raw), size) for c in reader.feed(raw[at : at + size])]
        assert found == [c for c, _ in VECTORS]


@given(st.binary(max_size=200))
@settings(deadline=None)
def test_garbage_containers_and_data_sets_raise_only_the_codecs_own_error(raw: bytes) -> None:
    def read() -> None:
        for container in ContainerReader(1000).feed(raw):
            container.parameters  # noqa: B018 the property decodes

    for parse in (read, lambda: DeviceInfo.decode(raw), lambda: PropertyDescription.decode(raw)):
        with contextlib.suppress(ThetaMalformed):
            parse()


def test_property_descriptions_are_those_of_the_fact_sheet() -> None:
    mode = PropertyDescription.decode(CAPTURE_MODE)
    assert (mode.current, mode.choices) == (1, (1, 3, 0x8002, 0x8004, 0x8005, 0x8006, 0x8007))
    battery = PropertyDescription.decode(BATTERY)
    assert (battery.current, battery.span, battery.writable) == (98, (0, 100, 1), False)
    assert mode.encode() == CAPTURE_MODE
    assert battery.encode() == BATTERY


class Host:
    """Talks to a responder as the driver does, in single transfers."""

    def __init__(self, *, asleep: bool = False, mode: CaptureMode = CaptureMode.STILL) -> None:
        self.modes: list[CaptureMode] = []
        self.responder = PtpResponder("00105377", "3.50.1", mode, self.modes.append, lambda: None, asleep=asleep)

    def ask(self, command: Container, data: bytes | None = None) -> tuple[int, bytes]:
        self.responder.receive(command.encode())
        if data is not None:
            self.responder.receive(Container(DATA, command.code, command.transaction, data).encode())
        reader = ContainerReader()
        result = b""
        while (raw := self.responder.send(16384)) is not None:
            for container in reader.feed(raw):
                assert container.transaction == command.transaction
                if container.kind == RESPONSE:
                    return container.code, result
                result = container.body
        raise AssertionError("no response")


def test_the_simulated_v_describes_itself_as_the_real_one_does() -> None:
    code, raw = Host().ask(ptp.command(0x1001, 0))
    assert code == Response.OK
    assert len(raw) == 349
    assert raw.startswith(bytes.fromhex("6400 06000000 6e00 00 0000 31000000 0110"))
    info = DeviceInfo.decode(raw)
    assert (len(info.operations), len(info.events), len(info.properties)) == (49, 5, 49)
    assert (info.model, info.version, info.serial) == ("RICOH THETA V", "3.50.1", "00105377")
    assert DeviceInfo.encode(info) == raw


def test_property_values_need_a_session_and_the_right_type_and_value() -> None:
    host = Host()
    assert host.ask(ptp.command(GET, 1, 0x5001))[0] == Response.SESSION_NOT_OPEN
    assert host.ask(ptp.command(0x1002, 0, 1))[0] == Response.OK
    assert host.ask(ptp.command(0x1002, 0, 1))[0] == Response.SESSION_ALREADY_OPEN
    assert host.ask(ptp.command(GET, 1, 0x5001)) == (Response.OK, b"\x62")
    assert host.ask(ptp.command(0x1014, 2, 0x5013)) == (Response.OK, CAPTURE_MODE)
    assert host.ask(ptp.command(GET, 3, 0x1234))[0] == Response.PROPERTY_NOT_SUPPORTED
    assert host.ask(ptp.command(SET, 4, 0x5001), b"\x10")[0] == Response.ACCESS_DENIED
    assert host.ask(ptp.command(SET, 5, 0x5013), b"\x05")[0] == Response.INVALID_FORMAT
    assert host.ask(ptp.command(SET, 6, 0x5013), b"\x05\x70")[0] == Response.INVALID_VALUE
    assert host.ask(ptp.command(SET, 7, Property.SLEEP_DELAY_S), b"\x07\x00")[0] == Response.OK
    assert host.ask(ptp.command(GET, 8, Property.SLEEP_DELAY_S)) == (Response.OK, b"\x3c\x00")
    assert host.modes == []
    assert host.ask(ptp.command(SET, 9, 0x5013), b"\x05\x80")[0] == Response.OK
    assert host.modes == [CaptureMode.LIVE]


def test_a_sleeping_camera_refuses_the_first_session_and_is_busy_until_woken() -> None:
    host = Host(asleep=True)
    assert host.ask(ptp.command(0x1002, 0, 1))[0] == Response.GENERAL_ERROR
    assert host.ask(ptp.command(0x1002, 0, 1))[0] == Response.OK
    assert host.ask(ptp.command(GET, 1, 0x5013))[0] == Response.DEVICE_BUSY
    assert host.ask(ptp.command(GET, 2, 0x5001))[0] == Response.OK
    assert host.ask(ptp.command(SET, 3, Property.SLEEP_MODE), b"\0")[0] == Response.OK
    assert host.ask(ptp.command(GET, 4, 0x5013)) == (Response.OK, b"\x01\x00")


def test_an_answer_of_whole_packets_ends_with_a_zero_length_packet() -> None:
    host = Host()
    host.ask(ptp.command(0x1002, 0, 1))
    host.responder.set(0xD805, "x" * 245)
    host.responder.receive(ptp.command(0x1014, 1, 0xD805).encode())
    sizes = []
    while (raw := host.responder.send(512)) is not None:
        sizes.append(len(raw))
    assert sizes == [512, 0, 12]
    host.responder.receive(ptp.command(0x1014, 2, 0xD805).encode())
    whole = host.responder.send(1024)
    assert whole is not None
    assert len(whole) == 512, "a longer request swallows the zero-length packet"


def test_what_is_no_ptp_halts_the_endpoints_until_they_are_cleared() -> None:
    host = Host()
    with pytest.raises(ThetaStall):
        host.responder.receive(bytes(64))
    with pytest.raises(ThetaStall):
        host.responder.send(512)
    host.responder.clear_halt()
    assert host.ask(ptp.command(0x1001, 0))[0] == Response.OK


async def test_a_halted_pipe_is_cleared_for_the_next_operation() -> None:
    simulated = SimulatedThetaV()
    transport = AttachedTransport(simulated)
    await transport.open(None, lambda _: None)
    still = functions(transport).still
    assert still is not None
    session = PtpSession(transport, still)
    await session.open()
    await transport.bulk_out(still.bulk_out.address, ptp.command(SET, 7, 0x5001).encode())
    with pytest.raises(ThetaStall):
        await session.get(Property.BATTERY_LEVEL)
    await session.open()
    assert await session.get(Property.BATTERY_LEVEL) == 98
    await transport.close()


def test_data_that_belongs_to_another_operation_is_no_ptp() -> None:
    host = Host()
    host.ask(ptp.command(0x1002, 0, 1))
    host.responder.receive(ptp.command(SET, 1, Property.SLEEP_MODE).encode())
    with pytest.raises(ThetaStall):
        host.responder.receive(Container(DATA, SET, 2, b"\0").encode())


def test_an_event_fills_its_packet_of_28_bytes() -> None:
    host = Host()
    host.responder.set(Property.BATTERY_LEVEL, 50)
    raw = host.responder.event(28)
    assert raw is not None
    (event,) = ContainerReader().feed(raw)
    assert (event.kind, event.code, event.parameters) == (EVENT, 0x4006, (Property.BATTERY_LEVEL,))
    longest = Container(EVENT, 0x4006, 0xFFFFFFFF, bytes(16))
    assert len(longest.encode()) == 28
    assert ContainerReader().feed(longest.encode()) == [longest]


@pytest.mark.parametrize(("bits", "faults"), [
    (0, ()),
    (0x1D, ()),
    (0x80000000, ("its board is too hot, it will switch off",)),
    (0x00000140, ("it reports unknown faults 0x00000140",)),
])  # fmt: skip
def test_faults_are_told_in_words_and_what_does_not_concern_a_stream_is_not(bits: int, faults: tuple[str, ...]) -> None:
    assert Health(50, 1, bits).faults == faults


@pytest.mark.parametrize(
    ("percent", "status", "worried"), [(20, 0, True), (21, 0, False), (5, 1, False), (5, 2, False)]
)
def test_a_low_battery_is_told_where_nothing_charges_it(percent: int, status: int, worried: bool) -> None:
    assert bool(Health(percent, status, 0).faults) is worried
    assert len(Health(percent, status, 0x80000000).faults) == 1 + worried


def test_charging_states_beyond_the_known_are_told_as_they_are() -> None:
    assert [Health(1, status, 0).charging for status in range(4)] == [
        "not charging", "charging", "full", "battery status 3",
    ]  # fmt: skip


def test_a_command_container_out_of_range_is_refused() -> None:
    with pytest.raises(ThetaMalformed):
        ptp.command(1, 1, -1)
    assert Container(COMMAND, 1, 1, bytes(20)).parameters == (0,) * 5
    with pytest.raises(ThetaMalformed):
        Container(COMMAND, 1, 1, bytes(21)).parameters  # noqa: B018 the property decodes
