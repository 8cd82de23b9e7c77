"""Telegrams mean the same in both dialects, and what was recorded is understood byte for byte."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields as fields_of
from datetime import timedelta
from ipaddress import IPv4Address
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.tim571.codec import commands, hexwords, scandata
from drivers.tim571.codec.access import PASSWORDS, Level, password_hash
from drivers.tim571.codec.answers import DeviceIdent, DeviceState, Refusal, ScanConfig, understand
from drivers.tim571.codec.commands import OutputContent, OutputRange
from drivers.tim571.codec.deframer import Damage
from drivers.tim571.codec.dialect import Dialect, checksum, frame
from drivers.tim571.codec.faults import Fault, meaning
from drivers.tim571.codec.scandata import Channel, Clock, Encoder, Event, Position, ScanData
from drivers.tim571.codec.telegram import ANSWER_OF, Receiver, Telegram, parse
from drivers.tim571.errors import TimMalformedError


def same(one: ScanData, two: ScanData) -> bool:
    """Field by field, arrays by value."""

    def plain(value: Any) -> Any:
        if isinstance(value, tuple) and value and isinstance(value[0], Channel):
            return [[getattr(row, f.name) for f in fields_of(row)][:5] + row.samples.tolist() for row in value]
        return value

    return all(plain(getattr(one, f.name)) == plain(getattr(two, f.name)) for f in fields_of(ScanData))


def through_the_wire(telegram: Telegram) -> Telegram:
    (received,) = Receiver(telegram.dialect).feed(telegram.to_wire())
    assert isinstance(received, Telegram)
    return received


@given(payload=st.binary(max_size=200))
def test_the_checksum_is_the_xor_of_the_payload(payload: bytes) -> None:
    expected = 0
    for byte in payload:
        expected ^= byte
    assert checksum(payload) == expected


def test_frames_are_those_of_the_manual() -> None:
    assert (
        commands.read(Dialect.B, "LMDscandata").to_wire() == bytes.fromhex("020202020000000f") + b"sRN LMDscandata\x05"
    )
    on = bytes.fromhex("0202020200000011") + b"sEN LMDscandata \x01\x33"
    assert commands.subscribe(Dialect.B, "LMDscandata").to_wire() == on
    assert commands.subscribe(Dialect.A, "LMDscandata").to_wire() == b"\x02sEN LMDscandata 1\x03"
    assert commands.read(Dialect.A, "0").to_wire() == b"\x02sRI 0\x03"
    login = commands.invoke(Dialect.A, "SetAccessMode", 3, password_hash("client"))
    assert login.to_wire() == b"\x02sMN SetAccessMode 3 F4724744\x03"
    turn = commands.write(Dialect.A, "LMPoutputRange", 1, 3333, -450000, 2250000)
    assert turn.to_wire() == b"\x02sWN LMPoutputRange 1 D05 FFF92230 225510\x03"


def test_password_hashes_are_those_of_the_manual() -> None:
    hashes = {level: password_hash(PASSWORDS[level]) for level in PASSWORDS}
    assert hashes == {
        Level.MAINTENANCE: 0xB21ACE26,
        Level.AUTHORISED_CLIENT: 0xF4724744,
        Level.SERVICE: 0x81BE23AA,
    }
    assert password_hash("SICKSAFE") == 0x6FD62C05


def test_all_real_requests_and_answers_parse_and_build_again(command_pairs: list[dict[str, Any]]) -> None:
    assert len(command_pairs) == 143
    for pair in command_pairs:
        request = through_the_wire(parse(Dialect.B, bytes.fromhex(pair["request"])))
        answer = parse(Dialect.B, bytes.fromhex(pair["answer"]))
        assert request.to_wire().hex() == pair["request"]
        assert answer.to_wire().hex() == pair["answer"]
        assert ANSWER_OF[request.kind] == answer.kind
        assert request.name == answer.name
        commands.values_of(request)
        understand(answer)


def test_values_of_a_real_tim5xx(command_pairs: list[dict[str, Any]]) -> None:
    answers = [parse(Dialect.B, bytes.fromhex(p["answer"])) for p in command_pairs if "TiM5xx" in p["device"]]
    told = {t.name: commands.values_of(t) for t in answers if t.kind == "sRA"}
    assert told["FirmwareVersion"] == ("V2.60",)
    assert told["SCdevicestate"] == (0,)
    assert told["ODoprh"] == (0x68C,)
    assert told["LocationName"] == ("not defined",)
    assert told["LMPoutputRange"] == (1, 3333, -450000, 2250000)
    assert OutputContent.from_values(told["LMDscandatacfg"]) == OutputContent(rssi=True, name=False, time=True)


VALUES: dict[str, tuple[Any, ...]] = {
    "0": ("TiM57x", "V2.60-12.05.20"),
    "DeviceIdent": ("TiM57x", ""),
    "DItype": ("TiM571-2050101",),
    "DIornr": ("1075091",),
    "FirmwareVersion": ("V2.60",),
    "SerialNumber": ("17461662",),
    "SCdevicestate": (1,),
    "ODoprh": (0x68C,),
    "ODpwrc": (0xFFFFFFFF,),
    "LocationName": ("not defined",),
    "EIHstCola": (1,),
    "LMDscandatacfg": OutputContent(rssi=True, rssi_bits=16, every=3).to_values(),
    "LMPoutputRange": (1, 3333, -450000, 2250000),
    "LMPscancfg": (1500, -1, 3333, -450000, 2250000),
    "EIIpAddr": (192, 168, 0, 1),
    "EImask": (255, 255, 255, 0),
    "EIgate": (0, 0, 0, 0),
    "LFPparticle": (1, 500),
    "LFPmeanfilter": (1, 10, 0),
    "TSCRole": (1,),
    "TSCTCInterface": (0,),
    "TSCTCSrvAddr": (192, 168, 0, 11),
    "TSCTCupdatetime": (3600,),
    "TSCTCtimezone": (13,),
    "LIDoutputstate": (b"1 0",),
    "LIDinputstate": (b"",),
    "LFErec": (bytes.fromhex("41203141"),),
}


@pytest.mark.parametrize("name", commands.VARIABLES)
def test_a_variable_reads_and_writes_in_both_dialects(dialect: Dialect, name: str) -> None:
    values = VALUES[name]
    answer = through_the_wire(commands.value_answer(dialect, name, *values))
    assert (answer.kind, answer.name, commands.values_of(answer)) == ("sRA", name, values)
    request = through_the_wire(commands.read(dialect, name))
    assert (request.name, commands.values_of(request)) == (name, ())
    if name != "0":
        order = through_the_wire(commands.write(dialect, name, *values))
        assert (order.kind, commands.values_of(order)) == ("sWN", values)
        assert commands.values_of(through_the_wire(commands.written_answer(dialect, name))) == ()


@pytest.mark.parametrize("name", commands.METHODS)
def test_a_method_is_called_and_answers_in_both_dialects(dialect: Dialect, name: str) -> None:
    method = commands.METHODS[name]
    arguments = tuple(range(1, 1 + len(method.request)))
    request = through_the_wire(commands.invoke(dialect, name, *arguments))
    assert (request.kind, request.name, commands.values_of(request)) == ("sMN", name, arguments)
    results = tuple(1 for _ in method.answer)
    answer = through_the_wire(commands.method_answer(dialect, name, *results))
    assert (answer.kind, answer.name, commands.values_of(answer)) == ("sAN", name, results)


@pytest.mark.parametrize(
    ("answer", "meaning_of_it"),
    [
        (b"sRA DeviceIdent 6 TiM57x E V2.60-12.05.20", DeviceIdent("TiM57x", "V2.60-12.05.20")),
        (b"sRA 0 6 TiM57x 0", DeviceIdent("TiM57x", "")),
        (b"sRA SCdevicestate 1", DeviceState.READY),
        (b"sRA SCdevicestate 9", DeviceState.UNKNOWN),
        (b"sRA ODoprh 68C", timedelta(hours=167.6)),
        (b"sRA ODpwrc 79", 121),
        (b"sRA LocationName B not defined", "not defined"),
        (b"sRA EIHstCola 1", Dialect.B),
        (b"sRA LMPoutputRange 1 D05 FFF92230 225510", OutputRange()),
        (b"sRA LMPscancfg 5DC 1 D05 FFF92230 225510", ScanConfig(15.0, 1, OutputRange())),
        (b"sRA EIIpAddr C0 A8 0 1", IPv4Address("192.168.0.1")),
        (b"sRA TSCTCtimezone B", timedelta(hours=-1)),
        (b"sRA LFPparticle 0 1F4", None),
        (b"sRA LFPmeanfilter 1 A 0", 10),
        (b"sWA LMDscandatacfg", None),
        (b"sAN Run 1", True),
        (b"sAN SetAccessMode 0", False),
        (b"sAN LMCstartmeas 0", True),
        (b"sAN LMCstartmeas 1", False),
        (b"sAN mSCreboot", True),
        (b"sEA LMDscandata 1", True),
        (b"sFA 3", Refusal(Fault.UNKNOWN_VARIABLE, "it does not know the variable")),
        (b"sFA 77", Refusal(0x77, "undocumented error code 77")),
    ],
)
def test_an_answer_has_a_typed_meaning(answer: bytes, meaning_of_it: object) -> None:
    assert understand(parse(Dialect.A, frame(Dialect.A, answer))) == meaning_of_it


def test_settings_are_said_in_words() -> None:
    assert str(OutputContent(rssi=True, every=3)) == "distances, 8-bit signal strength, name, one scan in 3"
    assert str(OutputRange.from_yaw(-90, 90)) == "-90 to 90 degrees, a beam every 0.333"
    assert OutputRange.from_yaw(-135, 135) == OutputRange()
    with pytest.raises(ValueError, match="from -135 to 135"):
        OutputRange.from_yaw(-136, 0)


def test_the_vendor_drivers_way_of_writing_numbers_is_understood() -> None:
    order = parse(Dialect.A, b"\x02sWN LMDscandatacfg 01 00 1 1 0 00 00 0 0 0 1 +1\x03")
    assert commands.values_of(order) == OutputContent(rssi=True, rssi_bits=16, name=False, time=True).to_values()
    turn = parse(Dialect.A, b"\x02sWN LMPoutputRange 1 +3333 -450000 +2250000\x03")
    assert commands.values_of(turn) == (1, 3333, -450000, 2250000)
    assert parse(Dialect.A, b"\x02sRI0\x03").name == "0"


def test_a_fault_is_read_in_both_dialects_and_said_in_words() -> None:
    for framed in (frame(Dialect.B, b"sFA\x00\x03"), frame(Dialect.B, b"sFA \x00\x03"), b"\x02sFA 3\x03"):
        dialect = Dialect.A if framed[1] != 2 else Dialect.B
        fault = parse(dialect, framed)
        assert (fault.kind, commands.values_of(fault)) == ("sFA", (Fault.UNKNOWN_VARIABLE,))
    assert commands.fault(Dialect.B, 1).to_wire().hex() == "020202020000000573464100" + "0175"
    assert meaning(Fault.UNKNOWN_VARIABLE) == "it does not know the variable"
    assert meaning(0x77) == "undocumented error code 77"
    assert len({meaning(code) for code in Fault}) == len(Fault)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (b"sWN LMPoutputRange 1 D05", Fault.BUFFER_UNDERFLOW),
        (b"sWN LMPoutputRange 1 D05 0 0 0", Fault.BUFFER_OVERFLOW),
        (b"sWN LMPoutputRange 1 D05 xyz 0", Fault.INVALID_CHARACTER),
        (b"sWN LMPoutputRange 10000 D05 0 0", Fault.VALUE_OVERFLOW),
        (b"sWN LMPoutputRange 1 D_5 0 0", Fault.INVALID_CHARACTER),
        (b"sRN Nonsense", Fault.UNKNOWN_VARIABLE),
        (b"sMN Nonsense", Fault.UNKNOWN_METHOD),
        (b"sEN Nonsense 1", Fault.UNKNOWN_EVENT),
    ],
)
def test_a_wrong_request_tells_which_fault_it_deserves(text: bytes, fault: Fault) -> None:
    with pytest.raises(TimMalformedError) as caught:
        commands.values_of(parse(Dialect.A, frame(Dialect.A, text)))
    assert caught.value.fault == fault


def test_real_scans_decode_and_encode_to_the_same_bytes(cola_a_scans: list[bytes], cola_b_scans: list[bytes]) -> None:
    for dialect, frames in ((Dialect.A, cola_a_scans), (Dialect.B, cola_b_scans)):
        for framed in frames:
            telegram = parse(dialect, framed)
            scan = scandata.decode(telegram)
            distance = scan.channel("DIST1")
            assert distance is not None
            assert (len(distance.samples), distance.start_1e4deg, distance.step_1e4deg) == (811, -450000, 3333)
            assert scan.trailing == b""
            assert scandata.encode(scan, dialect, telegram.kind, telegram.name).to_wire() == framed


def test_what_the_recordings_say(cola_a_scans: list[bytes], cola_b_scans: list[bytes]) -> None:
    text = scandata.decode(parse(Dialect.A, cola_a_scans[0]))
    assert (text.name, text.clock, text.outputs, text.channels8) == ("Daniyal", None, (1, 0), ())
    binary = scandata.decode(parse(Dialect.B, cola_b_scans[0]))
    assert binary.clock is not None
    assert binary.clock.year == 1970
    rssi, distance = binary.channel("RSSI1"), binary.channel("DIST1")
    assert rssi is not None
    assert distance is not None
    assert (len(rssi.samples), rssi.samples.itemsize) == (811, 2)
    assert not np.any((distance.samples > 8) & (rssi.samples == 0))


BLOCKS: dict[str, dict[str, Any]] = {
    "plain": {},
    "rssi8": {"channels8": (Channel("RSSI1", 1.0, 0.0, -450000, 3333, np.arange(811).astype(np.uint8)),)},
    "encoder": {"encoders": (Encoder(70000, 12), Encoder(1, 2))},
    "position": {"position": Position(1.5, -2.0, 0.25, 0.0, 0.5, -0.5, 1)},
    "name": {"name": "not defined"},
    "odd names": {"name": "", "comment": "Büro 3  links"},
    "comment": {"comment": "0 0 0"},
    "clock": {"clock": Clock(2024, 2, 29, 23, 59, 58, 999_000)},
    "event": {"event": Event("FDIN", 5, 6, -450000)},
    "all": {
        "name": "a b c",
        "comment": "x",
        "position": Position(0, 0, 0, 0, 0, 0, 0),
        "clock": Clock(1970, 1, 1, 0, 0, 0, 0),
        "event": Event("FDIN", 1, 2, 3),
    },
}


@pytest.mark.parametrize("blocks", BLOCKS.values(), ids=BLOCKS)
@pytest.mark.parametrize(("kind", "name"), [("sRA", "LMDscandata"), ("sSN", "LMDscandata"), ("sSN", "LMDscandatamon")])
def test_every_block_survives_both_dialects(
    dialect: Dialect, blocks: dict[str, Any], kind: str, name: str, make_scan: Callable[..., ScanData]
) -> None:
    scan = make_scan(**blocks)
    telegram = through_the_wire(scandata.encode(scan, dialect, kind, name))
    assert scandata.is_scan(telegram)
    assert (telegram.kind, telegram.name) == (kind, name)
    assert same(scandata.decode(telegram), scan)


@given(samples=st.lists(st.integers(0, 0xFFFF), max_size=60), scale=st.floats(width=32, allow_nan=False))
def test_any_samples_survive_both_dialects(
    make_scan: Callable[..., ScanData], samples: list[int], scale: float
) -> None:
    wide = Channel("DIST1", scale, 0.0, -450000, 3333, np.array(samples, np.uint16))
    slim = Channel("RSSI1", 1.0, 0.0, 0, 3333, np.array(samples, np.uint16).astype(np.uint8))
    scan = make_scan(channels16=(wide,), channels8=(slim,))
    for dialect in Dialect:
        back = scandata.decode(through_the_wire(scandata.encode(scan, dialect)))
        assert same(back, scan)
        assert math.copysign(1, back.channels16[0].scale) == math.copysign(1, scale)


def test_an_empty_telegram_is_a_scan_without_channels() -> None:
    telegram = parse(Dialect.A, b"\x02sRA LMDscandata" + b" 0" * 24 + b"\x03")
    scan = scandata.decode(telegram)
    assert (scan.channels16, scan.channels8, scan.trailing) == ((), (), b"")


def test_a_frame_has_the_size_computed_from_the_manual(make_scan: Callable[..., ScanData]) -> None:
    assert len(scandata.encode(make_scan(), Dialect.B).to_wire()) == 1720
    clock = Clock(1970, 1, 1, 0, 0, 0, 0)
    assert len(scandata.encode(make_scan(clock=clock), Dialect.B).to_wire()) == 1731
    assert len(scandata.encode(make_scan(clock=clock, **BLOCKS["rssi8"]), Dialect.B).to_wire()) == 2563


@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_damaged_scans_are_refused_or_decoded_but_never_crash(
    make_scan: Callable[..., ScanData], data: st.DataObject
) -> None:
    dialect = data.draw(st.sampled_from(Dialect))
    body = bytearray(scandata.encode(make_scan(beams=20, **BLOCKS["all"]), dialect).body)
    for at, byte in data.draw(st.lists(st.tuples(st.integers(0, len(body) - 1), st.integers(0, 255)), max_size=4)):
        body[at] = byte
    cut = data.draw(st.integers(0, len(body)))
    try:
        scan = scandata.decode(Telegram(dialect, "sSN", "LMDscandata", bytes(body[:cut])))
    except TimMalformedError:
        return
    assert scandata.encode(scan, dialect).kind == "sSN"


@given(payload=st.binary(max_size=60))
@settings(max_examples=150, deadline=None)
def test_any_payload_becomes_a_telegram_or_damage(payload: bytes) -> None:
    for dialect in Dialect:
        for kind in (b"sFA", b"sRA", b"sSI", b"sRI"):
            for event in Receiver(dialect).feed(frame(dialect, kind + payload)):
                assert isinstance(event, Telegram | Damage)
                if isinstance(event, Telegram):
                    with suppress(TimMalformedError):
                        assert isinstance(commands.values_of(event), tuple)


@pytest.mark.parametrize(
    "text", [b"1 2", b"1 2 ", b"1  3", b"1 2 G", b"1 2 12345", b"1 2 +3", b"", b"1 2\t3", b"1 2 1_0"]
)
def test_hex_runs_that_are_none_are_refused(text: bytes) -> None:
    with pytest.raises(TimMalformedError):
        hexwords.parse(text, 0, 3, np.uint16)


def test_hex_runs_end_at_the_next_token() -> None:
    values, end, canonical = hexwords.parse(b"xx FF 0 aB 7 8", 3, 3, np.uint8)
    assert (values.tolist(), end, canonical) == ([0xFF, 0, 0xAB], 11, False)
    assert hexwords.parse(b"FF 0 AB", 0, 3, np.uint16).canonical
    assert not hexwords.parse(b"FF 00 AB", 0, 3, np.uint16).canonical
    with pytest.raises(TimMalformedError):
        hexwords.parse(b"100 0", 0, 2, np.uint8)
