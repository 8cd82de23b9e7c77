"""Descriptors and negotiation: everything is read from the device, and nothing of it is trusted."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.theta_v.codec.descriptors import (
    BULK,
    INTERRUPT,
    ISOCHRONOUS,
    find_still,
    find_video,
    parse_configuration,
)
from drivers.theta_v.codec.probe import ControlRequest, Probe, negotiate
from drivers.theta_v.errors import ThetaMalformed, ThetaRefused
from drivers.theta_v.simulator.descriptors import LIVE_CONFIGURATION, MTP_CONFIGURATION


def test_the_live_configuration_is_read_as_the_fact_sheet_decodes_it() -> None:
    assert len(LIVE_CONFIGURATION) == 432
    configuration = parse_configuration(LIVE_CONFIGURATION)
    video = find_video(configuration)
    assert video is not None
    assert (video.interface, video.bcd_uvc) == (2, 0x0150)
    (h264,) = video.formats
    assert [(f.index, f.width, f.height, f.profile, f.level, f.max_bit_rate) for f in h264.frames] == [
        (1, 3840, 1920, 0x4240, 51, 240_000_000),
        (2, 1920, 960, 0x4240, 40, 20_000_000),
    ]
    assert [f.intervals_100ns for f in h264.frames] == [(333_667,), (333_667,)]
    pipe = video.pipe(3072)
    assert (pipe.alternate, pipe.endpoint.address, pipe.endpoint.kind) == (1, 0x84, ISOCHRONOUS)
    assert pipe.endpoint.max_packet_bytes == 3072


def test_the_ptp_interface_is_found_in_both_modes_and_the_video_only_in_live_mode() -> None:
    for raw in (LIVE_CONFIGURATION, MTP_CONFIGURATION):
        still = find_still(parse_configuration(raw))
        assert still is not None
        assert (still.bulk_in.address, still.bulk_out.address, still.bulk_in.kind) == (0x81, 0x01, BULK)
        assert still.events is not None
        assert (still.events.max_packet_bytes, still.events.kind) == (28, INTERRUPT)
    assert find_video(parse_configuration(MTP_CONFIGURATION)) is None


def test_a_vendor_class_ptp_interface_is_found_by_its_shape() -> None:
    raw = MTP_CONFIGURATION.replace(bytes.fromhex("03060101"), bytes.fromhex("03ff0000"))
    assert raw != MTP_CONFIGURATION
    assert find_still(parse_configuration(raw)) is not None


def test_the_narrowest_sufficient_pipe_is_chosen() -> None:
    wide = bytes.fromhex("09040201010e02010907058405001401")
    narrow = bytes.fromhex("09040202010e02010907058405000201")
    raw = LIVE_CONFIGURATION + narrow
    raw = raw[:2] + len(raw).to_bytes(2, "little") + raw[4:]
    assert wide in raw
    video = find_video(parse_configuration(raw))
    assert video is not None
    assert video.pipe(512).alternate == 2
    assert video.pipe(3000).alternate == 1
    assert video.pipe(10**6).alternate == 1


def test_a_superspeed_companion_widens_its_endpoint() -> None:
    companion = bytes([6, 0x30, 2, 0, *(9216).to_bytes(2, "little")])
    at = LIVE_CONFIGURATION.index(bytes.fromhex("07058405001401")) + 7
    raw = LIVE_CONFIGURATION[:at] + companion + LIVE_CONFIGURATION[at:]
    raw = raw[:2] + len(raw).to_bytes(2, "little") + raw[4:]
    video = find_video(parse_configuration(raw))
    assert video is not None
    assert video.pipe(3072).endpoint.max_packet_bytes == 9216


@given(st.binary(max_size=300))
@settings(deadline=None)
def test_garbage_descriptors_raise_only_the_codecs_own_error(raw: bytes) -> None:
    head = bytes([9, 2, *(9 + len(raw)).to_bytes(2, "little"), 1, 1, 0, 0x80, 250])
    for candidate in (raw, head + raw):
        try:
            configuration = parse_configuration(candidate)
            find_video(configuration)
            find_still(configuration)
        except ThetaMalformed:
            pass


@given(st.integers(0, 431), st.integers(0, 255))
@settings(deadline=None)
def test_a_configuration_with_one_wrong_byte_raises_only_the_codecs_own_error(at: int, value: int) -> None:
    raw = LIVE_CONFIGURATION[:at] + bytes([value]) + LIVE_CONFIGURATION[at + 1 :]
    try:
        configuration = parse_configuration(raw)
        video = find_video(configuration)
        if video is not None:
            video.pipe(3072)
        find_still(configuration)
    except ThetaMalformed:
        pass


@pytest.mark.parametrize("length", [26, 34, 48])
def test_a_probe_block_survives_the_round_trip_at_each_length(length: int) -> None:
    probe = Probe(hint=1, format_index=1, frame_index=2, interval_100ns=333_667, max_payload_bytes=3072)
    raw = probe.encode(length)
    assert len(raw) == length
    assert Probe.decode(raw) == probe
    assert raw[:8] == bytes.fromhex("0100010263170500")


@pytest.mark.parametrize("length", [0, 25, 27, 49])
def test_a_probe_block_of_another_length_is_refused(length: int) -> None:
    with pytest.raises(ThetaMalformed):
        Probe().encode(length)


@given(st.binary(max_size=60))
@settings(deadline=None)
def test_any_block_of_at_least_26_bytes_decodes(raw: bytes) -> None:
    if len(raw) < 26:
        with pytest.raises(ThetaMalformed):
            Probe.decode(raw)
    else:
        assert Probe.decode(raw).hint == struct.unpack_from("<H", raw)[0]


def run(answers: dict[tuple[int, int], bytes | None]) -> tuple[list[ControlRequest], Probe]:
    asked: list[ControlRequest] = []
    steps = negotiate(2, 1, 2, 333_667)
    request = next(steps)
    while True:
        asked.append(request)
        try:
            request = steps.send(answers.get((request.request, request.value), b""))
        except StopIteration as done:
            return asked, done.value


BEST = Probe(format_index=1, frame_index=1, max_frame_bytes=1 << 23, max_payload_bytes=3072, delay=7)


def test_the_order_of_the_negotiation_is_that_of_the_drivers_known_to_work() -> None:
    offer = Probe(hint=1, format_index=1, frame_index=2, interval_100ns=333_667, max_payload_bytes=3072)
    asked, agreed = run({(0x85, 0x100): b"\x22\x00", (0x83, 0x100): BEST.encode(34), (0x81, 0x100): offer.encode(34)})
    assert [(a.request_type, a.request, a.value, a.index) for a in asked] == [
        (0xA1, 0x85, 0x0100, 2),
        (0xA1, 0x83, 0x0100, 2),
        (0x21, 0x01, 0x0100, 2),
        (0xA1, 0x81, 0x0100, 2),
        (0x21, 0x01, 0x0200, 2),
    ]
    wish = Probe.decode(asked[2].data)
    assert (wish.hint, wish.format_index, wish.frame_index, wish.interval_100ns) == (1, 1, 2, 333_667)
    assert wish.delay == 7, "what GET_MAX said is kept"
    assert asked[4].data == offer.encode(34)
    assert agreed == offer


def test_a_camera_that_knows_no_questions_is_met_with_shorter_and_shorter_blocks() -> None:
    asked: list[ControlRequest] = []
    steps = negotiate(2, 1, 1, 333_667)
    request = next(steps)
    while True:
        asked.append(request)
        accepted = request.request == 0x01 and len(request.data) == 34
        try:
            request = steps.send(b"" if accepted else None)
        except StopIteration:
            break
    assert [len(a.data) for a in asked if a.request == 0x01] == [48, 34, 34]


@pytest.mark.parametrize("answers", [
    {(0x01, 0x100): None},
    {(0x01, 0x200): None, (0x81, 0x100): None},
    {(0x81, 0x100): BEST.encode(34)},
])  # fmt: skip
def test_a_camera_that_will_not_give_the_stream_is_reported(answers: dict[tuple[int, int], bytes | None]) -> None:
    with pytest.raises(ThetaRefused):
        run(answers)
